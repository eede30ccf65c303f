// The layer stack: a card per layer, from the surface inwards.

import { check, choice, colour, type Control, slider, triple } from "../controls";
import { h, icon, iconButton, keepFocus, plain } from "../dom";
import { meanFreePath, toColour } from "../material";
import { RECIPES, SPOKEN } from "../recipes";
import { coefficients, type Layer, presetLayer, type State } from "../state";
import type { Store } from "../store";
import type { Preset, Triple } from "../types";
import { DepthsPart } from "./depths";
import { IMAGE_NAMES, MAP_FILES, type MapHost } from "./look";
import { toast } from "../toast";
import { CrossSection, swatch } from "./section";

const MOST = 8;
const PAINTED_MM = [0.02, 2] as const; // what black and white are, where nothing says so
const PHASES: ["henyey-greenstein" | "schlick", string][] = [
  ["henyey-greenstein", "Henyey–Greenstein"],
  ["schlick", "Schlick: alike, simpler"],
];
const ADDED_MM = 0.2; // how thick a layer is that is put on top

export interface LayersHost extends MapHost {
  announce(text: string): void;
}

export class LayersPanel {
  readonly element = h("div", { class: "layers" });
  readonly section: CrossSection;
  private readonly cards = h("ol", { class: "cards", "aria-label": "Layers, from the surface inwards" });
  private controls: Control[] = [];
  private structure = "";
  private readonly chips: [HTMLElement, string][] = []; // and the layers that each stands for
  private readonly presets: Map<string, Preset>;
  private readonly add: HTMLButtonElement;
  private readonly depths: DepthsPart;
  private open = 0;
  private painted: string | undefined; // the colour map that was last worn

  constructor(
    private readonly store: Store,
    presets: Preset[],
    private readonly initial: State,
    private readonly host: LayersHost,
  ) {
    this.painted = initial.surface.albedo;
    this.presets = new Map(presets.map((preset) => [preset.name, preset]));
    this.section = new CrossSection((index) => this.show(index));
    this.add = h("button", { type: "button", class: "wide", onclick: () => this.addLayer() }, icon("add"), "Add a layer on top");
    this.depths = new DepthsPart(store, host, fill);
    this.element.append(this.recipes(), this.section.element, this.cards, this.add, this.depths.element);
    this.sync();
  }

  private recipes(): HTMLElement {
    const buttons = RECIPES.map((recipe) => {
      const layers = recipe.layers(this.presets);
      const dots = h("span", { class: "dot", "aria-hidden": "true" });
      dots.style.setProperty("--top", swatch(layers[0]));
      dots.style.setProperty("--bottom", swatch(layers[layers.length - 1]));
      const act = () => {
        this.open = 0;
        const had = this.store.state.surface.albedo;
        this.painted = had ?? this.painted;
        this.store.edit((state) => {
          state.layers = recipe.layers(this.presets);
          delete state.depths;
          if (!recipe.painted) delete state.surface.albedo;
          else if (this.painted && state.maps[this.painted]) state.surface.albedo = this.painted;
        });
        this.host.announce(`${recipe.name}: ${recipe.what}`);
        if (had && !recipe.painted) toast(`${recipe.name} shows its own colour`, `The colour map “${had}” is taken off. Skin, Fair skin and Fish wear it, and so does Undo; or choose it under Surface.`, "note");
      };
      const chip = h("button", { type: "button", class: "chip", title: recipe.what, onclick: act }, dots, recipe.name);
      this.chips.push([chip, JSON.stringify(layers)]);
      return chip;
    });
    return h("div", { class: "chips", role: "group", "aria-label": "Materials to start from" }, ...buttons);
  }

  private addLayer(): void {
    this.open = 0;
    const name = this.store.state.layers.some((layer) => layer.preset === "wholemilk") ? "skin2" : "wholemilk";
    this.store.edit((state) => void state.layers.unshift(presetLayer(this.presets.get(name)!, ADDED_MM)));
  }

  private show(index: number): void {
    this.open = index;
    this.structure = "";
    this.sync();
    this.cards.children[index]?.querySelector<HTMLElement>("select, input")?.focus();
  }

  sync(): void {
    const { layers, depths } = this.store.state;
    const structure = JSON.stringify([depths !== undefined, layers.map((layer) => [layer.by, layer.muted, layer.thickness_mm === null, layer.thickness_map?.map, layer.thickness_map?.invert]), this.open]);
    if (structure !== this.structure) {
      this.structure = structure;
      this.rebuild();
    } else {
      for (const control of this.controls) control.sync();
      layers.forEach((layer, i) => this.cards.children[i]?.querySelector<HTMLElement>(".swatch")?.style.setProperty("--colour", swatch(layer)));
      this.cards.querySelectorAll<HTMLElement>(".title").forEach((title, i) => void (title.textContent = titleOf(layers[i])));
    }
    const made = JSON.stringify(layers);
    for (const [chip, of] of this.chips) chip.setAttribute("aria-pressed", String(of === made));
    this.add.hidden = layers.length >= MOST;
    this.depths.sync();
    this.section.draw(layers, depths !== undefined);
  }

