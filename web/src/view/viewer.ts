// The object on screen: one draw, redrawn when something changed; no server in the loop.

import {
  BufferAttribute,
  BufferGeometry,
  DoubleSide,
  GLSL3,
  LineSegments,
  Mesh,
  PerspectiveCamera,
  PlaneGeometry,
  RawShaderMaterial,
  Scene,
  ShaderMaterial,
  type Texture,
  Vector3,
  WebGLRenderer,
} from "three";
import type { Showing, Tonemap, Triple } from "../types";
import { framing } from "./framing";
import { seams } from "./glb";
import { applyLook, type Look, type MapName, newLook, sheetUniforms, surfaceUniforms, toneUniforms } from "./look";
import { Orbit, type OrbitEvents, type Pose } from "./orbit";
import { BACKDROP, LINES, SHOWS, SURFACE, TONEMAPS } from "./shaders";
import { blank } from "./textures";

export type Show = keyof typeof SHOWS;

export interface ViewerEvents extends OrbitEvents {
  lost(): void;
  restored(): void;
}

const MOST_PIXELS_PER_PIXEL = 2;
const SLOW_MS = 40;
const GOAL_MS = 28;
const REST_MS = 160;
const COARSEST = 0.35;

/** Whether there is no graphics card: then drawing every sample of an edge costs too much. */
function software(): boolean {
  const gl = document.createElement("canvas").getContext("webgl2");
  const info = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = gl && info ? String(gl.getParameter(info.UNMASKED_RENDERER_WEBGL)) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(name);
}

export class Viewer {
  readonly renderer: WebGLRenderer;
  readonly camera = new PerspectiveCamera(20, 1, 1, 1000);
  readonly orbit: Orbit;
  /** What is compared: A on the left, B on the right and alone. */
  readonly looks: Record<"A" | "B", Look> = { A: newLook(), B: newLook() };
  private readonly scene = new Scene();
  private readonly tone = toneUniforms();
  private readonly sheet = sheetUniforms();
  readonly uniforms = surfaceUniforms();
  private readonly backdrop = { ...this.tone, top: { value: new Vector3() }, bottom: { value: new Vector3() } };
  private readonly surface: Mesh;
  private readonly lines: LineSegments;
  private geometry: BufferGeometry | null = null;
  private seamsOf: BufferGeometry | null = null;
  private dirty = true;
  private splitAt: number | null = null;
  private sharpness = 1;
  /** Frames drawn so far. */
  frames = 0;

