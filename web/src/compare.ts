// A | B: the scene beside another setting or method, by a divider that mouse and keys move; their difference.

import { api, NPY } from "./api";
import { h, iconButton, plain } from "./dom";
import { Live, placeOf } from "./live";
import { bakedPart, shownMaps } from "./parts";
import { type State, toScene } from "./state";
import type { Light, Showing } from "./types";
import { dressLook } from "./view/look";
import { half, type HalfImage, parseNpy } from "./view/npy";
import type { Viewer } from "./view/viewer";

interface Other {
  key: string;
  name: string;
  short: string;
  make(state: State, pinned: State | null): State;
}

const method = (change: Partial<State["methods"]>) => (state: State): State => ({ ...state, methods: { ...state.methods, ...change } });

const OTHERS: Other[] = [
  { key: "none", name: "Light that does not spread", short: "No scattering", make: method({ diffusion: "none" }) },
  { key: "pinned", name: "The setting as it is now (pin)", short: "Pinned", make: (state, pinned) => pinned ?? state },
  { key: "uv", name: "Spread in the texture (seams show)", short: "In the texture", make: method({ diffusion: "uv" }) },
  { key: "dipole", name: "The dipole of 2001", short: "Dipole", make: method({ profile: "dipole" }) },
  { key: "multipole", name: "Multipole", short: "Multipole", make: method({ profile: "multipole" }) },
  { key: "layered-diffusion", name: "Layered diffusion", short: "Layered diffusion", make: method({ profile: "layered-diffusion" }) },
];

export interface CompareHost {
  viewer: Viewer;
  state(): State;
  live: Live;
  showing(): Showing | null;
  lights(state: State, showing: Showing | null): Light[];
  problem(error: unknown): Promise<boolean>;
  announce(text: string): void;
  /** Whether what is seen is marched for the view: not, in part, or nothing else. */
  marched(): "no" | "also" | "alone";
  changed(): void;
}

export class Compare {
  readonly button: HTMLButtonElement;
  readonly overlay: HTMLElement;
  private readonly line = h("div", { class: "divider", "aria-hidden": "true" });
  private readonly range = h("input", { type: "range", min: 0, max: 100, step: 1, value: 50, "aria-label": "Where A ends and B begins, in percent of the picture" });
  private readonly select: HTMLSelectElement;
  private readonly labels = { A: h("span", { class: "side a" }), B: h("span", { class: "side b" }, "B · Now") };
  private readonly modeButton: HTMLButtonElement;
  private readonly rmse = h("output", { class: "rmse" });
  private readonly legend = h("div", { class: "legend", hidden: true });
  private readonly liveA: Live;
  private pinned: State | null = null;
  private placed: Showing | null = null; // where its lights stand
  private placing = false;
  private readonly left = new WeakMap<HalfImage, Promise<HalfImage>>(); // light times the colour map, of light before it
  private coverage: { key: string; image: HalfImage } | null = null;
  private difference = false;
  private marched = "no"; // when it was measured
  on = false;

  constructor(private readonly host: CompareHost) {
    this.liveA = new Live({
      light: (texture) => host.viewer.setLight("A", texture),
      map: (kind, coded, srgb) => host.viewer.setMap("A", kind, coded, srgb),
      lent: async (kind, key) => {
        const same = await host.live.wears(kind, key);
        if (same) host.viewer.shareMap(kind);
        return same;
      },
      settled: () => void this.measure(),
      problem: async (error) => (await host.problem(error)) && this.liveA.again(),
    });
    this.button = iconButton("compare", "Compare A | B", () => this.toggle(), "C");
    this.button.setAttribute("aria-pressed", "false");
    this.select = h("select", { "aria-label": "A is", onchange: () => this.choose(this.select.value) }, ...OTHERS.map((other) => h("option", { value: other.key }, other.name)));
    this.modeButton = h("button", { type: "button", "aria-pressed": "false", onclick: () => this.setDifference(!this.difference) }, "Difference");
    this.range.addEventListener("input", () => this.place());
    const bar = h("div", { class: "compare-bar" }, h("span", null, "A is"), this.select, this.range, this.modeButton, this.rmse);
    this.overlay = h("div", { class: "compare", hidden: true }, this.line, this.labels.A, this.labels.B, this.legend, bar);
    let held = false;
    this.line.addEventListener("pointerdown", (event) => {
      held = true;
      this.line.setPointerCapture(event.pointerId);
      event.stopPropagation();
    });
    this.line.addEventListener("pointermove", (event) => {
      if (!held) return;
      const box = this.overlay.getBoundingClientRect();
      this.range.value = String(Math.round((100 * (event.clientX - box.left)) / box.width));
      this.place();
    });
    for (const end of ["pointerup", "pointercancel"] as const) this.line.addEventListener(end, () => (held = false));
  }

