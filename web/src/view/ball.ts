// A ball under the lights, seen from the camera: what it shows at a normal is the gloss of vertices that face so.

import {
  GLSL3,
  HalfFloatType,
  LinearFilter,
  type Matrix3,
  Mesh,
  OrthographicCamera,
  PlaneGeometry,
  ShaderMaterial,
  type Vector3,
  WebGLRenderTarget,
  type WebGLRenderer,
} from "three";
import type { SurfaceUniforms } from "./look";
import { BALL, GLOSS } from "./shaders";

const VERTEX = /* glsl */ `
out vec2 at;
void main() {
  at = position.xy * ${(BALL / (BALL - 2)).toFixed(6)}; // the rim lies half a texel from the edge
  gl_Position = vec4(position.xy, 0.0, 1.0);
}`;

const FRAGMENT = /* glsl */ `
in vec2 at;
out vec4 gloss;
uniform mat3 fromView;
uniform vec3 centre;
${GLOSS}
void main() {
  float r2 = dot(at, at);
  vec3 n = fromView * (r2 < 1.0 ? vec3(at, sqrt(1.0 - r2)) : vec3(at * inversesqrt(r2), 0.0));
  vec3 v = fromView[2];
  n = facing(n, v);
  gloss = vec4(specular * highlights(n, v, centre, roughness), leaving(dot(n, v)));
}`;

export class Ball {
  private readonly target = new WebGLRenderTarget(BALL, BALL, { type: HalfFloatType, minFilter: LinearFilter, magFilter: LinearFilter, depthBuffer: false });
  private readonly quad = new Mesh(new PlaneGeometry(2, 2));
  private readonly camera = new OrthographicCamera();
  private readonly materials = new Map<string, ShaderMaterial>();
  readonly uniforms = { ball: { value: this.target.texture } };

  constructor() {
    this.quad.frustumCulled = false;
  }

  /** Draws it anew for this look, given as uniforms and defines; distances count from the object's centre. */
  draw(renderer: WebGLRenderer, look: SurfaceUniforms, defines: { LIGHTS: number; SECOND_LOBE?: number }, fromView: Matrix3, centre: Vector3): void {
    const key = JSON.stringify([defines.LIGHTS, defines.SECOND_LOBE]);
    let material = this.materials.get(key);
    if (!material) {
      const { LIGHTS, SECOND_LOBE } = defines;
      const shaders = { vertexShader: VERTEX, fragmentShader: FRAGMENT };
      const given = SECOND_LOBE ? { LIGHTS, SECOND_LOBE, SHADOWS: 0 } : { LIGHTS, SHADOWS: 0 };
      const uniforms = { ...look, fromView: { value: fromView }, centre: { value: centre } };
      material = new ShaderMaterial({ glslVersion: GLSL3, depthTest: false, depthWrite: false, defines: given, uniforms, ...shaders });
      this.materials.set(key, material);
    }
    material.uniforms.fromView.value = fromView;
    material.uniforms.centre.value = centre;
    this.quad.material = material;
    renderer.setRenderTarget(this.target);
    renderer.render(this.quad, this.camera);
    renderer.setRenderTarget(null);
  }
}
