// How much of the first lights arrives at each vertex: read from the depths as the lights see them, at rest.

import { BufferGeometry, GLSL3, OrthographicCamera, Points, ShaderMaterial, WebGLRenderTarget, type WebGLRenderer } from "three";
import { ARRIVING } from "./shaders";
import type { Beam } from "./look";
import { MOST, type Shadows } from "./shadows";

const WIDE = 64; // vertices in a row of the picture they are read from

const VERTEX = /* glsl */ `
uniform mat4 shadowMatrix[${MOST}];
uniform highp sampler2DShadow shadowMap;
uniform vec2 size;
flat out vec4 reach;
${ARRIVING}
void main() {
  for (int i = 0; i < ${MOST}; i++) reach[i] = arriving(shadowMatrix[i], position);
  vec2 texel = vec2(gl_VertexID % ${WIDE}, gl_VertexID / ${WIDE});
  gl_Position = vec4((texel + 0.5) / size * 2.0 - 1.0, 0.0, 1.0);
  gl_PointSize = 1.0;
}`;

const FRAGMENT = /* glsl */ `
flat in vec4 reach;
out vec4 colour;
void main() { colour = reach; }`;

export class Reach {
  /** (V, 4) of 255, by the order of the lights; null until it is known. */
  values: Uint8Array | null = null;
  private of = "";

  constructor(private readonly geometry: BufferGeometry) {}

  /** Learns it from the shadows of these lights, which were drawn; soon, unless it knows. */
  async update(renderer: WebGLRenderer, shadows: Shadows, beams: Beam[]): Promise<void> {
    const key = placesOf(beams);
    if (key === this.of) return;
    this.of = key;
    this.values = null;
    const position = this.geometry.getAttribute("position");
    const rows = Math.ceil(position.count / WIDE);
    const points = new Points(new BufferGeometry().setAttribute("position", position), material(shadows, rows));
    points.frustumCulled = false;
    const target = new WebGLRenderTarget(WIDE, rows, { depthBuffer: false });
    renderer.setRenderTarget(target);
    renderer.render(points, new OrthographicCamera());
    renderer.setRenderTarget(null);
    const read = new Uint8Array(4 * WIDE * rows);
    try {
      await renderer.readRenderTargetPixelsAsync(target, 0, 0, WIDE, rows, read);
      if (this.of === key) this.values = read;
    } catch {
      this.of = ""; // the graphics card was taken away: another time
    } finally {
      target.dispose();
      points.material.dispose();
    }
  }

  /** What is known, if it is of these lights as they stand. */
  under(beams: Beam[]): Uint8Array | null {
    return placesOf(beams) === this.of ? this.values : null;
  }
}

const placesOf = (beams: Beam[]): string => JSON.stringify(beams.slice(0, MOST).map(({ place }) => place.toArray()));

const material = ({ uniforms }: Shadows, rows: number): ShaderMaterial =>
  new ShaderMaterial({
    glslVersion: GLSL3,
    depthTest: false,
    uniforms: { ...uniforms, size: { value: [WIDE, rows] } },
    vertexShader: VERTEX,
    fragmentShader: FRAGMENT,
  });