  /** What a link keeps. */
  get shared(): { other: string; at: number; pinned: State | null; difference: boolean } | null {
    const { pinned, difference } = this;
    return this.on ? { other: this.select.value, at: this.range.valueAsNumber, pinned, difference } : null;
  }

  restore(shared: NonNullable<Compare["shared"]>): void {
    this.pinned = shared.pinned;
    this.range.value = String(shared.at);
    this.select.value = shared.other;
    this.toggle(true);
    this.setDifference(shared.difference);
  }

  toggle(on = !this.on): void {
    this.on = on;
    this.button.setAttribute("aria-pressed", String(on));
    this.overlay.hidden = !on;
    if (on) this.choose(this.select.value, true);
    else {
      this.setDifference(false);
      this.host.viewer.setSplit(null);
    }
    this.host.changed();
  }

  choose(key: string, keep = false): void {
    this.select.value = key;
    if (key === "pinned" && !(keep && this.pinned)) {
      this.pinned = structuredClone(this.host.state());
      this.host.announce("Pinned as A. Change anything: B is how it is now.");
    }
    this.labels.A.textContent = `A · ${this.other.short}`;
    this.sync();
    this.place();
    this.host.changed();
  }

  private get other(): Other {
    return OTHERS.find((one) => one.key === this.select.value) ?? OTHERS[0];
  }

  /** What A shows; null: it is not seen. */
  get shown(): State | null {
    if (!this.on) return null;
    const now = this.host.state();
    // on another mesh or light map a pinned setting has nowhere to lie
    return { ...this.other.make(now, this.pinned), mesh: now.mesh, atlas: now.atlas };
  }

  /** Follows the scene. `moving` as in `Live.want`. */
  sync(moving = false): void {
    const a = this.shown;
    if (!a) return;
    const { viewer } = this.host;
    const showing = this.showingOf(a, this.host.state());
    dressLook(viewer.looks.A, a, showing, this.host.lights(a, showing));
    this.modeButton.disabled = this.host.live.image !== "diffused" || this.host.marched() === "alone"; // else its colours are those of data
    if (this.modeButton.disabled && this.difference) this.setDifference(false);
    if (this.liveA.image !== this.host.live.image) this.liveA.look(this.host.live.image);
    this.liveA.want(a, moving);
    if (!this.comparable || this.host.marched() !== this.marched) void this.measure();
    viewer.redraw();
  }

  /** What the service says of A's surface and lights; that of B, until it has come. */
  private showingOf(a: State, now: State): Showing | null {
    const scene = bakedPart(toScene(a));
    const place = placeOf(scene);
    const theirs = this.host.showing();
    if (theirs?.place === place) this.placed = theirs;
    if (this.placed?.place === place) return this.placed;
    if (place !== placeOf(bakedPart(toScene(now))) && !this.placing) {
      this.placing = true;
      const heard = (showing: Showing) => {
        this.placed = { ...showing, asked: scene.lights, place };
        this.placing = false;
        this.sync(); // by now it may be of the past
      };
      api.showing(scene).then(heard, () => (this.placing = false)); // the light's own request tells why
    }
    return theirs;
  }

  private place(): void {
    const at = this.range.valueAsNumber / 100;
    this.range.setAttribute("aria-valuetext", `${this.range.value} percent`);
    this.overlay.style.setProperty("--at", `${100 * at}%`);
    this.host.viewer.setSplit(at);
    this.host.changed();
  }

  private setDifference(on: boolean): void {
    this.difference = on;
    this.modeButton.setAttribute("aria-pressed", String(on));
    this.overlay.classList.toggle("is-difference", on);
    if (!on) this.host.viewer.setDifference(false);
    this.legend.hidden = true;
    void this.measure();
    this.host.changed();
  }