  private rebuild(): void {
    const { layers } = this.store.state;
    this.open = Math.min(this.open, layers.length - 1);
    this.controls = [];
    keepFocus(this.cards, () => this.cards.replaceChildren(...layers.map((layer, index) => this.card(layer, index))));
  }

  private card(layer: Layer, index: number): HTMLElement {
    const { layers } = this.store.state;
    const open = index === this.open;
    const number = index + 1;
    const chip = h("span", { class: "swatch", "aria-hidden": "true" });
    chip.style.setProperty("--colour", swatch(layer));
    const toggle = h(
      "button",
      { type: "button", class: "card-title", "aria-expanded": String(open), onclick: () => ((this.open = open ? -1 : index), (this.structure = ""), this.sync()) },
      chip,
      h("span", { class: "index" }, String(number)),
      h("span", { class: "title" }, titleOf(layer)),
    );
    const mute = iconButton(layer.muted ? "hidden" : "eye", layer.muted ? `Show layer ${number}` : `Hide layer ${number}`, () => {
      this.store.edit((state) => void (state.layers[index].muted = !layer.muted));
      this.host.announce(`Layer ${number} is ${layer.muted ? "shown" : "hidden"}`);
    });
    const heard = layers.filter((one) => !one.muted).length;
    mute.disabled = !layer.muted && heard < 2;
    const up = iconButton("up", `Move layer ${number} up`, () => this.move(index, -1));
    up.disabled = index === 0;
    const down = iconButton("down", `Move layer ${number} down`, () => this.move(index, 1));
    down.disabled = index === layers.length - 1;
    const remove = iconButton("remove", `Remove layer ${number}`, () => {
      this.store.edit((state) => this.removeLayer(state, index));
      this.host.announce(`Layer ${number} is removed`);
    });
    remove.disabled = layers.length < 2;
    const head = h("div", { class: "card-head" }, toggle, mute, up, down, remove);
    const card = h("li", { class: `card${layer.muted ? " muted" : ""}${open ? " open" : ""}` }, head);
    if (open) card.append(this.body(layer, index));
    this.takeDrops(card, index);
    return card;
  }

