// Pictures beneath the surface, which shift with the view (Oat 2006): what lies there, how deep, how much shows.

import { type Control, section, slider } from "../controls";
import { h, icon, iconButton, keepFocus } from "../dom";
import type { State } from "../state";
import type { Store } from "../store";
import type { Parallax } from "../types";
import { MAP_FILES, type MapHost } from "./look";

const MOST = 4;
const DEPTH_MM = 1;

export class BeneathSection {
  readonly element = section("Beneath the surface");
  private readonly heading = this.element.firstElementChild!;
  private controls: Control[] = [];
  private structure = "";

  constructor(
    private readonly store: Store,
    private readonly host: MapHost,
  ) {
    this.sync();
  }

  sync(): void {
    const { methods } = this.store.state;
    this.element.hidden = methods.diffusion !== "parallax";
    const layers = methods.parallax?.layers ?? [];
    const structure = JSON.stringify(layers.map((layer) => layer.base));
    if (structure === this.structure) return this.controls.forEach((control) => control.sync());
    this.structure = structure;
    this.controls = [];
    const keep = (control: Control) => (this.controls.push(control), control.element);
    const hidden = slider(this.store, {
      label: "The surface hides",
      hint: "0: it is glass; 1: nothing beneath is seen",
      min: 0,
      max: 1,
      pointer: "/methods/parallax/opacity",
      get: ({ methods }) => (typeof methods.parallax?.opacity === "number" ? methods.parallax.opacity : 0.5),
      set: ({ methods }, value) => void (parallax(methods).opacity = value),
    });
    const add = h("button", { type: "button", class: "wide", onclick: () => this.take(layers.length) }, icon("add"), "Add a picture beneath");
    add.hidden = layers.length >= MOST;
    const said = layers.length ? "Seen from this side, and drawn by the service when the view rests." : "Nothing lies there yet: add a picture that is laid out like the colour map.";
    const cards = layers.map((_, i) => this.layer(i, keep));
    keepFocus(this.element, () => this.element.replaceChildren(this.heading, h("p", { class: "note" }, said), layers.length ? keep(hidden) : "", ...cards, add));
  }

  private layer(index: number, keep: (control: Control) => HTMLElement): HTMLElement {
    const at = (state: State) => state.methods.parallax?.layers[index];
    const number = (key: "depth_mm" | "spread", label: string, hint: string, unit: string, range: [number, number], otherwise: number) =>
      keep(
        slider(this.store, {
          label,
          hint,
          unit,
          min: range[0],
          max: range[1],
          log: key === "depth_mm",
          pointer: `/methods/parallax/layers/${index}/${key}`,
          get: (state) => at(state)?.[key] ?? otherwise,
          set: (state, value) => {
            const layer = at(state);
            if (layer) layer[key] = value;
          },
        }),
      );
    const name = at(this.store.state)!.base;
    const replace = h("button", { type: "button", class: "card-title", title: "Choose another picture", onclick: () => this.take(index) }, icon("map"), h("span", { class: "index" }, String(index + 1)), h("span", { class: "title" }, name));
    const remove = iconButton("remove", `Remove picture ${index + 1}`, () => this.store.edit(({ methods }) => void parallax(methods).layers.splice(index, 1)));
    return h(
      "div",
      { class: "card open", role: "group", "aria-label": `Picture ${index + 1} beneath, ${name}` },
      h("div", { class: "card-head" }, replace, remove),
      h(
        "div",
        { class: "card-body" },
        number("depth_mm", "Lies", "Below the surface, or below the picture above", "mm deeper", [0.05, 20], DEPTH_MM),
        number("spread", "Blurs by", "Per millimetre that is looked through", "mm/mm", [0, 1], 0.25),
      ),
    );
  }

  private async take(index: number): Promise<void> {
    const file = await this.host.pickFile(MAP_FILES);
    const map = file ? await this.host.takeMap(file, "srgb") : null;
    if (!map) return;
    this.store.edit((state) => {
      const { layers } = parallax(state.methods);
      layers[index] = { ...(layers[index] ?? { depth_mm: DEPTH_MM }), base: map };
    });
  }
}

function parallax(methods: State["methods"]): Parallax {
  return (methods.parallax ??= { opacity: 0.5, layers: [] });
}
