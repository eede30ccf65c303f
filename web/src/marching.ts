// Light that depends on the view: the service's picture of this view, blended in when the camera rests.

import { api } from "./api";
import { toScene, type State } from "./state";
import { showProblem } from "./toast";
import type { Pose } from "./view/orbit";
import { parseNpy } from "./view/npy";
import { fromHalf } from "./view/textures";
import type { Viewer } from "./view/viewer";

const REST_MS = 350;
const FADE_MS = 260;
const PIXELS = 420_000; // of the picture at most

export interface MarchingHost {
  viewer: Viewer;
  state(): State;
  pose(): Pose;
  /** What the surface shows besides is in the way of a picture. */
  allowed(): boolean;
  reducedMotion(): boolean;
  busy(text: string | null): void;
}

export class Marching {
  /** Shows light scattered once and nothing else. */
  alone = false;
  private timer = 0;
  private abort: AbortController | null = null;
  private share = 0;
  private fading = 0;

  constructor(private readonly host: MarchingHost) {}

  get wanted(): boolean {
    return this.host.state().methods.single_scattering !== "none" && this.host.allowed();
  }

  /** Something moved: what was marched is of the past. */
  moved(): void {
    clearTimeout(this.timer);
    this.abort?.abort(new DOMException("stale", "AbortError"));
    this.fade(0);
    if (this.wanted) this.timer = window.setTimeout(() => void this.march(), REST_MS);
  }

  private async march(): Promise<void> {
    const { viewer } = this.host;
    const state = this.host.state();
    const abort = (this.abort = new AbortController());
    const { clientWidth: width, clientHeight: height } = viewer.canvas;
    const scale = Math.min(1, Math.sqrt(PIXELS / (width * height)));
    const resolution = [width, height].map((side) => Math.max(1, Math.round(side * scale)));
    const camera = { ...this.host.pose(), fit: false, resolution, samples: 4 };
    const image = this.alone ? "single" : "picture";
    this.host.busy("marching");
    try {
      const response = await api.image({ ...toScene(state), camera }, image, { signal: abort.signal, accept: "application/x-npy" });
      viewer.setMarch(fromHalf(parseNpy(await response.arrayBuffer())));
      if (!abort.signal.aborted) this.fade(1);
    } catch (error) {
      if ((error as Error).name !== "AbortError") showProblem(error);
    } finally {
      if (this.abort === abort) this.host.busy(null);
    }
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
      this.host.viewer.setMarched(this.share);
      if (t < 1) this.fading = requestAnimationFrame(step);
    };
    step(start);
  }
}
