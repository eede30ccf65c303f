// Which method computes what, and its numbers: for those who compare.

import { check, choice, type Control, section, slider } from "../controls";
import { h } from "../dom";
import { ALONE, type State } from "../state";
import type { Store } from "../store";
import { MARCH, type Methods, OCTREE, POISSON } from "../types";
import type { MapHost } from "./look";
import { boundaries, deepest, noiseMap } from "./march";

type Choices<K extends keyof Methods> = [Methods[K] & string, string][];

interface Range {
  label: string;
  hint?: string;
  unit?: string;
  min: number;
  max: number;
  log?: boolean;
  whole?: boolean;
  limits?: [number, number];
}

export class MethodPanel {
  readonly element = h("div");
  private readonly controls: Control[] = [];
  private readonly shown: [Control, (methods: Methods) => boolean][] = []; // only where it says something

  constructor(
    private readonly store: Store,
    private readonly initial: State,
    host: MapHost,
  ) {
    const uniform = (methods: Methods) => methods.single_scattering === "uniform";
    const marched = (methods: Methods) => methods.single_scattering !== "none";
    const by = (name: Methods["diffusion"]) => (methods: Methods) => methods.diffusion === name;
    this.element.append(
      section(
        "Method",
        this.pick("diffusion", "Light spreads", [
          ["surface", "over the surface"],
          ["uv", "in the texture: fast"],
          ["octree", "by an octree: slow"],
          ["poisson", "by Poisson discs (2006)"],
          ["parallax", "pictures beneath (2006)"],
          ["none", "not at all"],
        ]),
        this.part("octree", OCTREE, "epsilon", by("octree"), { label: "Coarseness ε", hint: "Parts of the surface with an area below ε × distance² count as one", min: 0.005, max: 1, log: true, limits: [1e-4, 10] }),
        this.part("poisson", POISSON, "taps", by("poisson"), { label: "Samples of the disc", min: 1, max: 64, whole: true, limits: [1, 256] }),
        this.part("poisson", POISSON, "passes", by("poisson"), { label: "Passes", min: 1, max: 8, whole: true, limits: [1, 16] }),
        this.part("poisson", POISSON, "reduction", by("poisson"), { label: "Light map made smaller", unit: "×", min: 1, max: 8, whole: true, limits: [1, 16] }),
        this.through(),
        this.number("/methods/interreflection", (methods) => methods.interreflection ?? 0, (methods, value) => void (methods.interreflection = value), { label: "Parts light each other", hint: "How often light that left one part, and meets another, spreads there too", unit: "times", min: 0, max: 4, whole: true, limits: [0, 16] }, (methods) => !ALONE.includes(methods.diffusion)),
        this.pick("profile", "Profile", [
          ["layered-sp3", "Layered SP3: the best"],
          ["layered-diffusion", "Layered diffusion"],
          ["multipole", "Multipole"],
          ["better-dipole", "Better dipole"],
          ["dipole", "Dipole (2001)"],
        ]),
        this.pick("incidence", "Light arrives", [
          ["diffuse", "from everywhere"],
          ["normal", "straight from above"],
        ]),
        this.pick("rule", "Layers are taken", [
          ["exit", "where light leaves"],
          ["entry", "where light enters"],
          ["geometric-mean", "at both (reciprocal)"],
        ]),
        this.number("/methods/terms", (methods) => methods.terms, (methods, value) => void (methods.terms = value), { label: "Gaussians", hint: "Blurred copies of the light that are summed", min: 1, max: 16, whole: true, limits: [1, 32] }),
      ),
      section(
        "First bounce",
        this.pick("single_scattering", "Scattered once", [
          ["auto", "marched"],
          ["none", "with all the rest"],
          ["exact", "marched, with rays to every light"],
          ["uniform", "marched in even steps"],
        ], "Marched light depends on the view: it is blended in when the camera rests. With rays to panels, balls and surroundings it takes longer"),
        this.number("/methods/march_samples", (methods) => methods.march_samples, (methods, value) => void (methods.march_samples = value), { label: "Steps", min: 1, max: 100, log: true, whole: true, limits: [1, 1000] }, marched),
        this.part("march", MARCH, "noise", uniform, { label: "Noise of the start", unit: "steps", hint: "Each point starts elsewhere within a step, which hides the steps", min: 0, max: 1 }),
        this.part("march", MARCH, "noise_uv", marched, { label: "Noise of the maps", unit: "uv", hint: "How far from its place each point reads the maps of layers", min: 0, max: 0.1, limits: [0, 1] }),
        this.keep(noiseMap(store, host), marched),
        this.keep(deepest(store), (methods) => marched(methods) && boundaries(this.store.state) > 0),
        this.byAngle((methods) => marched(methods) && !ALONE.includes(methods.diffusion)),
      ),
    );
    this.sync();
  }

  private keep(control: Control, where?: (methods: Methods) => boolean): HTMLElement {
    this.controls.push(control);
    if (where) this.shown.push([control, where]);
    return control.element;
  }

  private pick<K extends "profile" | "diffusion" | "rule" | "incidence" | "single_scattering">(key: K, label: string, choices: Choices<K>, hint = ""): HTMLElement {
    return this.keep(choice(this.store, { label, hint, choices, pointer: `/methods/${key}`, get: (state) => state.methods[key] as Methods[K] & string, set: (state, value) => void (state.methods[key] = value) }));
  }

  private number(pointer: string, get: (methods: Methods) => number, set: (methods: Methods, value: number) => void, look: Range, where?: (methods: Methods) => boolean): HTMLElement {
    const { whole, ...rest } = look;
    const put = (state: State, value: number) => set(state.methods, whole ? Math.round(value) : value);
    return this.keep(slider(this.store, { ...rest, pointer, get: (state) => get(state.methods), set: put, initial: () => get(this.initial.methods) }), where);
  }

  /** A number of one method's own. */
  private part<P extends "octree" | "poisson" | "march", T extends object>(part: P, otherwise: T, key: keyof T & string, where: (methods: Methods) => boolean, look: Range): HTMLElement {
    const all = (methods: Methods): T => ({ ...otherwise, ...methods[part] });
    return this.number(
      `/methods/${part}/${key}`,
      (methods) => all(methods)[key] as number,
      (methods, value) => void (methods[part] = { ...all(methods), [key]: value } as unknown as Methods[P]),
      look,
      where,
    );
  }

  private through(): HTMLElement {
    return this.keep(check(this.store, {
      label: "Light comes through thin parts",
      hint: "From the far side of the object, as much as its thickness there lets pass",
      get: (state) => state.methods.transmission ?? false,
      set: (state, value) => void (state.methods.transmission = value),
    }));
  }

  private byAngle(where: (methods: Methods) => boolean): HTMLElement {
    const look = {
      label: "The rest enters and leaves by its angle",
      hint: "What was scattered more than once leaves a little less at grazing views than even light would",
      get: (state: State) => state.methods.angular ?? false,
      set: (state: State, value: boolean) => void (state.methods.angular = value),
    };
    return this.keep(check(this.store, look), where);
  }

  sync(): void {
    for (const control of this.controls) control.sync();
    for (const [control, where] of this.shown) control.element.hidden = !where(this.store.state.methods);
  }
}