  constructor(
    readonly canvas: HTMLCanvasElement,
    private readonly frame: HTMLElement,
    private readonly events: ViewerEvents,
  ) {
    this.renderer = new WebGLRenderer({ canvas, antialias: !software(), powerPreference: "high-performance" });
    this.sharpen(1);
    const uniforms = { ...this.uniforms, ...this.tone, ...this.sheet };
    const material = { glslVersion: GLSL3, side: DoubleSide, uniforms };
    const shaders = { vertexShader: SURFACE.vertex, fragmentShader: SURFACE.fragment };
    this.surface = new Mesh(new BufferGeometry(), new ShaderMaterial({ ...material, ...shaders }));
    const cuts = { glslVersion: GLSL3, uniforms: this.sheet, vertexShader: LINES.vertex, fragmentShader: LINES.fragment };
    this.lines = new LineSegments(new BufferGeometry(), new ShaderMaterial(cuts));
    const back = new RawShaderMaterial({
      glslVersion: GLSL3,
      depthTest: false,
      depthWrite: false,
      uniforms: this.backdrop,
      vertexShader: `precision highp float;\nin vec3 position;\n${BACKDROP.vertex}`,
      fragmentShader: `precision highp float;\nprecision highp int;\n${BACKDROP.fragment}`,
    });
    const behind = new Mesh(new PlaneGeometry(2, 2), back);
    behind.renderOrder = -1;
    for (const one of [behind, this.surface, this.lines]) one.frustumCulled = false;
    this.surface.visible = this.lines.visible = false;
    this.scene.add(behind, this.surface, this.lines);
    this.orbit = new Orbit(this.camera, frame, {
      ...events,
      moved: () => {
        this.redraw();
        events.moved();
      },
    });
    new ResizeObserver(() => this.resize()).observe(frame);
    this.resize();
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault(); // else it would not come back
      events.lost();
    });
    canvas.addEventListener("webglcontextrestored", () => {
      this.redraw();
      events.restored();
    });
    let before = 0;
    let moved = 0;
    const loop = (now: number) => {
      if (this.dirty) {
        // frames one after the other that take too long are drawn coarser until things rest
        const took = before ? now - before : 0;
        if (took > SLOW_MS && this.sharpness > COARSEST)
          this.sharpen(Math.max(this.sharpness * Math.sqrt(GOAL_MS / took), COARSEST)); // time goes with pixels
        before = moved = now;
        this.draw();
      } else {
        before = 0;
        if (this.sharpness < 1 && now - moved > REST_MS) {
          this.sharpen(1);
          this.draw();
        }
      }
      requestAnimationFrame(loop);
    };
    requestAnimationFrame(loop);
  }

  /** Pixels drawn per pixel of the screen, along an edge, as a share of all. */
  private sharpen(share: number): void {
    this.sharpness = share;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, MOST_PIXELS_PER_PIXEL) * share);
    this.renderer.getDrawingBufferSize(this.uniforms.viewport.value);
  }

  /** Asks for a new frame. */
  redraw(): void {
    this.dirty = true;
  }

  draw(): void {
    this.dirty = false;
    this.frames++;
    const { renderer } = this;
    const side = (look: Look) => {
      applyLook(look, this.uniforms);
      renderer.render(this.scene, this.camera);
    };
    if (this.splitAt === null || this.uniforms.difference.value) {
      this.uniforms.lightA.value = this.looks.A.light;
      this.uniforms.scaleA.value = this.looks.A.scale;
      side(this.looks.B);
      return;
    }
    const { clientWidth: width, clientHeight: height } = this.frame;
    const left = Math.round(width * this.splitAt);
    const { marched } = this.uniforms;
    const blend = marched.value;
    renderer.setScissorTest(true);
    renderer.setScissor(0, 0, left, height);
    marched.value = 0;
    side(this.looks.A);
    renderer.setScissor(left, 0, width - left, height);
    marched.value = blend;
    side(this.looks.B);
    renderer.setScissorTest(false);
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.frame;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.renderer.getDrawingBufferSize(this.uniforms.viewport.value);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.draw(); // at once: a resized canvas is blank until drawn
    this.events.moved();
  }

  setGeometry(geometry: BufferGeometry): void {
    this.geometry?.dispose();
    this.geometry = this.surface.geometry = geometry;
    this.surface.visible = true;
    this.showSeams(this.lines.visible);
    this.redraw();
  }

  get centre(): Vector3 {
    return this.geometry?.boundingSphere?.center ?? new Vector3();
  }

  get radius(): number {
    return this.geometry?.boundingSphere?.radius ?? 1;
  }

  setPose(pose: Pose): void {
    this.orbit.set(pose, this.radius);
  }

  /** The camera from `direction` that sees the whole object in this window. */
  framing(direction: Triple, fov_y_deg: number): Pose | null {
    return this.geometry && framing(this.geometry, direction, fov_y_deg, this.camera.aspect);
  }

  /** The baked light [W/m²] on one side of the comparison. */
  setLight(side: "A" | "B", texture: Texture): void {
    const look = this.looks[side];
    this.discard(look.light, texture);
    look.light = texture;
    look.scale = texture.userData.scale ?? 1;
    this.redraw();
  }

  setMap(name: MapName, texture: Texture | null): void {
    const { A, B } = this.looks;
    if (B.maps[name] && A.maps[name] !== B.maps[name]) B.maps[name].dispose();
    B.maps[name] = texture;
    this.redraw();
  }

  private discard(old: Texture, texture: Texture): void {
    if (old !== texture && old !== blank) old.dispose();
  }

  setOutput(exposure_ev: number, tonemap: Tonemap): void {
    this.tone.exposure.value = 2 ** exposure_ev;
    this.tone.tonemap.value = TONEMAPS[tonemap];
    this.redraw();
  }

  setBackground(background: Showing["background"]): void {
    const pair = Array.isArray(background[0]) ? (background as [Triple, Triple]) : [background, background];
    this.backdrop.top.value.fromArray(pair[0] as Triple);
    this.backdrop.bottom.value.fromArray(pair[1] as Triple);
    this.redraw();
  }

  /** What the surface shows; `range`: the ends of the colours of data. */
  setShow(show: Show, range: [number, number] = [0, 1]): void {
    this.uniforms.show.value = SHOWS[show];
    this.uniforms.range.value.fromArray(range);
    this.redraw();
  }

  /** Where A ends and B begins, 0..1 of the width; null: B alone. */
  setSplit(at: number | null): void {
    this.splitAt = at;
    this.redraw();
  }

  /** |B - A| in place of both; `most`: radiance of the brightest colour. */
  setDifference(on: boolean, most = 1): void {
    this.uniforms.difference.value = on;
    if (on) this.uniforms.range.value.set(0, most);
    this.redraw();
  }

  /** The service's picture of this view, and how much of it is shown. */
  setMarch(texture: Texture): void {
    this.discard(this.uniforms.march.value, texture);
    this.uniforms.march.value = texture;
  }

  setMarched(share: number): void {
    this.uniforms.marched.value = share;
    this.redraw();
  }

  get unfolded(): number {
    return this.sheet.unfold.value;
  }

  /** 0: the object, 1: its surface laid out flat, facing the camera as it stands now. */
  setUnfold(amount: number): void {
    if (this.sheet.unfold.value === 0 && amount > 0) this.faceSheet();
    this.sheet.unfold.value = amount;
    this.redraw();
  }

  private faceSheet(): void {
    const { sheetCentre, sheetRight, sheetUp } = this.sheet;
    const distance = this.camera.position.distanceTo(this.orbit.target);
    const height = 2 * distance * Math.tan((this.camera.fov * Math.PI) / 360);
    const side = 0.92 * height * Math.min(1, this.camera.aspect);
    sheetCentre.value.copy(this.orbit.target);
    sheetRight.value.setFromMatrixColumn(this.camera.matrixWorld, 0).multiplyScalar(side);
    sheetUp.value.setFromMatrixColumn(this.camera.matrixWorld, 1).multiplyScalar(side);
  }

  showSeams(on: boolean): void {
    this.lines.visible = on;
    if (on && this.geometry && this.seamsOf !== this.geometry) {
      const found = seams(this.geometry);
      const geometry = new BufferGeometry();
      geometry.setAttribute("position", new BufferAttribute(found.positions, 3));
      geometry.setAttribute("atlas", new BufferAttribute(found.uv, 2));
      this.lines.geometry.dispose();
      this.lines.geometry = geometry;
      this.seamsOf = this.geometry;
    }
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
    this.sharpen(1);
    this.draw(); // the buffer is only sure to hold the frame in the task that drew it
    return new Promise((done, fail) =>
      this.canvas.toBlob((blob) => (blob ? done(blob) : fail(new Error("no picture"))), "image/png"),
    );
  }

  /** Pixels of the frame as drawn now, RGBA from the bottom up. */
  pixels(): { width: number; height: number; data: Uint8Array } {
    this.sharpen(1);
    this.draw();
    const gl = this.renderer.getContext();
    const { drawingBufferWidth: width, drawingBufferHeight: height } = gl;
    const data = new Uint8Array(width * height * 4);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, data);
    return { width, height, data };
  }
}
