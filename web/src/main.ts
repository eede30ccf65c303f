// The page: starts when the service is ready, and joins the parts.

import { api, Offline, sleep } from "./api";
import { App } from "./app";
import { h } from "./dom";
import { readHash } from "./share";
import { toast } from "./toast";

async function ready(): Promise<void> {
  const screen = h("div", { class: "splash", role: "status" }, h("div", { class: "orb" }), h("p", null, "Starting the service…"));
  const late = setTimeout(() => document.body.append(screen), 400);
  for (;;) {
    try {
      if (await api.ready()) break;
    } catch (error) {
      if (!(error instanceof Offline)) throw error;
    }
    await sleep(400);
  }
  clearTimeout(late);
  screen.remove();
}

async function start(): Promise<void> {
  // asked at once: a service that is ready answers all three together
  const known = () => Promise.all([api.scenes(), api.presets()]);
  const early = known().catch(() => null);
  await ready();
  const [scenes, presets] = (await early) ?? (await known());
  const given = await readHash(location.hash).catch((error) => {
    toast("The link could not be read", String(error));
    return null;
  });
  const app = new App(scenes, presets, given);
  Object.assign(window, { texsss: app }); // for tests, and for the curious
}

start().catch((error) => {
  console.warn(error);
  toast("The page could not start", error instanceof Error ? error.message : String(error));
});
