// The object on screen: one draw, redrawn when something changed; no server in the loop.

import {
  type BufferGeometry,
  DoubleSide,
  GLSL3,
  LineSegments,
  Matrix3,
  Mesh,
  PerspectiveCamera,
  PlaneGeometry,
  RawShaderMaterial,
  Scene,
  ShaderMaterial,
  type Texture,
  Vector2,
  Vector3,
  Vector4,
  WebGLRenderer,
  BufferGeometry as Geometry,
  BufferAttribute,
} from "three";
import type { Light, Showing, Tonemap, Triple } from "../types";
import { seams } from "./glb";
import { Orbit, type OrbitEvents, type Pose } from "./orbit";
import { BACKDROP, LIGHTS, LINES, MATRICES, SHOWS, SURFACE, TONEMAPS } from "./shaders";
import { blank } from "./textures";

export type Show = keyof typeof SHOWS;
type MapName = "albedo" | "roughnessMap" | "specularMap" | "normalMap";

export interface ViewerEvents extends OrbitEvents {
  drawn(ms: number): void;
  lost(): void;
  restored(): void;
}

const MM2_PER_M2 = 1e6;
const uniform = <T>(value: T) => ({ value });

export class Viewer {
  readonly renderer: WebGLRenderer;
  readonly camera = new PerspectiveCamera(20, 1, 1, 1000);
  readonly orbit: Orbit;
  private readonly scene = new Scene();
  private readonly tone = {
    exposure: uniform(1),
    tonemap: uniform(0),
    agxIn: uniform(rows(MATRICES.agx)),
    agxOut: uniform(rows(MATRICES.agx).invert()),
    acesIn: uniform(rows(MATRICES.acesIn)),
    acesOut: uniform(rows(MATRICES.acesOut)),
  };
  private readonly sheet = {
    unfold: uniform(0),
    sheetCentre: uniform(new Vector3()),
    sheetRight: uniform(new Vector3(1, 0, 0)),
    sheetUp: uniform(new Vector3(0, 1, 0)),
  };
  readonly uniforms = {
    ...this.tone,
    ...this.sheet,
    show: uniform<number>(SHOWS.picture),
    lightA: uniform<Texture>(blank),
    lightB: uniform<Texture>(blank),
    albedo: uniform<Texture>(blank),
    roughnessMap: uniform<Texture>(blank),
    specularMap: uniform<Texture>(blank),
    normalMap: uniform<Texture>(blank),
    march: uniform<Texture>(blank),
    hasAlbedo: uniform(false),
    hasRoughness: uniform(false),
    hasSpecular: uniform(false),
    hasNormal: uniform(false),
    albedoRoot: uniform(false),
    gloss: uniform(true),
    difference: uniform(false),
    comparing: uniform(false),
    split: uniform(0),
    scaleA: uniform(1),
    scaleB: uniform(1),
    viewport: uniform(new Vector2(1, 1)),
    marched: uniform(0),
    normalY: uniform(1),
    eta: uniform(1.3),
    transmittance: uniform(1),
    roughness: uniform(0.4),
    specular: uniform(1),
    secondLobe: uniform(0),
    range: uniform(new Vector2(0, 1)),
    lightCount: uniform(0),
    lightPlace: uniform(Array.from({ length: LIGHTS }, () => new Vector4())),
    lightPower: uniform(Array.from({ length: LIGHTS }, () => new Vector3())),
    lightCone: uniform(Array.from({ length: LIGHTS }, () => new Vector4(0, 0, 1, -2))),
    ambient: uniform(new Vector3()),
  };
  private readonly backdrop = { ...this.tone, top: uniform(new Vector3()), bottom: uniform(new Vector3()) };
  private readonly surface: Mesh;
  private readonly lines: LineSegments;
  private geometry: BufferGeometry | null = null;
  private dirty = true;
  private lines_of: BufferGeometry | null = null;
  radius = 1;

