// Look inside: what lies between the light and the picture, shown on the object or laid out flat.

import { section } from "../controls";
import { h, icon, plain } from "../dom";
import type { State } from "../state";
import type { Showing } from "../types";
import type { Show } from "../view/surface";
import type { Viewer } from "../view/viewer";
import type { HalfImage } from "../view/npy";
import { rangeOf } from "../view/npy";

interface Stop {
  key: string;
  name: string;
  what: string;
  show: Show;
  unit: string;
  /** The image of the service; N stands for the number of a Gaussian or layer. */
  image: string;
  of?: "gaussian" | "layer";
}

const STOPS: Stop[] = [
  { key: "picture", name: "The picture", what: "Everything together, with highlights.", show: "picture", unit: "", image: "diffused" },
  { key: "irradiance", name: "1 Light that enters", what: "Light from the lamps, with shadows, as it passes the surface: hard edges.", show: "light", unit: "W/m²", image: "irradiance" },
  { key: "gaussian", name: "2 … spread out", what: "The same light blurred by one Gaussian. All materials share these copies.", show: "light", unit: "W/m²", image: "gaussian-N", of: "gaussian" },
  { key: "weight", name: "3 … weighed", what: "How much of that copy the material takes: from its layers, per colour (green shown).", show: "data", unit: "", image: "weight-N", of: "gaussian" },
  { key: "exitance", name: "4 Light that leaves", what: "The weighed sum of all copies, times the colour map.", show: "light", unit: "W/m²", image: "exitance" },
  { key: "single", name: "First bounce alone", what: "Light scattered once and no more, marched through the layers for this view each time it rests. “First bounce” below says whether the picture has it from here.", show: "picture", unit: "", image: "diffused" },
  { key: "thickness", name: "Thickness of a layer", what: "As given or painted [mm].", show: "data", unit: "mm", image: "thickness-N", of: "layer" },
  { key: "texel-mm", name: "Texel size", what: "Edge of a texel on the surface: large ones blur what light does.", show: "data", unit: "mm", image: "texel-mm" },
  { key: "normal", name: "Normals", what: "Where the surface faces: red right, green up, blue front.", show: "direction", unit: "", image: "normal" },
  { key: "position", name: "Positions", what: "Where each texel lies in space.", show: "direction", unit: "mm", image: "position" },
];

const WAITING = 0.15; // of the picture's light, where another is on its way

export interface InsideHost {
  viewer: Viewer;
  state(): State;
  showing(): Showing | null;
  look(image: string): void;
  single(on: boolean): void;
  reducedMotion(): boolean;
  moved(): void;
  changed(): void;
}

export class InsidePanel {
  readonly element: HTMLElement;
  /** The key of colours, over the picture. */
  readonly legend = h("div", { class: "legend", hidden: true });
  private readonly select: HTMLSelectElement;
  private readonly what = h("p", { class: "note" });
  private readonly number = h("input", { type: "range", min: 1, max: 8, step: 1 });
  private readonly numberSaid = h("output");
  private readonly numberLabel: HTMLElement;
  private readonly numberRow: HTMLElement;
  private readonly flat: HTMLButtonElement;
  private readonly seams: HTMLButtonElement;
  private stop = STOPS[0];
  private asked = 1; // which copy or layer

  constructor(private readonly host: InsideHost) {
    this.select = h("select", { id: "inside", onchange: () => this.choose(this.select.value) }, ...STOPS.map((stop) => h("option", { value: stop.key }, stop.name)));
    this.number.id = "inside-number";
    this.number.addEventListener("input", () => this.ask());
    this.numberLabel = h("label", { for: "inside-number" });
    this.numberRow = h("div", { class: "control slider" }, h("div", { class: "head" }, this.numberLabel, this.numberSaid), this.number);
    this.flat = h("button", { type: "button", "aria-pressed": "false", onclick: () => this.unfold(this.flat.getAttribute("aria-pressed") !== "true", this.host.reducedMotion()) }, icon("unfold"), "Lay flat");
    this.seams = h("button", { type: "button", "aria-pressed": "false", onclick: () => this.showSeams(this.seams.getAttribute("aria-pressed") !== "true") }, "Show seams");
    this.element = section(
      "Look inside",
      h("div", { class: "control row" }, h("label", { for: "inside" }, "Show"), this.select),
      this.what,
      this.numberRow,
      h("div", { class: "buttons" }, this.flat, this.seams),
    );
    this.sync();
  }

