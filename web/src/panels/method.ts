// Which method computes what: for those who compare.

import { choice, type Control, section, slider } from "../controls";
import { h } from "../dom";
import type { State } from "../state";
import type { Store } from "../store";
import type { Methods } from "../types";

type Choices<K extends keyof Methods> = [Methods[K] & string, string][];

export class MethodPanel {
  readonly element = h("div");
  private readonly controls: Control[] = [];
  private readonly samples: Control;

  constructor(
    private readonly store: Store,
    initial: State,
  ) {
    const pick = <K extends "profile" | "diffusion" | "rule" | "incidence" | "single_scattering">(key: K, label: string, choices: Choices<K>, hint = "") => {
      const control = choice(store, { label, hint, choices, pointer: `/methods/${key}`, get: (state) => state.methods[key] as Methods[K] & string, set: (state, value) => void (state.methods[key] = value) });
      this.controls.push(control);
      return control.element;
    };
    const terms = slider(store, { label: "Gaussians", hint: "Blurred copies of the light that are summed", min: 1, max: 16, limits: [1, 32], pointer: "/methods/terms", get: (state) => state.methods.terms, set: (state, value) => void (state.methods.terms = Math.round(value)), initial: () => initial.methods.terms });
    this.samples = slider(store, { label: "Steps of the march", min: 1, max: 100, log: true, limits: [1, 1000], pointer: "/methods/march_samples", get: (state) => state.methods.march_samples, set: (state, value) => void (state.methods.march_samples = Math.max(1, Math.round(value))), initial: () => initial.methods.march_samples });
    this.controls.push(terms, this.samples);
    this.element.append(
      section(
        "Method",
        pick("diffusion", "Light spreads", [
          ["surface", "over the surface, across seams"],
          ["uv", "in the texture: quicker"],
          ["octree", "summed over an octree: slow"],
          ["poisson", "by Poisson discs (2006)"],
          ["none", "not at all"],
        ]),
        pick("profile", "Profile", [
          ["layered-sp3", "Layered SP3: most accurate"],
          ["layered-diffusion", "Layered diffusion"],
          ["multipole", "Multipole"],
          ["better-dipole", "Better dipole"],
          ["dipole", "Dipole (2001)"],
        ]),
        pick("incidence", "Light arrives", [
          ["diffuse", "from everywhere"],
          ["normal", "straight from above"],
        ]),
        pick("rule", "Layers are taken", [
          ["exit", "where light leaves"],
          ["entry", "where light enters"],
          ["geometric-mean", "at both (reciprocal)"],
        ]),
        terms.element,
        pick("single_scattering", "First bounce", [
          ["none", "in the texture, with the rest"],
          ["exact", "marched for this view, exactly"],
          ["uniform", "marched in even steps (2006)"],
        ], "Marched light depends on the view: it is blended in when the camera rests"),
        this.samples.element,
      ),
    );
    this.sync();
  }

  sync(): void {
    for (const control of this.controls) control.sync();
    this.samples.element.hidden = this.store.state.methods.single_scattering === "none";
  }
}