  /** Whether the light of both sides is all there. */
  private get comparable(): boolean {
    return this.host.marched() !== "alone" && this.liveA.values !== null && this.host.live.values !== null;
  }

  /** Root of the mean square difference of what leaves the surface, relative to its mean. */
  async measure(): Promise<void> {
    const a = this.shown;
    if (!a) return;
    this.rmse.value = "";
    this.rmse.title = "";
    this.legend.hidden = true; // until its numbers are known
    const marched = (this.marched = this.host.marched());
    if (marched === "alone") {
      this.rmse.value = "no RMSE";
      this.rmse.title = "What is marched for this view alone is not held against each other by numbers";
    }
    const [valuesA, valuesB] = [this.liveA.values, this.host.live.values];
    if (!this.comparable || !valuesA || !valuesB) return;
    const both = [this.leaving(a, valuesA), this.leaving(this.host.state(), valuesB)];
    const found = await Promise.all([...both, this.covered(valuesB.width).catch(() => null)]).catch(() => null);
    if (valuesA !== this.liveA.values || valuesB !== this.host.live.values || !this.comparable) return; // of the past
    const [of, to, covered] = found ?? [];
    if (!of || !to || of.data.length !== to.data.length) return void (this.rmse.value = "no RMSE");
    const { relative, most } = apart(of, to, covered ?? null);
    const light = this.host.live.image === "diffused";
    this.rmse.value = `RMSE ${plain(100 * relative)} %${marched === "also" ? " unmarched" : ""}`;
    const what = light ? `Of the light that leaves${marched === "also" ? ", without what is marched for the view" : ""}` : "Of what is shown";
    this.rmse.title = `${what}, over all texels, relative to the mean of B`;
    const brightest = Math.max(most / Math.PI / 2, 1e-6); // the few places beyond would leave the rest dark
    this.host.viewer.setDifference(this.difference, brightest);
    const ends = h("span", { class: "ends" }, h("span", null, "0"), h("span", null, "W/(m² sr)"), h("span", null, `${plain(brightest)} and more`));
    this.legend.replaceChildren(h("strong", null, "Difference of A and B"), h("span", { class: "bar" }), ends);
    this.legend.hidden = !this.difference;
  }

  /** Light times the colour map, where that is applied after it has spread. */
  private leaving(state: State, values: HalfImage): Promise<HalfImage> | HalfImage {
    const scene = toScene(state);
    if (this.host.live.image !== "diffused" || !shownMaps(scene).albedo) return values;
    const known = this.left.get(values);
    if (known) return known;
    const asked = api.image(bakedPart(scene), "exitance", { accept: NPY }).then(async (response) => parseNpy(await response.arrayBuffer()));
    this.left.set(values, asked);
    asked.catch(() => this.left.delete(values)); // to be asked for again
    return asked;
  }

  private async covered(size: number): Promise<HalfImage> {
    const { mesh, atlas } = bakedPart(toScene(this.host.state()));
    const key = JSON.stringify([mesh, atlas, size]);
    if (this.coverage?.key !== key) {
      const response = await api.image({ mesh, atlas: { ...atlas, raster: size } }, "coverage", { accept: NPY });
      this.coverage = { key, image: parseNpy(await response.arrayBuffer()) };
    }
    return this.coverage.image;
  }
}


/** Root of the mean square difference relative to the mean of B, and the greatest difference. */
function apart(a: HalfImage, b: HalfImage, covered: HalfImage | null): { relative: number; most: number } {
  let square = 0;
  let sum = 0;
  let count = 0;
  let most = 0;
  for (let i = 0, at = 0; i < b.width * b.height; i++) {
    for (let k = 0; k < b.channels; k++, at++) {
      if (covered && half(covered.data[i]) < 0.5) continue;
      const value = half(b.data[at]);
      const off = Math.abs(value - half(a.data[at]));
      square += off * off;
      sum += value;
      count++;
      if (off > most) most = off;
    }
  }
  return { relative: Math.sqrt(square / Math.max(count, 1)) / Math.max(sum / Math.max(count, 1), 1e-12), most };
}
