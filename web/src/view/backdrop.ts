// What stands behind the object: a gradient of light, toned as the object is.

import { GLSL3, Mesh, PlaneGeometry, ShaderMaterial, Vector3 } from "three";
import type { Showing, Tonemap, Triple } from "../types";
import { DITHER, TONE, TONEMAPS, type toneUniforms } from "./tone";

const STRIPS = 24; // toned at their edges, so that no pixel pays for it; a display shows no difference

const VERTEX = /* glsl */ `
out vec3 shade;
uniform vec3 top, bottom;
${TONE}
void main() {
  shade = display(mix(bottom, top, position.y * 0.5 + 0.5));
  gl_Position = vec4(position.xy, 1.0, 1.0);
}`;

const FRAGMENT = /* glsl */ `
in vec3 shade;
out vec4 colour;
uniform bool quick; // then pixels are large and soon gone: noise would be seen, and not hide bands
${DITHER}
void main() { colour = vec4(quick ? shade : dithered(shade), 1.0); }`;

export class Backdrop {
  private readonly top = { value: new Vector3() };
  private readonly bottom = { value: new Vector3() };
  /** Whether the next frame is one that must come soon. */
  readonly quick = { value: false };
  private readonly material: ShaderMaterial;
  readonly mesh: Mesh;

  constructor(tone: ReturnType<typeof toneUniforms>) {
    this.material = new ShaderMaterial({
      glslVersion: GLSL3,
      depthWrite: false,
      defines: { TONEMAP: 0 },
      uniforms: { ...tone, top: this.top, bottom: this.bottom, quick: this.quick },
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
    });
    this.mesh = new Mesh(new PlaneGeometry(2, 2, 1, STRIPS), this.material);
    this.mesh.renderOrder = 1; // last, and only where nothing stands before it
    this.mesh.frustumCulled = false;
  }

  setTonemap(name: Tonemap): void {
    if (this.material.defines.TONEMAP === TONEMAPS[name]) return;
    this.material.defines.TONEMAP = TONEMAPS[name];
    this.material.needsUpdate = true;
  }

  /** One colour, or those of the top and the bottom. */
  setLight(background: Showing["background"]): void {
    const pair = Array.isArray(background[0]) ? (background as [Triple, Triple]) : [background, background];
    this.top.value.fromArray(pair[0] as Triple);
    this.bottom.value.fromArray(pair[1] as Triple);
  }
}
