// What the march has beside its steps: a picture its noise comes from, and how deep boundaries may lie.

import { check, type Control, slider } from "../controls";
import { h, icon, keepFocus } from "../dom";
import type { State } from "../state";
import type { Store } from "../store";
import { MARCH } from "../types";
import { MAP_FILES, type MapHost } from "./look";

const DEEPEST_MM = 20; // of the sliders; there boundaries stay as they are

/** Controls that are built anew when `structure` of the state changes. */
function rebuilt(store: Store, structure: (state: State) => unknown, build: (keep: (control: Control) => HTMLElement) => HTMLElement[]): Control {
  const element = h("div");
  let controls: Control[] = [];
  let built = "";
  const sync = () => {
    const now = JSON.stringify(structure(store.state));
    if (now === built) return controls.forEach((control) => control.sync());
    built = now;
    controls = [];
    keepFocus(element, () => element.replaceChildren(...build((control) => (controls.push(control), control.element))));
  };
  sync();
  return { element, sync };
}

const put = (state: State, part: Partial<typeof MARCH>) => void (state.methods.march = { ...MARCH, ...state.methods.march, ...part });

/** The picture that noise is taken from, so that it sticks to the surface. */
export function noiseMap(store: Store, host: MapHost): Control {
  return rebuilt(store, ({ methods }) => methods.march?.noise_map ?? null, () => {
    const name = store.state.methods.march?.noise_map;
    if (name) {
      const drop = h("button", { type: "button", onclick: () => store.edit((state) => put(state, { noise_map: null })) }, icon("remove"), "Remove the map");
      return [h("p", { class: "note" }, icon("map"), ` Noise painted in “${name}”`), h("div", { class: "buttons" }, drop)];
    }
    const pick = async () => {
      const file = await host.pickFile(MAP_FILES);
      const map = file ? await host.takeMap(file, "linear") : null;
      if (map) store.edit((state) => put(state, { noise_map: map }));
    };
    const title = "Its greys shift steps and maps, and stick to the surface; else numbers are drawn";
    return [h("div", { class: "buttons" }, h("button", { type: "button", title, onclick: pick }, icon("map"), "Noise from a picture…"))];
  });
}

/** How many boundaries lie between layers, as far as the page knows. */
export function boundaries({ layers, depths, methods }: State): number {
  const given = methods.march?.deepest_mm;
  if (Array.isArray(given)) return given.length;
  const heard = layers.filter((layer) => !layer.muted);
  const last = heard[heard.length - 1];
  const endless = depths || (last?.thickness_mm === null && !last.thickness_map);
  return heard.length - (endless ? 1 : 0);
}

/** How deep boundaries between layers may lie: all of them, or each by itself. */
export function deepest(store: Store): Control {
  const one = (label: string, k: number) =>
    slider(store, {
      label,
      hint: "Boundaries between layers are brought up to this depth; at the right end they stay",
      unit: "mm",
      min: 0.01,
      max: DEEPEST_MM,
      log: true,
      limits: [0.001, DEEPEST_MM],
      pointer: "/methods/march/deepest_mm",
      get: (state) => [state.methods.march?.deepest_mm ?? DEEPEST_MM].flat()[k] ?? DEEPEST_MM,
      set: (state, value) => {
        const given = state.methods.march?.deepest_mm;
        // one after the other, none above the one before it
        if (Array.isArray(given)) put(state, { deepest_mm: given.map((old, i) => (i === k ? value : i < k ? Math.min(old, value) : Math.max(old, value))) });
        else put(state, { deepest_mm: value < DEEPEST_MM ? value : null });
      },
      initial: () => DEEPEST_MM,
    });
  const each = check(store, {
    label: "Each boundary by itself",
    hint: "From the outermost inwards",
    get: (state) => Array.isArray(state.methods.march?.deepest_mm),
    set: (state, on) => {
      const given = state.methods.march?.deepest_mm ?? DEEPEST_MM;
      if (on) put(state, { deepest_mm: Array(boundaries(state)).fill([given].flat()[0]) });
      else put(state, { deepest_mm: [given].flat().reduce((most, value) => Math.max(most, value)) });
    },
  });
  const many = (state: State) => Array.isArray(state.methods.march?.deepest_mm);
  return rebuilt(store, (state) => [many(state), boundaries(state)], (keep) => {
    const count = boundaries(store.state);
    const sliders = many(store.state) ? Array.from({ length: count }, (_, k) => one(`Boundary ${k + 1} at most at`, k)) : [one("Layers end at most at", 0)];
    return [...sliders.map(keep), ...(count > 1 || many(store.state) ? [keep(each)] : [])];
  });
}
