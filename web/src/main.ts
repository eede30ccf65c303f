// The page: asks for what the first picture needs, loads what shows it, and starts when the service is ready.

import { api, Offline, sleep } from "./api";
import { h } from "./dom";
import { opening } from "./opening";
import { toast } from "./toast";
import { prepared } from "./view/context";

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
  // asked at once: a service that is ready answers all together
  const early = opening().catch(() => null);
  const studio = import("./app");
  await ready();
  const given = (await early) ?? (await opening());
  prepared(document.getElementById("canvas") as HTMLCanvasElement); // while the studio is on its way
  const { App } = await studio;
  if (given.fault) toast("The link could not be read", given.fault);
  addEventListener("hashchange", () => location.reload()); // a link that was pasted here; the page's own writing is silent
  Object.assign(window, { texsss: new App(given) }); // for tests, and for the curious
}

start().catch((error) => {
  console.warn(error);
  toast("The page could not start", error instanceof Error ? error.message : String(error));
});
