// Meshes as solids: which of their faces can be seen at all.

import { BufferAttribute, BufferGeometry, DynamicDrawUsage, type Vector3 } from "three";

/** The first vertex at the place of each vertex: those that seams part have one. */
export function welded(geometry: BufferGeometry): Uint32Array {
  const position = geometry.getAttribute("position");
  const places = new Map<string, number>();
  const place = new Uint32Array(position.count);
  for (let i = 0; i < position.count; i++) {
    const key = `${position.getX(i)} ${position.getY(i)} ${position.getZ(i)}`;
    const known = places.get(key);
    place[i] = known ?? i;
    if (known === undefined) places.set(key, i);
  }
  return place;
}

/** Whether every part of a surface is closed and faces outwards: then no face is seen from behind. */
function isSolid(geometry: BufferGeometry): boolean {
  const place = welded(geometry);
  const index = geometry.getIndex()!.array.map((vertex) => place[vertex]);
  const edges = new Set<number>(); // a → b, while b → a has not come
  for (let i = 0; i < index.length; i++) {
    const [a, b] = [index[i], index[i % 3 === 2 ? i - 2 : i + 1]];
    const [there, back] = [a * place.length + b, b * place.length + a];
    if (edges.has(there)) return false;
    if (!edges.delete(back)) edges.add(there);
  }
  return edges.size === 0 && volumes(geometry, index).every((volume) => volume > 0);
}

/** Signed volumes, six times, of the parts that faces join. */
function volumes(geometry: BufferGeometry, index: ArrayLike<number>): number[] {
  const position = geometry.getAttribute("position").array;
  const root = Uint32Array.from({ length: position.length / 3 }, (_, i) => i);
  const find = (i: number): number => {
    while (root[i] !== i) i = root[i] = root[root[i]];
    return i;
  };
  for (let i = 0; i < index.length; i++) root[find(index[i])] = find(index[i - (i % 3)]);
  const sums = new Map<number, number>();
  for (let i = 0; i < index.length; i += 3) {
    const [a, b, c] = [3 * index[i], 3 * index[i + 1], 3 * index[i + 2]];
    const [x, y, z] = [position[a], position[a + 1], position[a + 2]];
    const [bx, by, bz] = [position[b], position[b + 1], position[b + 2]];
    const [cx, cy, cz] = [position[c], position[c + 1], position[c + 2]];
    const volume = x * (by * cz - bz * cy) + y * (bz * cx - bx * cz) + z * (bx * cy - by * cx);
    const part = find(index[i]);
    sums.set(part, (sums.get(part) ?? 0) + volume);
  }
  return [...sums.values()];
}

/** A solid without the faces that turn away from the eye: half the work where no graphics card does it. */
export class Turned {
  readonly geometry = new BufferGeometry();
  private readonly planes: Float64Array; // (F, 4): the eye is in front where their product with (x, y, z, 1) is positive
  private readonly all: ArrayLike<number>;

  /** `solid`: null when it is none. */
  static of(solid: BufferGeometry): Turned | null {
    return isSolid(solid) ? new Turned(solid) : null;
  }

  private constructor(solid: BufferGeometry) {
    const position = solid.getAttribute("position").array;
    const index = (this.all = solid.getIndex()!.array);
    for (const [name, attribute] of Object.entries(solid.attributes)) this.geometry.setAttribute(name, attribute);
    this.geometry.setIndex(new BufferAttribute(new Uint32Array(index.length), 1).setUsage(DynamicDrawUsage));
    this.planes = new Float64Array((4 * index.length) / 3);
    for (let i = 0; i < index.length; i += 3) {
      const [a, b, c] = [3 * index[i], 3 * index[i + 1], 3 * index[i + 2]];
      const [ux, uy, uz] = [position[b] - position[a], position[b + 1] - position[a + 1], position[b + 2] - position[a + 2]];
      const [vx, vy, vz] = [position[c] - position[a], position[c + 1] - position[a + 1], position[c + 2] - position[a + 2]];
      const [x, y, z] = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
      this.planes.set([x, y, z, -(x * position[a] + y * position[a + 1] + z * position[a + 2])], (4 * i) / 3);
    }
  }

  /** Keeps the faces that turn towards the eye [mm]. */
  towards(eye: Vector3): void {
    const { all, planes } = this;
    const index = this.geometry.getIndex()!;
    const kept = index.array;
    let count = 0;
    for (let i = 0, p = 0; i < all.length; i += 3, p += 4) {
      if (planes[p] * eye.x + planes[p + 1] * eye.y + planes[p + 2] * eye.z + planes[p + 3] <= 0) continue;
      kept[count] = all[i];
      kept[count + 1] = all[i + 1];
      kept[count + 2] = all[i + 2];
      count += 3;
    }
    index.clearUpdateRanges();
    index.addUpdateRange(0, count);
    index.needsUpdate = true;
    this.geometry.setDrawRange(0, count);
  }
}
