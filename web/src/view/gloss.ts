// Gloss at vertices, reckoned here, for frames that must come soon: the formulas of GLOSS in shaders.ts, with a wider
// lobe where the surface turns from one vertex to the next (Kaplanyan, Tokuyoshi 2016), which else would flash.

import { BufferAttribute, type BufferGeometry, DynamicDrawUsage, type Vector3 } from "three";
import type { Beam, Look } from "./look";

const TURN = 0.06; // of the square of the step between neighbouring normals, added to that of the lobe's width
const WIDEST = 0.18; // added at most
const GRAZING = 0.04; // least cosine towards the eye: beyond, a vertex lends its gloss to what is seen
const BEYOND = 0.25; // where that ends
const STRIDE = 8; // numbers of a light at a vertex: direction, power, cosine, and whether it reaches it

/** What of a look at the vertices does not change with the eye. */
interface Lit {
  beams: Beam[];
  reach: Uint8Array | null;
  /** Where the lights of each vertex begin. */
  starts: Uint32Array;
  lights: Float32Array;
}

export class Gloss {
  private readonly position: Float32Array;
  private readonly normal: Float32Array;
  private readonly values: Float32Array;
  private readonly attribute: BufferAttribute;
  private readonly turning: Float32Array;
  private readonly lit = new WeakMap<Look, Lit>();

  /** Of `geometry`, which gets it as an attribute: radiance mirrored, and the share of light beneath that leaves. */
  constructor(geometry: BufferGeometry) {
    this.position = geometry.getAttribute("position").array as Float32Array;
    this.normal = geometry.getAttribute("normal").array as Float32Array;
    this.values = new Float32Array((4 * this.position.length) / 3);
    this.attribute = new BufferAttribute(this.values, 4).setUsage(DynamicDrawUsage);
    this.turning = turning(this.normal, geometry.getIndex()!.array);
    geometry.setAttribute("gloss", this.attribute);
  }

  /** Follows look and eye [mm]. `reach`: (V, 4) of 255, how much of its first lights arrives; null: all. */
  update(look: Look, eye: Vector3, reach: Uint8Array | null): void {
    const { position, normal, values, turning } = this;
    const { starts, lights } = this.reached(look, reach);
    const { eta, specular, secondLobe } = look;
    const { x: ambientR, y: ambientG, z: ambientB } = look.ambient;
    const surrounded = ambientR + ambientG + ambientB > 0 && eta !== 1;
    const alpha2 = squaredWidth(look.roughness);
    const second2 = squaredWidth(Math.min(1.6 * look.roughness, 1));
    const out = 1 / (Math.PI * look.transmittance);
    for (let i = 0, p = 0, q = 0; q < values.length; i++, p += 3, q += 4) {
      let [vx, vy, vz] = [eye.x - position[p], eye.y - position[p + 1], eye.z - position[p + 2]];
      const near = 1 / Math.sqrt(vx * vx + vy * vy + vz * vz);
      vx *= near;
      vy *= near;
      vz *= near;
      const [nx, ny, nz] = [normal[p], normal[p + 1], normal[p + 2]];
      const facing = nx * vx + ny * vy + nz * vz;
      const toView = Math.max(facing, GRAZING);
      const seen = specular * Math.min(Math.max(1 + facing / BEYOND, 0), 1);
      let [r, g, b] = [0, 0, 0];
      for (let k = STRIDE * starts[i]; k < STRIDE * starts[i + 1]; k += STRIDE) {
        let [hx, hy, hz] = [lights[k] + vx, lights[k + 1] + vy, lights[k + 2] + vz];
        const half = 1 / Math.sqrt(hx * hx + hy * hy + hz * hz + 1e-12);
        hx *= half;
        hy *= half;
        hz *= half;
        const toHalf = nx * hx + ny * hy + nz * hz;
        if (toHalf <= 0) continue;
        const toLight = lights[k + 6];
        let value = lobe(alpha2 + turning[i], toHalf, toView, toLight);
        if (secondLobe > 0) value += secondLobe * (lobe(second2 + turning[i], toHalf, toView, toLight) - value);
        value *= fresnel(vx * hx + vy * hy + vz * hz, eta) * seen;
        r += value * lights[k + 3];
        g += value * lights[k + 4];
        b += value * lights[k + 5];
      }
      if (surrounded) {
        const even = specular * evenly(toView, look.roughness, eta);
        r += even * ambientR;
        g += even * ambientG;
        b += even * ambientB;
      }
      values[q] = r;
      values[q + 1] = g;
      values[q + 2] = b;
      values[q + 3] = (1 - fresnel(toView, eta)) * out;
    }
    this.attribute.needsUpdate = true;
  }

