// The Object tab: the mesh, how large it is, and what its light is stored in.

import { choice, type Control, section, slider } from "../controls";
import { h, icon, plain } from "../dom";
import { api } from "../api";
import { resized } from "../lights";
import type { State } from "../state";
import type { Store } from "../store";
import { showProblem } from "../toast";
import type { Scene, Showing } from "../types";

const SIZES = [128, 256, 512, 1024, 2048];

export interface ObjectHost {
  showing(): Showing | null;
  openMesh(): void;
  sample(): void;
  /** Scenes that come with the page, and how one is shown. */
  scenes: { name: string; summary: string; show(): void }[];
  name(): string;
  scene(): Scene;
}

export class ObjectPanel {
  readonly element = h("div");
  private readonly facts = h("dl", { class: "facts" });
  private readonly summary = h("p", { class: "note" }, "Whole settings to start from: layers, maps and light.");
  private readonly advice = h("ul", { class: "advice" });
  private readonly controls: Control[];

  constructor(
    private readonly store: Store,
    private readonly host: ObjectHost,
  ) {
    const unit = (state: State) => state.mesh.unit_mm ?? this.host.showing()?.mesh.unit_mm ?? 1;
    const resize = (state: State, value: number) => {
      const ratio = value / unit(state);
      state.mesh.unit_mm = value;
      state.lights = state.lights.map((light) => resized(light, ratio)); // or they would stand within it, or far away
    };
    this.controls = [
      slider(store, { label: "One unit of the file is", hint: "Scattering happens over millimetres: a head modelled in metres needs 1000", unit: "mm", min: 0.01, max: 1000, log: true, limits: [1e-6, 1e6], pointer: "/mesh/unit_mm", get: unit, set: resize }),
      choice(store, {
        label: "Upwards is",
        choices: ["y", "z", "x", "-y", "-z", "-x"].map((axis): [string, string] => [axis, `${axis} in the file`]),
        get: (state) => state.mesh.up ?? "y",
        set: (state, value) => void (state.mesh.up = value),
      }),
    ];
    const stored = [
      choice(store, {
        label: "Light map",
        hint: "More texels show finer shadows and cost time",
        pointer: "/atlas/size",
        choices: SIZES.map((size): [string, string] => [String(size), `${size} × ${size} texels`]),
        get: (state) => String(state.atlas.size),
        set: (state, value) => void (state.atlas.size = Number(value)),
      }),
      choice(store, {
        label: "Laid out",
        choices: [
          ["auto", "by the author, if it serves"],
          ["source", "by the author"],
          ["xatlas", "anew"],
        ],
        get: (state) => state.atlas.uv ?? "auto",
        set: (state, value) => void (state.atlas.uv = value),
      }),
    ];
    this.controls.push(...stored);
    const examine = h("button", { type: "button", onclick: () => this.examine(examine) }, "Examine mesh and texture coordinates");
    this.element.append(
      section("Scenes", h("div", { class: "chips scenes", role: "group", "aria-label": "Scenes to start from" }, ...host.scenes.map((scene) => h("button", { type: "button", class: "chip", title: scene.summary, onclick: () => this.take(scene) }, scene.name))), this.summary),
      section("Mesh", this.facts, h("div", { class: "buttons" }, h("button", { type: "button", onclick: () => host.openMesh() }, icon("open"), "Open a mesh…"), h("button", { type: "button", onclick: () => host.sample() }, "The axolotl")), h("p", { class: "note" }, "Or drop an OBJ, PLY, STL or GLB on the picture. It stays on this machine: nothing is sent elsewhere.")),
      section("Size", this.controls[0].element, this.controls[1].element),
      section("Where light is kept", ...stored.map((control) => control.element)),
      section("Doctor", examine, this.advice),
    );
    this.sync();
  }

  sync(): void {
    for (const control of this.controls) control.sync();
    const select = this.controls[2].element.querySelector("select")!;
    const size = String(this.store.state.atlas.size);
    if (select.value !== size) select.append(h("option", { value: size }, `${size} × ${size} texels`)), (select.value = size);
    const showing = this.host.showing();
    if (!showing) return;
    const [low, high] = showing.mesh.box_mm;
    const rows: [string, string][] = [
      ["Name", this.host.name()],
      ["Triangles", showing.mesh.faces.toLocaleString("en")],
      ["Size", `${[0, 1, 2].map((k) => plain(high[k] - low[k])).join(" × ")} mm`],
      ["Unit", `${plain(showing.mesh.unit_mm)} mm${showing.mesh.unit_assumed ? " (assumed: check the size)" : ""}`],
      ["Charts", `${showing.atlas.charts} (${showing.atlas.origin === "source" ? "the author's" : "made here"})`],
      ["A texel is", `${plain(showing.atlas.texel_mm)} mm`],
    ];
    this.facts.replaceChildren(...rows.flatMap(([name, value]) => [h("dt", null, name), h("dd", null, value)]));
  }

  private take(scene: ObjectHost["scenes"][number]): void {
    scene.show();
    this.summary.textContent = `${scene.name}: ${scene.summary}`;
  }

  private async examine(button: HTMLButtonElement): Promise<void> {
    button.disabled = true;
    try {
      const found = await api.inspect(this.host.scene());
      const said: string[] = found.advice.length ? found.advice : ["Nothing to complain of."];
      this.advice.replaceChildren(...said.map((one) => h("li", null, one)));
    } catch (error) {
      showProblem(error);
    } finally {
      button.disabled = false;
    }
  }
}