  constructor(
    readonly canvas: HTMLCanvasElement,
    private readonly frame: HTMLElement,
    private readonly events: ViewerEvents,
  ) {
    this.renderer = new WebGLRenderer({ canvas, antialias: true, powerPreference: "high-performance" });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    const material = new ShaderMaterial({
      glslVersion: GLSL3,
      side: DoubleSide,
      uniforms: this.uniforms,
      vertexShader: SURFACE.vertex,
      fragmentShader: SURFACE.fragment,
    });
    this.surface = new Mesh(new Geometry(), material);
    this.surface.frustumCulled = false;
    this.surface.visible = false;
    const lines = new ShaderMaterial({
      glslVersion: GLSL3,
      uniforms: this.sheet,
      vertexShader: LINES.vertex,
      fragmentShader: LINES.fragment,
    });
    this.lines = new LineSegments(new Geometry(), lines);
    this.lines.frustumCulled = false;
    this.lines.visible = false;
    const back = new RawShaderMaterial({
      glslVersion: GLSL3,
      depthTest: false,
      depthWrite: false,
      uniforms: this.backdrop,
      vertexShader: `precision highp float;\nin vec3 position;\n${BACKDROP.vertex}`,
      fragmentShader: `precision highp float;\nprecision highp int;\n${BACKDROP.fragment}`,
    });
    const behind = new Mesh(new PlaneGeometry(2, 2), back);
    behind.frustumCulled = false;
    behind.renderOrder = -1;
    this.scene.add(behind, this.surface, this.lines);
    this.orbit = new Orbit(this.camera, frame, {
      ...events,
      moved: () => (this.redraw(), events.moved()),
      rested: () => events.rested(),
      light: (yaw, pitch) => events.light(yaw, pitch),
      lightDone: () => events.lightDone(),
    });
    new ResizeObserver(() => this.resize()).observe(frame);
    this.resize();
    canvas.addEventListener("webglcontextlost", (event) => (event.preventDefault(), events.lost()));
    canvas.addEventListener("webglcontextrestored", () => (this.redraw(), events.restored()));
    const loop = () => {
      if (this.dirty) this.draw();
      requestAnimationFrame(loop);
    };
    requestAnimationFrame(loop);
  }

  /** Asks for a new frame. */
  redraw(): void {
    this.dirty = true;
  }

  draw(): void {
    this.dirty = false;
    const start = performance.now();
    this.renderer.render(this.scene, this.camera);
    this.events.drawn(performance.now() - start);
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
    this.radius = geometry.boundingSphere!.radius;
    this.surface.visible = true;
    this.showSeams(this.lines.visible);
    this.redraw();
  }

  get centre(): Vector3 {
    return this.geometry?.boundingSphere?.center ?? new Vector3();
  }

  setPose(pose: Pose): void {
    this.orbit.set(pose, this.radius);
  }

  /** The camera from `direction` that sees the whole object in this window. */
  framing(direction: Triple, fov_y_deg: number): Pose {
    const aim = new Vector3(...direction).normalize();
    const probe = new PerspectiveCamera(fov_y_deg, this.camera.aspect);
    probe.position.copy(aim);
    probe.lookAt(0, 0, 0);
    probe.updateMatrixWorld();
    const half = Math.tan((fov_y_deg * Math.PI) / 360) * 0.88;
    const position = this.geometry!.getAttribute("position");
    const local = new Vector3();
    // a vertex is in view when ±(across - middle) ≤ tangent (ahead + back)
    const axes = [new Vector3(), new Vector3(), new Vector3()];
    probe.matrixWorld.extractBasis(axes[0], axes[1], axes[2]);
    const tangents = [half * this.camera.aspect, half];
    const high = [-Infinity, -Infinity];
    const low = [-Infinity, -Infinity];
    for (let i = 0; i < position.count; i++) {
      local.fromBufferAttribute(position as BufferAttribute, i).sub(this.centre);
      const ahead = -local.dot(axes[2]);
      for (let k = 0; k < 2; k++) {
        const across = local.dot(axes[k]);
        high[k] = Math.max(high[k], across - tangents[k] * ahead);
        low[k] = Math.max(low[k], -across - tangents[k] * ahead);
      }
    }
    const middle = [0, 1].map((k) => (high[k] - low[k]) / 2);
    const back = Math.max(...[0, 1].map((k) => (high[k] + low[k]) / 2 / tangents[k]));
    const target = this.centre.clone().addScaledVector(axes[0], middle[0]).addScaledVector(axes[1], middle[1]);
    const eye = target.clone().addScaledVector(axes[2], back);
    return { position_mm: eye.toArray(), target_mm: target.toArray(), fov_y_deg };
  }