  private body(layer: Layer, index: number): HTMLElement {
    const at = (state: State): Layer => state.layers[index] ?? layer;
    const keep = (control: Control) => (this.controls.push(control), control.element);
    const heard = this.heard(index);
    const first = this.initial.layers[index] ?? layer;
    const body = h("div", { class: "card-body" });
    const modes: [Layer["by"], string][] = [
      ["preset", "A known material"],
      ["colour", "A colour and a depth"],
      ["coefficients", "Coefficients"],
    ];
    if (layer.by === "given") modes.unshift(["given", "As the scene says"]);
    body.append(keep(choice(this.store, { label: "Made of", choices: modes, get: (state) => at(state).by, set: (state, by) => this.setMode(at(state), by) })));
    if (layer.by === "preset") {
      const choices = [...this.presets.keys()].map((name): [string, string] => [name, SPOKEN[name] ?? name]);
      const set = (state: State, name: string) =>
        Object.assign(at(state), { ...presetLayer(this.presets.get(name)!, null), thickness_mm: at(state).thickness_mm, thickness_map: at(state).thickness_map });
      body.append(keep(choice(this.store, { label: "Material", choices, pointer: `/material/layers/${heard}/medium`, get: (state) => at(state).preset, set })));
      const numbers = h("p", { class: "note" });
      const sync = () => void (numbers.textContent = numbersOf(at(this.store.state)));
      sync();
      body.append(keep({ element: numbers, sync }));
    }
    if (layer.by === "colour") {
      body.append(keep(colour(this.store, { label: "Colour", hint: "Of the matter itself, as if nothing were mirrored where light leaves it; beneath a surface it comes back darker (Inside: Comes back)", get: (state) => at(state).colour, set: (state, value) => void (at(state).colour = value) })));
      const mean = (state: State) => Math.cbrt(at(state).distance_mm.reduce((product, one) => product * one, 1));
      const scale = (state: State, value: number) => {
        const factor = value / mean(state);
        at(state).distance_mm = at(state).distance_mm.map((one) => one * factor) as Triple;
      };
      const label = "Light travels";
      const hint = "Mean free path: how far light goes before it first scatters";
      body.append(keep(slider(this.store, { label, hint, unit: "mm", min: 0.01, max: 20, log: true, get: mean, set: scale, initial: () => mean(this.initialFor(index)) })));
      body.append(keep(triple(this.store, { label: "per colour", unit: "mm", least: 0.001, get: (state) => at(state).distance_mm, set: (state, value) => void (at(state).distance_mm = value), initial: (state) => this.known(at(state))?.distance_mm })));
    }
    if (layer.by === "coefficients") {
      const field = (name: "sigma_a" | "sigma_s", label: string) =>
        keep(triple(this.store, { label, unit: "1/mm", least: 0, pointer: `/media/layer-${heard + 1}/${name}_per_mm`, get: (state) => at(state)[name], set: (state, value) => void (at(state)[name] = value), initial: (state) => this.known(at(state))?.[name] }));
      body.append(field("sigma_a", "Absorption σₐ"), field("sigma_s", "Scattering σₛ"));
    }
    if (layer.by === "colour" || layer.by === "coefficients") {
      body.append(
        keep(slider(this.store, { label: "Forward g", hint: "-1: light is thrown back, 0: everywhere alike, 1: straight on", min: -0.95, max: 0.95, get: (state) => at(state).g, set: (state, value) => void (at(state).g = value), initial: () => first.g })),
        keep(choice(this.store, { label: "Scatters as", hint: "The shape around that mean, of light that pictures march; what spreads knows the first alone. All layers that are marched have one", choices: PHASES, pointer: `/media/layer-${heard + 1}/phase`, get: (state) => at(state).phase ?? "henyey-greenstein", set: (state, value) => void (at(state).phase = value) })),
        keep(slider(this.store, { label: "Refractive index η", min: 1, max: 1.6, limits: [1, 3], get: (state) => at(state).eta, set: (state, value) => void (at(state).eta = value), initial: () => first.eta })),
      );
    }
    body.append(this.store.state.depths ? h("p", { class: "note" }, "It ends where the depth texture says.") : this.thickness(layer, index, keep));
    return body;
  }

  /** The material that a layer was, before it had numbers of its own. */
  private known(layer: Layer): Layer | undefined {
    const preset = this.presets.get(layer.preset);
    return preset && presetLayer(preset, null);
  }

  /** The number of a layer among those that the service hears of. */
  private heard(index: number): number {
    return this.store.state.layers.slice(0, index).filter((layer) => !layer.muted).length;
  }

  private initialFor(index: number): State {
    return this.initial.layers[index]?.by === "colour" ? this.initial : this.store.state;
  }

  private thickness(layer: Layer, index: number, keep: (control: Control) => HTMLElement): HTMLElement {
    const at = (state: State): Layer => state.layers[index] ?? layer;
    const last = index === this.store.state.layers.length - 1;
    const box = h("div", { class: "thickness" });
    const initial = () => this.initial.layers[index]?.thickness_mm ?? undefined;
    if (layer.thickness_map) {
      const map = layer.thickness_map;
      const range = (k: 0 | 1, label: string) =>
        keep(
          slider(this.store, {
            label,
            unit: "mm",
            min: 0,
            max: 5,
            limits: [0, 1000],
            get: (state) => at(state).thickness_map?.range?.[k] ?? k,
            initial: () => PAINTED_MM[k],
            set: (state, value) => {
              const painted = at(state).thickness_map;
              const [low, high] = painted?.range ?? [0, 1];
              // ends that fall would be refused: one takes the other along
              if (painted) painted.range = k === 0 ? [value, Math.max(value, high)] : [Math.min(value, low), value];
            },
          }),
        );
      const set = (state: State, thin: boolean) => {
        const painted = at(state).thickness_map;
        if (painted) painted.invert = thin;
      };
      const thin = keep(check(this.store, { label: "Bright is thin", hint: "Exchanges what black and white mean", get: (state) => at(state).thickness_map?.invert ?? false, set }));
      const ends = map.invert ? (["White is", "Black is"] as const) : (["Black is", "White is"] as const);
      const drop = h("button", { type: "button", onclick: () => this.store.edit((state) => void (at(state).thickness_map = null)) }, icon("remove"), "Remove the map");
      box.append(h("p", { class: "note" }, icon("map"), ` Thickness painted in “${map.map}”`), range(0, ends[0]), range(1, ends[1]), thin, h("div", { class: "buttons" }, drop));
      return box;
    }
    if (layer.thickness_mm !== null || !last) {
      box.append(keep(slider(this.store, { label: "Thickness", unit: "mm", min: 0.01, max: 20, limits: [0.0001, 10000], log: true, pointer: `/material/layers/${this.heard(index)}/thickness_mm`, get: (state) => at(state).thickness_mm ?? 1, set: (state, value) => void (at(state).thickness_mm = value), initial: () => initial() ?? ADDED_MM })));
    }
    const buttons = h("div", { class: "buttons" });
    if (last) {
      const set = (state: State, endless: boolean) => void (at(state).thickness_mm = endless ? null : 1);
      box.append(keep(check(this.store, { label: "Goes on without end", hint: "As deep as the object; else light leaves at the bottom", get: (state) => at(state).thickness_mm === null, set })));
    }
    const pick = async () => {
      const file = await this.host.pickFile(MAP_FILES);
      if (file) await this.takeThickness(file, index);
    };
    buttons.append(h("button", { type: "button", title: "Or drop an image on this card", onclick: pick }, icon("map"), "Thickness from a picture…"));
    box.append(buttons);
    return box;
  }

