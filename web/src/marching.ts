// Light that depends on the view: the service's picture of this view, blended in when the camera rests.

import { api, clientName, NPY, Offline, Problem } from "./api";
import { marches, toScene, type State } from "./state";
import { showProblem } from "./toast";
import type { Pose } from "./view/orbit";
import { parseNpy } from "./view/npy";
import { fromHalf } from "./view/textures";
import type { Viewer } from "./view/viewer";

const REST_MS = 350;
const FADE_MS = 260;
const AGAIN_MS = 2000; // after the service was away
const PIXELS = 420_000; // of the picture at most
const DRAFT_PIXELS = 60_000; // while its own numbers are pulled

export interface MarchingHost {
  viewer: Viewer;
  /** What a side shows; null: it is not seen. */
  state(side: "A" | "B"): State | null;
  pose(): Pose;
  /** Nothing that the surface shows besides is in the way of a picture. */
  allowed(): boolean;
  editing(): boolean;
  reducedMotion(): boolean;
  /** What is said of it: how many pixels, how long; `going`: more is on its way. */
  said(text: string, going: boolean): void;
  online(yes: boolean): void;
}

/** The marched light of both sides of a comparison. */
export class Marching {
  private readonly sides: Record<"A" | "B", Side>;
  /** Shows light scattered once and nothing else. */
  alone = false;

  constructor(host: MarchingHost) {
    const alone = () => this.alone;
    const said = () => host.said(this.sides.B.said, this.sides.A.going || this.sides.B.going);
    this.sides = { A: new Side("A", host, alone, said), B: new Side("B", host, alone, said) };
  }

  /** Whether what is seen of a side is marched, or will be. */
  get wanted(): boolean {
    return this.sides.A.wanted || this.sides.B.wanted;
  }

  moved(): void {
    for (const side of [this.sides.B, this.sides.A]) side.moved();
  }

  changed(): void {
    for (const side of [this.sides.B, this.sides.A]) side.changed();
  }
}

class Side {
  /** How many pixels were marched, and how long it took. */
  said = "";
  private timer = 0;
  private abort: AbortController | null = null;
  private share = 0;
  private fading = 0;
  private drafting = false;
  private numbers = ""; // of the march
  private rest = ""; // of what is marched through
  private readonly client = clientName();

  constructor(
    private readonly side: "A" | "B",
    private readonly host: MarchingHost,
    private readonly alone: () => boolean,
    private readonly heard: () => void,
  ) {}

  get going(): boolean {
    return this.abort !== null;
  }

  get wanted(): boolean {
    const state = this.host.state(this.side);
    if (!state) return false;
    const depends = this.alone() || marches(state) || state.methods.diffusion === "parallax";
    return depends && this.host.allowed();
  }

  /** Something moved: what was marched is of the past. */
  moved(): void {
    [this.numbers, this.rest] = this.parts();
    this.stop();
    this.fade(0);
    if (this.wanted && !this.host.editing()) this.timer = window.setTimeout(() => void this.march(), REST_MS);
  }

  /** The state changed. The march's own numbers are followed by drafts; exposure is the page's own. */
  changed(): void {
    const [numbers, rest] = this.parts();
    const [tuned, other] = [numbers !== this.numbers, rest !== this.rest];
    this.numbers = numbers;
    if (other || (tuned && !this.wanted)) this.moved();
    else if (tuned) {
      this.stop();
      void this.draft();
      this.timer = window.setTimeout(() => void this.march(), REST_MS);
    }
  }

  private parts(): [string, string] {
    const shown = this.host.state(this.side);
    if (!shown) return ["", ""];
    const { output: _output, ...state } = shown;
    const { march, march_samples, single_scattering, ...methods } = state.methods;
    return [JSON.stringify([march, march_samples, single_scattering]), JSON.stringify({ ...state, methods })];
  }

  private stop(): void {
    clearTimeout(this.timer);
    this.abort?.abort(new DOMException("stale", "AbortError"));
    this.abort = null;
    this.said = "";
    this.heard();
  }

  /** Coarse pictures, one after the other, until the numbers are those of the last. */
  private async draft(): Promise<void> {
    if (this.drafting) return;
    this.drafting = true;
    try {
      let shown = "";
      while (shown !== this.numbers && this.wanted && !this.abort) {
        shown = this.numbers;
        await this.ask(DRAFT_PIXELS, { samples: 1 }, { client: this.client });
      }
    } catch (error) {
      if (!(error instanceof Problem || error instanceof Offline)) throw error; // the whole picture tells
    } finally {
      this.drafting = false;
    }
  }

  private async march(): Promise<void> {
    const abort = (this.abort = new AbortController());
    const start = performance.now();
    this.said = "marching";
    this.heard();
    try {
      const [width, height] = await this.ask(PIXELS, { samples: 4 }, { signal: abort.signal });
      if (abort.signal.aborted) return;
      this.said = `${width} × ${height} marched in ${((performance.now() - start) / 1000).toFixed(1)} s`;
      this.host.online(true);
      this.fade(1);
    } catch (error) {
      if (error instanceof Offline && !abort.signal.aborted) {
        this.host.online(false);
        this.timer = window.setTimeout(() => void this.march(), AGAIN_MS);
      } else if ((error as Error).name !== "AbortError") showProblem(error);
    } finally {
      if (this.abort === abort) {
        this.abort = null;
        if (this.said === "marching") this.said = "";
        this.heard();
      }
    }
  }

  private async ask(pixels: number, camera: { samples: number }, options: { signal?: AbortSignal; client?: string }): Promise<number[]> {
    const { viewer } = this.host;
    const { clientWidth: width, clientHeight: height } = viewer.canvas;
    const scale = Math.min(1, Math.sqrt(pixels / (width * height)));
    const resolution = [width, height].map((side) => Math.max(1, Math.round(side * scale)));
    const scene = { ...toScene(this.host.state(this.side)!), camera: { ...this.host.pose(), fit: false, resolution, ...camera } };
    const alone = this.alone();
    if (alone && !marches(scene)) scene.methods.single_scattering = "exact";
    const image = alone ? "single" : "picture";
    const response = await api.image(scene, image, { ...options, accept: NPY });
    const values = parseNpy(await response.arrayBuffer());
    if (!options.signal?.aborted) viewer.setMarch(this.side, fromHalf(values));
    return resolution;
  }

  private fade(to: number): void {
    cancelAnimationFrame(this.fading);
    const from = this.share;
    if (from === to) return;
    const duration = this.host.reducedMotion() ? 0 : to > from ? FADE_MS : 90;
    const start = performance.now();
    const step = (now: number) => {
      const t = duration ? Math.min((now - start) / duration, 1) : 1;
      this.share = from + (to - from) * t;
      this.host.viewer.setMarched(this.side, this.share);
      if (t < 1) this.fading = requestAnimationFrame(step);
    };
    step(start);
  }
}
