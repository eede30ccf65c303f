// The object on screen, redrawn when something changed; no server in the loop.

import { type BufferGeometry, PerspectiveCamera, Scene, type Texture, Vector3, WebGLRenderer } from "three";
import type { Showing, Tonemap, Triple } from "../types";
import { Backdrop } from "./backdrop";
import { prepared } from "./context";
import { Cuts } from "./cuts";
import { framing } from "./framing";
import { type Look, type MapName, newLook } from "./look";
import { Orbit, type OrbitEvents, type Pose } from "./orbit";
import { Pace } from "./pace";
import { type Show, Surface } from "./surface";
import { blank, coarsened, mapOf } from "./textures";
import { TONEMAPS, toneUniforms } from "./tone";

export interface ViewerEvents extends OrbitEvents {
  lost(): void;
  restored(): void;
}

const MOST_PIXELS_PER_PIXEL = 2;
const PATIENCE_MS = 1200; // before a mesh is shown that has no light yet

export class Viewer {
  readonly canvas: HTMLCanvasElement;
  readonly renderer: WebGLRenderer;
  readonly camera = new PerspectiveCamera(20, 1, 1, 1000);
  readonly orbit: Orbit;
  /** What is compared: A on the left, B on the right and alone. */
  readonly looks: Record<"A" | "B", Look> = { A: newLook(), B: newLook() };
  private readonly scene = new Scene();
  private readonly tone = toneUniforms();
  private readonly surface = new Surface(this.tone);
  private readonly backdrop = new Backdrop(this.tone);
  private readonly cuts = new Cuts(this.surface.sheet);
  private readonly pace: Pace;
  private readonly calls: Partial<Record<`${"A" | "B"} ${MapName}`, number>> = {};
  private splitAt: number | null = null;
  private bare = 0; // the timer of a mesh that has no light yet
  private share = 0; // of the pixels along an edge, in the buffers as they are

