// A mesh of fewer faces for frames that must come soon: vertices inside charts go, and those on seams along them.
// Each vertex that goes falls onto a neighbour (half-edge collapse), chosen by quadrics (Garland, Heckbert 1997).

import { grouped, type Shape, welded } from "./shape";

const FIRST = 2e-4; // of the size: how far the surface may move at first, [mm / mm]
const LAST = 0.008; // and at last
const STEP = 1.5;
const EVEN = 0.02; // of an edge's length, added to what it costs: short ones go first
const LEAST_TURN = 0.3; // cosine: faces may not turn farther in one collapse
const ASTRAY = 0.004; // of the atlas: how far a seam may move there in one collapse, into the padding
const Q = 11; // numbers of a quadric: ten of the symmetric matrix, and its weight

/** The mesh with about `most` faces; `null` where it has hardly more. */
export function lean(shape: Shape, most: number): Shape | null {
  if (shape.index.length / 3 < 1.3 * most) return null;
  const fewer = new Collapse(joined(shape));
  fewer.until(most);
  return fewer.shape();
}

/** Vertices that differ by their normals alone become one. */
function joined(shape: Shape): Shape {
  const { position: p, normal, atlas: a, source: s, index } = shape;
  const count = p.length / 3;
  const first = grouped(count, (i) => `${p[3 * i]} ${p[3 * i + 1]} ${p[3 * i + 2]} ${a[2 * i]} ${a[2 * i + 1]} ${s[2 * i]} ${s[2 * i + 1]}`);
  const sums = new Float32Array(normal.length);
  for (let i = 0; i < count; i++) for (let k = 0; k < 3; k++) sums[3 * first[i] + k] += normal[3 * i + k];
  for (let i = 0; i < sums.length; i += 3) {
    const length = Math.hypot(sums[i], sums[i + 1], sums[i + 2]) || 1;
    for (let k = 0; k < 3; k++) sums[i + k] /= length;
  }
  return { ...shape, normal: sums, index: index.map((vertex) => first[vertex]) };
}

class Collapse {
  private readonly corners: Uint32Array; // of faces; a face that went has its first two corners alike
  private readonly around: number[][]; // faces at each vertex
  private readonly fixed: Uint8Array;
  private readonly place: Uint32Array; // the first vertex at the same place
  private readonly twin: Int32Array; // the one on the other side of a seam; -1: none, or more than one
  private readonly quadrics: Float64Array;
  private readonly size: number; // [mm]
  private faces = 0;

  constructor(private readonly given: Shape) {
    const { position, index } = given;
    const count = position.length / 3;
    this.corners = index.slice();
    this.around = Array.from({ length: count }, () => []);
    this.fixed = new Uint8Array(count);
    this.quadrics = new Float64Array(Q * count);
    for (let f = 0; f < index.length; f += 3) {
      if (this.gone(f)) continue;
      this.faces++;
      this.weigh(f);
      for (let k = 0; k < 3; k++) this.around[index[f + k]].push(f);
    }
    this.place = welded(position);
    this.twin = new Int32Array(count).fill(-1);
    this.fix();
    let [low, high] = [Infinity, -Infinity];
    for (const value of position) [low, high] = [Math.min(low, value), Math.max(high, value)];
    this.size = high - low;
  }

  until(most: number): void {
    const touched = new Uint8Array(this.fixed.length);
    for (let reach = FIRST; reach < LAST && this.faces > most; reach *= STEP) {
      const limit = (reach * this.size) ** 2;
      for (let again = true; again && this.faces > most; ) {
        again = false;
        touched.fill(0); // one collapse a neighbourhood: the next sees what became of it
        for (let u = 0; u < this.fixed.length && this.faces > most; u++) {
          if (this.fixed[u] || touched[u] || !this.around[u].length) continue;
          for (const [from, to] of this.twin[u] < 0 ? this.inside(u, limit) : this.along(u, limit)) {
            for (const one of this.ring(from)) touched[one] = 1;
            this.collapse(from, to);
            again = true;
          }
        }
      }
    }
  }

