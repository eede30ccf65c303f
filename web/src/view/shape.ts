// A mesh as plain arrays, for work that needs no screen: a worker does it.

export interface Shape {
  /** (V, 3) [mm]. */
  position: Float32Array;
  normal: Float32Array;
  /** (V, 2). */
  atlas: Float32Array;
  source: Float32Array;
  /** (F, 3). */
  index: Uint32Array;
}

/** The first vertex at the place of each vertex: those that seams part have one. */
export function welded(position: ArrayLike<number>): Uint32Array {
  return grouped(position.length / 3, (i) => `${position[3 * i]} ${position[3 * i + 1]} ${position[3 * i + 2]}`);
}

/** The first of `count` things that has the same key as each. */
export function grouped(count: number, key: (i: number) => string): Uint32Array {
  const firsts = new Map<string, number>();
  const first = new Uint32Array(count);
  for (let i = 0; i < count; i++) {
    const one = key(i);
    const known = firsts.get(one);
    first[i] = known ?? i;
    if (known === undefined) firsts.set(one, i);
  }
  return first;
}

/** Whether every part of a surface is closed and faces outwards: then no face is seen from behind. */
export function isSolid({ position, index: corners }: Pick<Shape, "position" | "index">): boolean {
  const place = welded(position);
  const index = corners.map((vertex) => place[vertex]);
  const edges = new Set<number>(); // a → b, while b → a has not come
  for (let i = 0; i < index.length; i++) {
    const [a, b] = [index[i], index[i % 3 === 2 ? i - 2 : i + 1]];
    const [there, back] = [a * place.length + b, b * place.length + a];
    if (edges.has(there)) return false;
    if (!edges.delete(back)) edges.add(there);
  }
  return edges.size === 0 && volumes(position, index).every((volume) => volume > 0);
}

/** Signed volumes, six times, of the parts that faces join. */
function volumes(position: ArrayLike<number>, index: ArrayLike<number>): number[] {
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
