// The object's surface: its mesh, and a material for what is asked of it.

import { BufferGeometry, type Camera, DoubleSide, GLSL3, Mesh, ShaderMaterial, type WebGLRenderer } from "three";
import { Gloss } from "./gloss";
import { applyLook, applyOther, type Look, lookDefines, sheetUniforms, surfaceUniforms } from "./look";
import { Quick } from "./quick";
import { FRAGMENT, SHOWS, VERTEX } from "./shaders";
import { Shadows } from "./shadows";
import type { toneUniforms } from "./tone";

export type Show = keyof typeof SHOWS;

export class Surface {
  readonly sheet = sheetUniforms();
  readonly uniforms = surfaceUniforms();
  readonly mesh = new Mesh();
  geometry: BufferGeometry | null = null;
  show: Show = "picture";
  difference = false;
  tonemap = 0;
  /** What stands in for the object in quick frames, once it is made. */
  quick: Quick | null = null;
  private lit = false;
  private making: { cancel(): void } | null = null;
  private gloss: Gloss | null = null; // of the object itself, until it has a stand-in
  private readonly shadows = { A: new Shadows(), B: new Shadows() };
  private readonly materials = new Map<string, ShaderMaterial>(); // by their defines

  constructor(private readonly tone: ReturnType<typeof toneUniforms>) {
    this.mesh.frustumCulled = this.mesh.visible = false;
  }

  setGeometry(geometry: BufferGeometry): void {
    this.geometry?.dispose();
    this.geometry = geometry;
    this.quick?.geometry.dispose();
    this.quick = null;
    this.making?.cancel();
    this.making = this.gloss = null;
    this.mesh.visible = this.lit = false; // until there is light for it
  }

  /** Shows the mesh in plain grey, if it has no light yet; whether that is so. */
  reveal(): boolean {
    if (this.geometry && !this.lit) this.mesh.visible = true;
    return !this.lit;
  }

  /** Shows the mesh, which has light now; whether it was unseen. */
  light(): boolean {
    const unseen = !this.lit;
    this.mesh.visible = this.lit = this.geometry !== null;
    return unseen;
  }

  /** Makes what quick frames show, for those who draw slowly; `ready` when a whole frame should prepare it. */
  prepare(ready: () => void): void {
    if (!this.geometry) return;
    this.making ??= Quick.of(this.geometry, (quick) => {
      this.quick = quick;
      ready();
    });
  }

  /** The shadows are to be drawn again. */
  forget(): void {
    for (const side of ["A", "B"] as const) this.shadows[side].forget();
  }

  /** Puts a side's look on the mesh, as `camera` will see it. */
  dress(renderer: WebGLRenderer, camera: Camera, side: "A" | "B", looks: Record<"A" | "B", Look>, quickly: boolean): void {
    const { geometry, mesh } = this;
    const look = looks[side];
    if (!geometry) return;
    const flat = this.sheet.unfold.value > 0;
    const plain = this.lit && this.show === "picture" && !this.difference;
    const marched = plain && look.marched > 0;
    const shadows = this.shadows[side];
    const defines: Record<string, number> & { LIGHTS: number } = { ...lookDefines(look), TONEMAP: this.tonemap, SHOW: SHOWS[this.lit ? this.show : "grey"] };
    applyLook(look, this.uniforms);
    if (this.difference) Object.assign(defines, applyOther(looks.A, this.uniforms));
    if (marched) defines.MARCHED = 1;
    const few = quickly ? this.quick : null;
    if (quickly && plain && !marched && !flat) {
      defines.QUICK = 1;
      const gloss = few?.gloss ?? (this.gloss ??= new Gloss(geometry));
      gloss.update(look, camera.position, few && few.reach[side].under(look.beams));
    } else if (plain) {
      defines.SHADOWS = shadows.update(renderer, geometry, look.beams);
      void this.quick?.reach[side].update(renderer, shadows, look.beams);
    }
    const material = (mesh.material = this.material(defines));
    Object.assign(material.uniforms, shadows.uniforms);
    if (flat) few?.everywhere();
    else few?.towards(camera.position);
    mesh.geometry = few?.geometry ?? geometry;
  }

  private material(defines: Record<string, number>): ShaderMaterial {
    const key = JSON.stringify(Object.entries(defines).sort());
    const known = this.materials.get(key);
    if (known) return known;
    const uniforms = { ...this.uniforms, ...this.tone, ...this.sheet };
    const shaders = { vertexShader: VERTEX, fragmentShader: FRAGMENT };
    const made = new ShaderMaterial({ glslVersion: GLSL3, side: DoubleSide, defines: { SHADOWS: 0, ...defines }, uniforms, ...shaders });
    this.materials.set(key, made);
    return made;
  }
}
