// The picture and the surface's gloss: what the page's own shader does, at once.

import { check, choice, type Control, section, slider } from "../controls";
import { h, icon, keepFocus } from "../dom";
import type { State } from "../state";
import type { Store } from "../store";
import type { Tonemap, Triple } from "../types";

const BACKGROUNDS: [string, string, Triple | undefined][] = [
  ["studio", "Dark studio", undefined],
  ["black", "Black", [0, 0, 0]],
  ["grey", "Grey", [0.18, 0.18, 0.18]],
  ["white", "White", [1, 1, 1]],
];

/** Exposure, tone map and background. */
export function viewSection(store: Store, initial: State): { element: HTMLElement; controls: Control[] } {
  const controls = [
    slider(store, { label: "Exposure", unit: "EV", min: -4, max: 4, limits: [-30, 30], pointer: "/output/exposure_ev", get: (state) => state.output.exposure_ev, set: (state, value) => void (state.output.exposure_ev = value), initial: () => initial.output.exposure_ev }),
    choice<Tonemap>(store, {
      label: "Tone map",
      hint: "How light becomes colours of a display",
      choices: [
        ["aces", "ACES: contrast of film"],
        ["agx", "AgX: soft highlights"],
        ["linear", "None: as measured"],
      ],
      get: (state) => state.output.tonemap,
      set: (state, value) => void (state.output.tonemap = value),
    }),
    choice(store, {
      label: "Background",
      choices: BACKGROUNDS.map(([key, name]): [string, string] => [key, name]),
      get: (state) => BACKGROUNDS.find(([, , value]) => JSON.stringify(value) === JSON.stringify(state.output.background))?.[0] ?? "studio",
      set: (state, key) => {
        const value = BACKGROUNDS.find(([name]) => name === key)?.[2];
        if (value) state.output.background = value;
        else delete state.output.background;
      },
    }),
  ];
  return { element: section("Picture", ...controls.map((control) => control.element)), controls };
}

/** What a map may be, as a file field takes it. */
export const MAP_FILES = "image/png,image/jpeg,image/webp,.exr,.hdr";

/** Names of files that maps are read from. */
export const IMAGE_NAMES = /\.(png|jpe?g|webp|exr|hdr)$/i;

/** Where pictures come from. */
export interface MapHost {
  /** Uploads a file and names it as a map; null when it could not. */
  takeMap(file: File, space: "srgb" | "linear"): Promise<string | null>;
  pickFile(accept: string): Promise<File | null>;
}

/** Gloss and the maps that lie on the surface. */
export class SurfaceSection {
  readonly element = section("Surface");
  private controls: Control[] = [];
  private structure = "";

  constructor(
    private readonly store: Store,
    private readonly initial: State,
    private readonly host: MapHost,
  ) {
    this.sync();
  }

  sync(): void {
    const { surface } = this.store.state;
    const structure = JSON.stringify([surface.albedo, surface.normal, typeof surface.roughness]);
    if (structure === this.structure) return this.controls.forEach((control) => control.sync());
    this.structure = structure;
    const { store, initial } = this;
    const number = (value: number | string | undefined, otherwise: number) => (typeof value === "number" ? value : otherwise);
    const fields = (name: "roughness" | "specular" | "second_lobe", label: string, otherwise: number, hint: string) =>
      slider(store, { label, hint, min: 0, max: 1, pointer: `/material/surface/${name}`, get: (state) => number(state.surface[name], otherwise), set: (state, value) => void (state.surface[name] = value), initial: () => number(initial.surface[name], otherwise) });
    this.controls = [
      fields("roughness", "Roughness", 0.4, "0 mirrors, 1 is dull"),
      fields("specular", "Highlights", 1, "Strength of the mirrored light"),
      fields("second_lobe", "Second, wider highlight", 0, "Skin is oil on a coarser surface"),
    ];
    const nodes: Node[] = this.controls.map((control) => control.element);
    nodes.push(this.map("albedo", "Colour map"), this.map("normal", "Normal map"));
    if (surface.albedo) {
      const where = choice<"pre" | "post" | "both">(store, {
        label: "Colour applies",
        hint: "Before light spreads, after it, or half and half",
        choices: [
          ["post", "where light leaves"],
          ["pre", "where light enters"],
          ["both", "at both"],
        ],
        get: (state) => state.surface.albedo_mode ?? "post",
        set: (state, value) => void (state.surface.albedo_mode = value),
      });
      const whole = check(store, {
        label: "The map alone sets the colour",
        hint: "Profiles are scaled to return all light, so that the colour is not applied twice",
        get: (state) => state.surface.normalise ?? true,
        set: (state, value) => void (state.surface.normalise = value),
      });
      this.controls.push(where, whole);
      nodes.push(where.element, whole.element);
    }
    keepFocus(this.element, () => this.element.replaceChildren(this.element.firstElementChild!, ...nodes));
  }

  private map(kind: "albedo" | "normal", label: string): HTMLElement {
    const name = this.store.state.surface[kind];
    const pick = async () => {
      const file = await this.host.pickFile(MAP_FILES);
      const map = file ? await this.host.takeMap(file, kind === "albedo" ? "srgb" : "linear") : null;
      if (map) this.store.edit((state) => void (state.surface[kind] = map));
    };
    const remove = () => this.store.edit((state) => void delete state.surface[kind]);
    const buttons = h("div", { class: "buttons" }, h("button", { type: "button", onclick: pick }, icon("map"), name ? "Replace…" : "Choose…"), name ? h("button", { type: "button", onclick: remove }, icon("remove"), "Remove") : null);
    return h("div", { class: "control row", role: "group", "aria-label": label }, h("span", null, label, name ? h("small", null, ` ${name}`) : null), buttons);
  }
}