  get key(): string {
    return this.stop.key;
  }

  get chosenNumber(): number {
    return this.number.valueAsNumber;
  }

  choose(key: string, number = 1): void {
    this.stop = STOPS.find((stop) => stop.key === key) ?? STOPS[0];
    this.select.value = this.stop.key;
    this.number.value = String(number);
    this.sync();
    this.number.value = String(number); // once its range is known
    this.ask();
  }

  /** Colours follow the values that came. */
  values(image: HalfImage | null): void {
    if (!image || this.stop.show === "picture") return;
    const { low, high } = rangeOf(image);
    if (this.stop.show !== "light") this.host.viewer.setShow(this.stop.show, [low, high]);
    this.legend.hidden = false;
    const bar = h("span", { class: `bar ${this.stop.show}` });
    const title = this.stop.of ? `${this.stop.name}, ${this.numberSaid.value}` : this.stop.name;
    const layer = this.host.state().layers.filter((one) => !one.muted)[this.number.valueAsNumber - 1];
    const endless = this.stop.of === "layer" && layer?.thickness_mm === null && !layer.thickness_map;
    if (endless) this.legend.replaceChildren(h("strong", null, title), h("p", null, "goes on without end, as deep as the object"));
    else if (this.stop.show === "light") this.legend.replaceChildren(h("strong", null, title), h("p", null, `${plain(low)} to ${plain(high)} ${this.stop.unit}, by exposure and tone map as in the picture`));
    else this.legend.replaceChildren(h("strong", null, title), bar, h("span", { class: "ends" }, h("span", null, plain(low)), h("span", null, this.stop.unit), h("span", null, plain(high))));
  }

  sync(): void {
    const { of } = this.stop;
    this.what.textContent = this.stop.what;
    this.numberRow.hidden = !of;
    this.numberLabel.textContent = of === "layer" ? "Which layer" : "Which copy";
    const layers = this.host.state().layers.filter((layer) => !layer.muted).length;
    this.number.max = String(of === "layer" ? layers : this.host.state().methods.terms);
    const k = this.number.valueAsNumber;
    if (of && this.asked > k) return this.ask(); // that one is gone
    const variance = this.host.showing()?.variances_mm2[k - 1];
    this.numberSaid.value = of === "layer" ? `layer ${k}` : variance === undefined ? `${k}` : variance === 0 ? "not blurred" : `σ ${plain(Math.sqrt(variance))} mm`;
  }

  private ask(): void {
    this.asked = this.number.valueAsNumber;
    this.sync();
    const { stop } = this;
    this.legend.hidden = stop.key !== "single";
    if (stop.key === "single") this.legend.replaceChildren(h("strong", null, stop.name), h("p", null, "Radiance [W/(m² sr)], by exposure and tone map as in the picture; dim until it is marched"));
    this.host.viewer.setShow(stop.show);
    this.host.viewer.setDim(stop.key === "single" ? WAITING : 1);
    this.host.single(stop.key === "single");
    this.host.look(stop.image.replace("N", this.number.value));
  }

  /** How the surface lies, as a link keeps it. */
  get laid(): { flat: boolean; seams: boolean } {
    const on = (button: HTMLButtonElement) => button.getAttribute("aria-pressed") === "true";
    return { flat: on(this.flat), seams: on(this.seams) };
  }

  lay({ flat = false, seams = false }: { flat?: boolean; seams?: boolean }): void {
    if (flat) this.unfold(true, true);
    if (seams) this.showSeams(true);
  }

  private showSeams(on: boolean): void {
    this.seams.setAttribute("aria-pressed", String(on));
    this.host.viewer.showSeams(on);
    this.host.changed();
  }

  private unfold(on: boolean, atOnce: boolean): void {
    this.flat.setAttribute("aria-pressed", String(on));
    this.host.changed();
    const { viewer } = this.host;
    if (atOnce) {
      viewer.setUnfold(on ? 1 : 0);
      this.host.moved();
      return;
    }
    const from = viewer.unfolded;
    const start = performance.now();
    const step = (now: number) => {
      const t = Math.min((now - start) / 900, 1);
      const eased = t * t * (3 - 2 * t);
      viewer.setUnfold(from + ((on ? 1 : 0) - from) * eased);
      this.host.moved();
      if (t < 1 && (this.flat.getAttribute("aria-pressed") === "true") === on) requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }
}