  constructor(
    given: HTMLCanvasElement,
    private readonly frame: HTMLElement,
    events: ViewerEvents,
  ) {
    const { canvas, context, slow } = prepared(given);
    this.canvas = canvas;
    this.renderer = new WebGLRenderer({ canvas, context });
    this.scene.add(this.backdrop.mesh, this.surface.mesh, this.cuts.lines);
    this.pace = new Pace(
      slow,
      (quickly) => this.draw(quickly),
      () => this.prepare(),
    );
    this.orbit = new Orbit(this.camera, frame, {
      ...events,
      moved: () => {
        this.redraw(true);
        events.moved();
      },
    });
    const resize = () => {
      const { clientWidth: width, clientHeight: height } = this.frame;
      if (!width || !height) return;
      this.sharpen(1, true);
      if (this.reframe(width / height)) events.rested();
      this.draw(false); // at once: a resized canvas is blank until drawn
      events.moved();
    };
    new ResizeObserver(resize).observe(frame);
    resize();
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault(); // else it would not come back
      events.lost();
    });
    canvas.addEventListener("webglcontextrestored", () => {
      this.surface.forget();
      this.redraw();
      events.restored();
    });
  }

  /** Uniforms that all materials of the surface share. */
  get uniforms(): Surface["uniforms"] {
    return this.surface.uniforms;
  }

  /** Draws this share of the pixels along an edge. */
  private sharpen(share: number, anew = false): void {
    if (share === this.share && !anew) return;
    this.share = share;
    const { clientWidth: width, clientHeight: height } = this.frame;
    this.renderer.setDrawingBufferSize(width, height, Math.min(devicePixelRatio, MOST_PIXELS_PER_PIXEL) * share);
    this.renderer.getDrawingBufferSize(this.uniforms.viewport.value);
  }

  /** Asks for a new frame; `moving`: more will follow. */
  redraw(moving = false): void {
    this.pace.ask(moving);
  }

  /** Draws now. `quickly`: with fewer pixels and triangles, where there is no time. */
  draw(quickly = false): void {
    const { renderer, surface } = this;
    this.sharpen(quickly ? this.pace.share : 1);
    this.backdrop.quick.value = quickly;
    const side = (name: "A" | "B") => {
      surface.dress(renderer, this.camera, name, this.looks, quickly);
      renderer.render(this.scene, this.camera);
    };
    if (this.splitAt === null || surface.difference) {
      side("B");
      return;
    }
    const { clientWidth: width, clientHeight: height } = this.frame;
    const left = Math.round(width * this.splitAt);
    const only = (x: number, wide: number) => renderer.setScissor(x, 0, wide, height);
    renderer.setScissorTest(true);
    only(0, left);
    side("A");
    only(left, width - left);
    side("B");
    renderer.setScissorTest(false);
  }

  /** Makes ready for movement, where frames take long; to be called when nothing is more urgent. */
  prepare(): void {
    if (this.pace.slow) this.surface.prepare(() => this.redraw());
  }

  setGeometry(geometry: BufferGeometry): void {
    this.surface.setGeometry(geometry);
    clearTimeout(this.bare);
    this.bare = window.setTimeout(() => this.surface.reveal() && this.redraw(), PATIENCE_MS);
    this.orbit.reach(this.radius);
    this.showSeams(this.cuts.lines.visible);
  }

  get centre(): Vector3 {
    return this.surface.geometry?.boundingSphere?.center ?? new Vector3();
  }

  get radius(): number {
    return this.surface.geometry?.boundingSphere?.radius ?? 1;
  }

  setPose(pose: Pose): void {
    this.orbit.set(pose, this.radius);
    if (this.unfolded > 0) this.faceSheet();
  }

  /** The camera from `direction` that sees the whole object in this window. */
  framing(direction: Triple, fov_y_deg: number): Pose | null {
    const { geometry } = this.surface;
    return geometry && framing(geometry, direction, fov_y_deg, this.camera.aspect);
  }

  /** Follows a window of another shape, as when a phone is turned: what was in view stays so. Whether the camera moved. */
  private reframe(aspect: number): boolean {
    const { camera, orbit, surface } = this;
    const direction = camera.position.clone().sub(orbit.target);
    const fitting = () => surface.geometry && framing(surface.geometry, direction.toArray(), camera.fov, camera.aspect);
    const before = aspect === camera.aspect ? null : fitting();
    camera.aspect = aspect;
    camera.updateProjectionMatrix();
    const after = before && fitting();
    if (!before || !after) return false;
    const [was, is] = [before, after].map((pose) => pose.target_mm.map((from, k) => pose.position_mm[k] - from));
    const target = orbit.target.toArray().map((at, k) => at + after.target_mm[k] - before.target_mm[k]) as Triple;
    const factor = Math.hypot(...is) / Math.hypot(...was);
    const position = direction.toArray().map((away, k) => target[k] + factor * away) as Triple;
    this.setPose({ position_mm: position, target_mm: target, fov_y_deg: camera.fov });
    return true;
  }

  /** The baked light [W/m²] on one side of the comparison. */
  setLight(side: "A" | "B", texture: Texture): void {
    const look = this.looks[side];
    discard(look.light, texture);
    if (this.pace.slow) coarsened(texture);
    look.light = texture;
    look.scale = texture.userData.scale ?? 1;
    // the first picture quickly where that helps, the whole right after
    this.redraw(side === "B" && this.surface.light());
  }

  /** Makes a coded image, or none, ready as a map of the surface; the answer puts it on, of two calls the later's. */
  async setMap(side: "A" | "B", name: MapName, coded: Blob | null, srgb: boolean): Promise<() => void> {
    const call = this.count(side, name);
    const texture = coded && (await mapOf(coded, srgb, this.pace.slow));
    return () => (call === this.calls[`${side} ${name}`] ? this.wear(side, name, texture) : texture?.dispose());
  }

  /** A wears a map of B. */
  shareMap(name: MapName): void {
    this.count("A", name);
    this.wear("A", name, this.looks.B.maps[name]);
  }

  private count(side: "A" | "B", name: MapName): number {
    const call = `${side} ${name}` as const;
    return (this.calls[call] = (this.calls[call] ?? 0) + 1);
  }

  private wear(side: "A" | "B", name: MapName, texture: Texture | null): void {
    const maps = this.looks[side].maps;
    const before = maps[name];
    maps[name] = texture;
    const { A, B } = this.looks;
    if (before && before !== A.maps[name] && before !== B.maps[name]) before.dispose();
    this.redraw();
  }

  setOutput(exposure_ev: number, tonemap: Tonemap): void {
    this.tone.exposure.value = 2 ** exposure_ev;
    this.surface.tonemap = TONEMAPS[tonemap];
    this.backdrop.setTonemap(tonemap);
    this.redraw();
  }

  setBackground(background: Showing["background"]): void {
    this.backdrop.setLight(background);
    this.redraw();
  }

  /** What the surface shows; `range`: the ends of the colours of data. */
  setShow(show: Show, range: [number, number] = [0, 1]): void {
    this.surface.show = show;
    this.uniforms.range.value.fromArray(range);
    this.redraw();
  }

  /** How much of its light the picture shows. */
  setDim(share: number): void {
    this.uniforms.dim.value = share;
    this.redraw();
  }

  /** Where A ends and B begins, 0..1 of the width; null: B alone. */
  setSplit(at: number | null): void {
    this.splitAt = at;
    this.redraw(true);
  }

  /** |B - A| in place of both; `most`: radiance of the brightest colour. */
  setDifference(on: boolean, most = 1): void {
    this.surface.difference = on;
    if (on) this.uniforms.range.value.set(0, most);
    this.redraw();
  }

  /** The service's picture of this view, and how much of it is shown. */
  setMarch(side: "A" | "B", texture: Texture): void {
    discard(this.looks[side].march, texture);
    this.looks[side].march = texture;
    this.redraw();
  }

  setMarched(side: "A" | "B", share: number): void {
    this.looks[side].marched = share;
    this.redraw();
  }

  get unfolded(): number {
    return this.surface.sheet.unfold.value;
  }

  /** 0: the object, 1: its surface laid out flat, facing the camera as it stands now. */
  setUnfold(amount: number): void {
    if (this.unfolded === 0 && amount > 0) this.faceSheet();
    this.surface.sheet.unfold.value = amount;
    this.redraw(true);
  }

  private faceSheet(): void {
    const { sheetCentre, sheetRight, sheetUp } = this.surface.sheet;
    const distance = this.camera.position.distanceTo(this.orbit.target);
    const height = 2 * distance * Math.tan((this.camera.fov * Math.PI) / 360);
    const side = 0.92 * height * Math.min(1, this.camera.aspect);
    sheetCentre.value.copy(this.orbit.target);
    sheetRight.value.setFromMatrixColumn(this.camera.matrixWorld, 0).multiplyScalar(side);
    sheetUp.value.setFromMatrixColumn(this.camera.matrixWorld, 1).multiplyScalar(side);
  }

  showSeams(on: boolean): void {
    this.cuts.show(on, this.surface.geometry);
    this.redraw();
  }

  /** Where a point [mm] is on screen [CSS pixels], and whether it lies in front of the object's centre. */
  project(point: Vector3): { x: number; y: number; front: boolean } {
    const toEye = this.camera.position.clone().sub(this.centre);
    const front = point.clone().sub(this.centre).dot(toEye) > 0;
    const seen = point.clone().project(this.camera);
    const { clientWidth: width, clientHeight: height } = this.frame;
    return { x: ((seen.x + 1) / 2) * width, y: ((1 - seen.y) / 2) * height, front };
  }

  /** The frame on screen as a PNG. */
  async screenshot(): Promise<Blob> {
    this.draw(); // the buffer is only sure to hold the frame in the task that drew it
    return new Promise((done, fail) =>
      this.canvas.toBlob((blob) => (blob ? done(blob) : fail(new Error("no picture"))), "image/png"),
    );
  }

  /** Pixels of the frame as drawn now, RGBA from the bottom up. */
  pixels(quickly = false): { width: number; height: number; data: Uint8Array } {
    this.draw(quickly);
    const gl = this.renderer.getContext();
    const { drawingBufferWidth: width, drawingBufferHeight: height } = gl;
    const data = new Uint8Array(width * height * 4);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, data);
    return { width, height, data };
  }
}

function discard(old: Texture, texture: Texture): void {
  if (old !== texture && old !== blank) old.dispose();
}