  /** What is left, in an order in which neighbours follow each other. */
  shape(): Shape {
    const { position, normal, atlas, source } = this.given;
    const order: number[] = []; // of vertices, as they were
    const place = new Int32Array(this.fixed.length).fill(-1);
    const index: number[] = [];
    const done = new Uint8Array(this.corners.length);
    const waiting: number[] = [];
    const emit = (f: number) => {
      done[f] = 1;
      for (let k = 0; k < 3; k++) {
        const vertex = this.corners[f + k];
        if (place[vertex] < 0) place[vertex] = order.push(vertex) - 1;
        index.push(place[vertex]);
        for (const next of this.around[vertex]) if (!done[next]) waiting.push(next);
      }
    };
    for (let f = 0; f < this.corners.length; f += 3) {
      waiting.push(f);
      while (waiting.length) {
        const next = waiting.pop()!;
        if (!done[next] && !this.gone(next)) emit(next);
      }
    }
    const take = (values: Float32Array, width: number) => Float32Array.from({ length: width * order.length }, (_, i) => values[width * order[Math.floor(i / width)] + (i % width)]);
    return { position: take(position, 3), normal: take(normal, 3), atlas: take(atlas, 2), source: take(source, 2), index: Uint32Array.from(index) };
  }

  private gone(f: number): boolean {
    const [a, b, c] = [this.corners[f], this.corners[f + 1], this.corners[f + 2]];
    return a === b || b === c || c === a;
  }

  /** Vertices on rims stay, where seams end or branch, and where more than two faces meet; others on seams are paired. */
  private fix(): void {
    const { fixed, place, twin } = this;
    const sides = new Map<number, number>();
    for (let f = 0; f < this.corners.length; f += 3) {
      if (this.gone(f)) continue;
      for (let k = 0; k < 3; k++) {
        const [a, b] = [this.corners[f + k], this.corners[f + ((k + 1) % 3)]];
        const key = Math.min(a, b) * fixed.length + Math.max(a, b);
        sides.set(key, (sides.get(key) ?? 0) + 1);
      }
    }
    for (const [key, count] of sides)
      if (count !== 2) for (const u of [key % fixed.length, Math.floor(key / fixed.length)]) fixed[u] = Math.max(fixed[u], count);
    const there = new Map<number, number[]>();
    for (let u = 0; u < place.length; u++) if (this.around[u].length) there.set(place[u], [...(there.get(place[u]) ?? []), u]);
    for (const [u, t, more] of there.values()) {
      if (t === undefined || more !== undefined || fixed[u] !== 1 || fixed[t] !== 1) continue;
      [twin[u], twin[t]] = [t, u];
      fixed[u] = fixed[t] = 0;
    }
  }

  private weigh(f: number): void {
    const [nx, ny, nz] = this.normal(f, -1, -1);
    const area = Math.hypot(nx, ny, nz);
    if (area === 0) return;
    const { position } = this.given;
    const at = 3 * this.corners[f];
    const plane = [nx / area, ny / area, nz / area, 0];
    plane[3] = -(plane[0] * position[at] + plane[1] * position[at + 1] + plane[2] * position[at + 2]);
    for (let k = 0; k < 3; k++) {
      let to = Q * this.corners[f + k];
      for (let i = 0; i < 4; i++) for (let j = i; j < 4; j++) this.quadrics[to++] += area * plane[i] * plane[j];
      this.quadrics[to] += area;
    }
  }