  /** The baked light [W/m²] on one side of the comparison. */
  setLight(side: "A" | "B", texture: Texture): void {
    const slot = side === "A" ? this.uniforms.lightA : this.uniforms.lightB;
    if (slot.value !== texture && slot.value !== blank) slot.value.dispose();
    slot.value = texture;
    (side === "A" ? this.uniforms.scaleA : this.uniforms.scaleB).value = texture.userData.scale ?? 1;
    this.redraw();
  }

  setMap(name: MapName, texture: Texture | null): void {
    const slot = this.uniforms[name];
    if (slot.value !== blank) slot.value.dispose();
    slot.value = texture ?? blank;
    const has = { albedo: "hasAlbedo", roughnessMap: "hasRoughness", specularMap: "hasSpecular", normalMap: "hasNormal" };
    this.uniforms[has[name] as "hasAlbedo"].value = texture !== null;
    this.redraw();
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

  /** The lights that make highlights; those with a size count as points, surroundings as even. */
  setLights(lights: Light[]): void {
    const { lightPlace, lightPower, lightCone, ambient, lightCount } = this.uniforms;
    ambient.value.set(0, 0, 0);
    let count = 0;
    const add = (place: Triple, w: number, power: Triple, factor: number, axis?: Triple, outer_deg = 0) => {
      if (count >= LIGHTS) return;
      lightPlace.value[count].set(...place, w);
      lightPower.value[count].fromArray(power).multiplyScalar(factor);
      const direction = new Vector3(...(axis ?? [0, 0, 1])).normalize();
      const cosine = axis ? Math.cos((outer_deg * Math.PI) / 180) : -2;
      lightCone.value[count].set(direction.x, direction.y, direction.z, cosine);
      count++;
    };
    for (const light of lights) {
      if (light.type === "point") add(light.position_mm, 1, light.intensity_w_per_sr, MM2_PER_M2);
      else if (light.type === "spot")
        add(light.position_mm, 1, light.intensity_w_per_sr, MM2_PER_M2, light.direction, light.outer_deg);
      else if (light.type === "directional") {
        const towards = new Vector3(...light.direction).normalize().toArray();
        add(towards, 0, light.irradiance_w_per_m2, 1);
      } else if (light.type === "sphere") add(light.position_mm, 1, light.radiance, Math.PI * light.radius_mm ** 2);
      else if (light.type === "rectangle") {
        const across = new Vector3(...light.width_mm).cross(new Vector3(...light.height_mm));
        add(light.position_mm, 1, light.radiance, across.length(), across.normalize().toArray(), 89);
      } else if (light.type === "environment" && !light.map) {
        ambient.value.add(new Vector3(...light.radiance));
      }
    }
    lightCount.value = count;
    this.redraw();
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
    if (on && this.geometry && this.lines_of !== this.geometry) {
      const found = seams(this.geometry);
      this.lines.geometry.dispose();
      const geometry = new Geometry();
      geometry.setAttribute("position", new BufferAttribute(found.positions, 3));
      geometry.setAttribute("atlas", new BufferAttribute(found.uv, 2));
      this.lines.geometry = geometry;
      this.lines_of = this.geometry;
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
    this.draw(); // the buffer is only sure to hold the frame in the task that drew it
    return new Promise((done, fail) =>
      this.canvas.toBlob((blob) => (blob ? done(blob) : fail(new Error("no picture"))), "image/png"),
    );
  }

  /** Pixels of the frame as drawn now, RGBA from the bottom up. */
  pixels(): { width: number; height: number; data: Uint8Array } {
    this.draw();
    const gl = this.renderer.getContext();
    const { drawingBufferWidth: width, drawingBufferHeight: height } = gl;
    const data = new Uint8Array(width * height * 4);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, data);
    return { width, height, data };
  }
}

function rows(values: number[]): Matrix3 {
  return new Matrix3().set(...(values as [number, number, number, number, number, number, number, number, number]));
}
