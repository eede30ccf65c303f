// The edges where the atlas is cut, as lines on the object.

import { BufferAttribute, BufferGeometry, GLSL3, LineSegments, ShaderMaterial } from "three";
import { seams } from "./seams";
import type { sheetUniforms } from "./look";
import { SHEET } from "./shaders";

const VERTEX = /* glsl */ `
in vec2 atlas;
${SHEET}
void main() {
  gl_Position = placed(position, atlas);
  gl_Position.z -= 2e-4 * gl_Position.w; // in front of the surface they lie on
}`;

const FRAGMENT = /* glsl */ `
out vec4 colour;
void main() { colour = vec4(1.0, 0.86, 0.35, 1.0); }`;

export class Cuts {
  readonly lines: LineSegments;
  private of: BufferGeometry | null = null;

  constructor(sheet: ReturnType<typeof sheetUniforms>) {
    const material = new ShaderMaterial({ glslVersion: GLSL3, uniforms: sheet, vertexShader: VERTEX, fragmentShader: FRAGMENT });
    this.lines = new LineSegments(new BufferGeometry(), material);
    this.lines.frustumCulled = this.lines.visible = false;
  }

  /** Shows those of `geometry`, which are looked for once; or none. */
  show(on: boolean, geometry: BufferGeometry | null): void {
    this.lines.visible = on;
    if (!on || !geometry || this.of === geometry) return;
    const found = seams(geometry);
    this.lines.geometry.dispose();
    this.lines.geometry = new BufferGeometry();
    this.lines.geometry.setAttribute("position", new BufferAttribute(found.positions, 3));
    this.lines.geometry.setAttribute("atlas", new BufferAttribute(found.uv, 2));
    this.of = geometry;
  }
}