  /** Normal of a face, as long as twice its area, with `v` in the place of its corner `u`. */
  private normal(f: number, u: number, v: number): [number, number, number] {
    const { position } = this.given;
    const [a, b, c] = [0, 1, 2].map((k) => 3 * (this.corners[f + k] === u ? v : this.corners[f + k]));
    const [ux, uy, uz] = [position[b] - position[a], position[b + 1] - position[a + 1], position[b + 2] - position[a + 2]];
    const [vx, vy, vz] = [position[c] - position[a], position[c + 1] - position[a + 1], position[c + 2] - position[a + 2]];
    return [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
  }

  /** Signed area of a face in texture coordinates, with `v` in the place of its corner `u`. */
  private spread(uv: Float32Array, f: number, u: number, v: number): number {
    const [a, b, c] = [0, 1, 2].map((k) => 2 * (this.corners[f + k] === u ? v : this.corners[f + k]));
    return (uv[b] - uv[a]) * (uv[c + 1] - uv[a + 1]) - (uv[b + 1] - uv[a + 1]) * (uv[c] - uv[a]);
  }

  private ring(u: number): Set<number> {
    const ring = new Set<number>();
    for (const f of this.around[u]) for (let k = 0; k < 3; k++) ring.add(this.corners[f + k]);
    ring.delete(u);
    return ring;
  }

  /** How a vertex inside a chart falls most cheaply [mm²], below `limit`; empty: not at all. */
  private inside(u: number, limit: number): [number, number][] {
    const ring = this.ring(u);
    const priced = [...ring].map((v): [number, number] => [this.price(u, v), v]).filter(([price]) => price < limit);
    priced.sort((a, b) => a[0] - b[0]);
    const found = priced.find(([, v]) => this.allowed(u, v, 2));
    return found ? [[u, found[1]]] : [];
  }

  /** How both sides of a seam fall along it, together, so that no gap opens. */
  private along(u: number, limit: number): [number, number][] {
    const t = this.twin[u];
    const [near, far] = [this.rim(u), this.rim(t)];
    if (near.length !== 2 || far.length !== 2) return [];
    for (const v of near) {
      const w = far.find((one) => this.place[one] === this.place[v]);
      if (w === undefined || this.price(u, v) + this.price(t, w) > 2 * limit) continue;
      const other = (pair: number[], one: number) => pair[pair[0] === one ? 1 : 0];
      if (this.astray(u, v, other(near, v)) || this.astray(t, w, other(far, w))) continue;
      if (this.allowed(u, v, 1) && this.allowed(t, w, 1)) return [[u, v], [t, w]];
    }
    return [];
  }

  /** Neighbours along the edge of a chart: one face holds both. */
  private rim(u: number): number[] {
    const counts = new Map<number, number>();
    for (const f of this.around[u]) for (let k = 0; k < 3; k++) counts.set(this.corners[f + k], (counts.get(this.corners[f + k]) ?? 0) + 1);
    return [...counts].filter(([v, count]) => v !== u && count === 1).map(([v]) => v);
  }

  /** Whether the atlas has u too far from the line between v and w, which takes its place. */
  private astray(u: number, v: number, w: number): boolean {
    const { atlas: a } = this.given;
    const [x, y, dx, dy] = [a[2 * u] - a[2 * v], a[2 * u + 1] - a[2 * v + 1], a[2 * w] - a[2 * v], a[2 * w + 1] - a[2 * v + 1]];
    return Math.abs(x * dy - y * dx) > ASTRAY * Math.hypot(dx, dy);
  }

  /** Mean square distance [mm²] of v from the planes around both, and a little of the edge. */
  private price(u: number, v: number): number {
    const { position } = this.given;
    const p = [position[3 * v], position[3 * v + 1], position[3 * v + 2], 1];
    let [sum, weight, length] = [0, 0, 0];
    for (const vertex of [u, v]) {
      let at = Q * vertex;
      for (let i = 0; i < 4; i++) for (let j = i; j < 4; j++) sum += this.quadrics[at++] * p[i] * p[j] * (i === j ? 1 : 2);
      weight += this.quadrics[at];
    }
    for (let k = 0; k < 3; k++) length += (position[3 * u + k] - p[k]) ** 2;
    return Math.max(sum, 0) / Math.max(weight, 1e-30) + EVEN ** 2 * length;
  }

  /** Whether the surface stays one, `faces` of which the edge joins, and none turns over, in space or in its maps. */
  private allowed(u: number, v: number, faces: number): boolean {
    const ring = this.ring(u);
    let shared = 0;
    for (const one of this.ring(v)) if (ring.has(one)) shared++;
    if (shared !== faces) return false;
    const { atlas, source } = this.given;
    return this.around[u].every((f) => {
      if ([0, 1, 2].some((k) => this.corners[f + k] === v)) return true;
      const [before, after] = [this.normal(f, -1, -1), this.normal(f, u, v)];
      const turn = before[0] * after[0] + before[1] * after[1] + before[2] * after[2];
      if (turn <= LEAST_TURN * Math.hypot(...before) * Math.hypot(...after)) return false;
      return [atlas, source].every((uv) => this.spread(uv, f, -1, -1) * this.spread(uv, f, u, v) > 0);
    });
  }

  private collapse(u: number, v: number): void {
    for (const f of this.around[u]) {
      const dies = [0, 1, 2].some((k) => this.corners[f + k] === v);
      for (let k = 0; k < 3; k++) {
        const vertex = this.corners[f + k];
        if (dies && vertex !== u) this.around[vertex] = this.around[vertex].filter((one) => one !== f);
        if (vertex === u) this.corners[f + k] = v;
      }
      if (dies) this.faces--;
      else this.around[v].push(f);
    }
    this.around[u] = [];
    for (let i = 0; i < Q; i++) this.quadrics[Q * v + i] += this.quadrics[Q * u + i];
  }
}