  private async takeThickness(file: File, index: number): Promise<void> {
    const meant = JSON.stringify(this.store.state.layers[index]);
    const name = await this.host.takeMap(file, "linear");
    if (!name) return;
    this.store.edit((state) => {
      const layer = state.layers.find((one) => JSON.stringify(one) === meant) ?? state.layers[index]; // it may have moved
      if (layer) layer.thickness_map = { map: name, range: [PAINTED_MM[0], layer.thickness_mm ?? PAINTED_MM[1]], invert: false };
    });
  }

  private takeDrops(card: HTMLElement, index: number): void {
    card.addEventListener("dragover", (event) => {
      event.preventDefault();
      card.classList.add("drop");
    });
    card.addEventListener("dragleave", () => card.classList.remove("drop"));
    card.addEventListener("drop", (event) => {
      card.classList.remove("drop");
      const file = event.dataTransfer?.files[0];
      if (!file || !IMAGE_NAMES.test(file.name)) return;
      event.preventDefault();
      event.stopPropagation();
      void this.takeThickness(file, index);
    });
  }

  private setMode(layer: Layer, by: Layer["by"]): void {
    const now = coefficients(layer); // the same medium, told in another way
    layer.sigma_a = now.sigma_a;
    layer.sigma_s = now.sigma_s;
    layer.colour = toColour(now.sigma_a, now.sigma_s, layer.g);
    layer.distance_mm = meanFreePath(now.sigma_a, now.sigma_s);
    layer.by = by;
    if (by === "preset") Object.assign(layer, { ...presetLayer(this.presets.get(layer.preset)!, null), thickness_mm: layer.thickness_mm, thickness_map: layer.thickness_map });
  }

  private move(index: number, by: number): void {
    this.open = index + by;
    this.store.edit((state) => {
      const [layer] = state.layers.splice(index, 1);
      state.layers.splice(index + by, 0, layer);
      this.mendEnds(state);
    });
  }

  private removeLayer(state: State, index: number): void {
    const [gone] = state.layers.splice(index, 1);
    const last = state.layers[state.layers.length - 1];
    if (gone.thickness_mm === null && !gone.thickness_map && !last.thickness_map) last.thickness_mm = null;
  }

  /** The last layer alone may be endless, and is where one was. */
  private mendEnds(state: State): void {
    const endless = state.layers.some((layer) => layer.thickness_mm === null && !layer.thickness_map);
    state.layers.forEach((layer, i) => {
      const last = i === state.layers.length - 1;
      if (!last && layer.thickness_mm === null) layer.thickness_mm = 1;
      if (last && endless && !layer.thickness_map) layer.thickness_mm = null;
    });
  }
}

/** A layer for each channel of depth textures and one below; those that are missing are like the deepest. */
function fill(state: State, channels: number): void {
  const heard = () => state.layers.filter((layer) => !layer.muted).length;
  while (heard() <= channels) state.layers.push({ ...structuredClone(state.layers[state.layers.length - 1]), muted: false, thickness_map: null });
}

function titleOf(layer: Layer): string {
  const name = layer.by === "preset" ? (SPOKEN[layer.preset] ?? layer.preset) : { colour: "Own colour", coefficients: "Own coefficients", given: "As the scene says" }[layer.by];
  return name;
}

/** What a layer is made of, in numbers. */
function numbersOf({ sigma_a, sigma_s, g, eta }: Layer): string {
  const three = (values: Triple) => values.map(plain).join(" ");
  return `σₐ ${three(sigma_a)}, σₛ ${three(sigma_s)} per mm (red green blue); g ${plain(g)}, η ${plain(eta)}`;
}
