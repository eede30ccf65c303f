// Where the atlas is cut.

import type { BufferGeometry } from "three";
import { welded } from "./shape";

/** Line segments [mm] along the edges where the atlas is cut. */
export function seams(geometry: BufferGeometry): { positions: Float32Array; uv: Float32Array } {
  const position = geometry.getAttribute("position");
  const atlas = geometry.getAttribute("atlas");
  const index = geometry.getIndex()!.array;
  const place = welded(position.array);
  // an edge whose two sides use other corners, or that has one side only
  const sides = new Map<number, [number, number][]>();
  for (let face = 0; face < index.length; face += 3) {
    for (let k = 0; k < 3; k++) {
      const a = index[face + k];
      const b = index[face + ((k + 1) % 3)];
      const [low, high] = place[a] < place[b] ? [a, b] : [b, a];
      const key = place[low] * position.count + place[high];
      const list = sides.get(key);
      if (list) list.push([low, high]);
      else sides.set(key, [[low, high]]);
    }
  }
  const same = (i: number, j: number) => atlas.getX(i) === atlas.getX(j) && atlas.getY(i) === atlas.getY(j);
  const points: number[] = [];
  const uvs: number[] = [];
  for (const list of sides.values()) {
    const [a, b] = list[0];
    if (list.length > 1 && list.every(([c, d]) => same(a, c) && same(b, d))) continue;
    for (const [c, d] of list) {
      for (const i of [c, d]) {
        points.push(position.getX(i), position.getY(i), position.getZ(i));
        uvs.push(atlas.getX(i), atlas.getY(i));
      }
    }
  }
  return { positions: new Float32Array(points), uv: new Float32Array(uvs) };
}