  private reached(look: Look, reach: Uint8Array | null): Lit {
    const known = this.lit.get(look);
    if (known?.beams === look.beams && known.reach === reach) return known;
    const { position, normal } = this;
    const count = position.length / 3;
    const starts = new Uint32Array(count + 1);
    const lights = new Float32Array(STRIDE * count * look.beams.length);
    let at = 0;
    for (let i = 0; i < count; i++) {
      look.beams.forEach(({ place, power, cone, inner }, light) => {
        const arriving = reach && light < 4 ? reach[4 * i + light] / 255 : 1;
        const far = place.w < 0.5;
        let [x, y, z] = far ? [place.x, place.y, place.z] : [place.x - position[3 * i], place.y - position[3 * i + 1], place.z - position[3 * i + 2]];
        const d2 = x * x + y * y + z * z;
        const near = 1 / Math.sqrt(d2);
        x *= near;
        y *= near;
        z *= near;
        const toLight = x * normal[3 * i] + y * normal[3 * i + 1] + z * normal[3 * i + 2];
        if (toLight <= 0 || arriving <= 0) return;
        let factor = arriving / (far ? 1 : d2);
        if (cone.w > -1.5) factor *= smoothstep(cone.w, inner, -(x * cone.x + y * cone.y + z * cone.z));
        lights.set([x, y, z, factor * power.x, factor * power.y, factor * power.z, toLight], STRIDE * at++);
      });
      starts[i + 1] = at;
    }
    const made = { beams: look.beams, reach, starts, lights: lights.slice(0, STRIDE * at) };
    this.lit.set(look, made);
    return made;
  }
}

const squaredWidth = (rough: number): number => Math.max(rough * rough, 1e-3) ** 2;

/** Microfacets of squared width a2 that mirror, by the cosines of their slope, of eye and light, times the last. */
function lobe(a2: number, toHalf: number, toView: number, toLight: number): number {
  a2 = Math.min(a2, 1);
  const d = 1 - (1 - a2) * toHalf * toHalf;
  const stretchView = Math.sqrt(a2 + (1 - a2) * toView * toView);
  const stretchLight = Math.sqrt(a2 + (1 - a2) * toLight * toLight);
  return ((a2 / (Math.PI * d * d)) * 0.5 * toLight) / (toLight * stretchView + toView * stretchLight);
}

function fresnel(mu: number, eta: number): number {
  if (eta === 1) return 0;
  const inner2 = 1 - (1 - mu * mu) / (eta * eta);
  if (inner2 <= 0) return 1;
  const inner = Math.sqrt(inner2);
  const across = (mu - eta * inner) / (mu + eta * inner);
  const along = (eta * mu - inner) / (eta * mu + inner);
  return 0.5 * (across * across + along * along);
}

/** What is mirrored of even surroundings, by the fit of Karis 2014. */
function evenly(c: number, rough: number, eta: number): number {
  const [x, y, z, w] = [1 - rough, 0.0425 - 0.0275 * rough, 1.04 - 0.572 * rough, 0.022 * rough - 0.04];
  const a004 = Math.min(x * x, 2 ** (-9.28 * c)) * x + y;
  return ((eta - 1) / (eta + 1)) ** 2 * (z - 1.04 * a004) + 1.04 * a004 + w;
}

function smoothstep(from: number, to: number, x: number): number {
  const t = Math.min(Math.max((x - from) / (to - from), 0), 1);
  return t * t * (3 - 2 * t);
}

/** How much wider lobes are at each vertex, squared, since its neighbours face elsewhere. */
function turning(normal: Float32Array, index: ArrayLike<number>): Float32Array {
  const sums = new Float32Array(normal.length / 3);
  const counts = new Uint16Array(sums.length);
  for (let i = 0; i < index.length; i++) {
    const [a, b] = [index[i], index[i % 3 === 2 ? i - 2 : i + 1]];
    const step = 2 - 2 * (normal[3 * a] * normal[3 * b] + normal[3 * a + 1] * normal[3 * b + 1] + normal[3 * a + 2] * normal[3 * b + 2]);
    sums[a] += step;
    sums[b] += step;
    counts[a]++;
    counts[b]++;
  }
  return sums.map((sum, i) => Math.min((TURN * sum) / Math.max(counts[i], 1), WIDEST));
}
