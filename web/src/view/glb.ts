// The GLB of POST /v1/geometry: one primitive of float attributes and 32-bit indices.

import { BufferAttribute, BufferGeometry } from "three";

interface Accessor {
  bufferView: number;
  count: number;
  type: string;
}

const WIDTH: Record<string, number> = { SCALAR: 1, VEC2: 2, VEC3: 3 };
const MM_PER_METRE = 1000;

/** The mesh [mm] with attributes position, normal, atlas and source. Throws when the file is another kind. */
export function parseGlb(buffer: ArrayBuffer): BufferGeometry {
  const view = new DataView(buffer);
  if (view.getUint32(0, true) !== 0x46546c67) throw new Error("not a GLB");
  const length = view.getUint32(12, true);
  const document = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 20, length)));
  const start = 20 + length + 8;
  const array = <T>(Kind: new (b: ArrayBuffer, at: number, n: number) => T, index: number): T => {
    const accessor: Accessor = document.accessors[index];
    const at = start + (document.bufferViews[accessor.bufferView].byteOffset ?? 0);
    return new Kind(buffer, at, accessor.count * WIDTH[accessor.type]);
  };
  const primitive = document.meshes[0].primitives[0];
  const names = primitive.attributes as Record<string, number>;
  const position = array(Float32Array, names.POSITION).map((metres) => metres * MM_PER_METRE);
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(position, 3));
  geometry.setAttribute("normal", new BufferAttribute(array(Float32Array, names.NORMAL), 3));
  const atlas = new BufferAttribute(array(Float32Array, names.TEXCOORD_0), 2);
  geometry.setAttribute("atlas", atlas);
  const source = names.TEXCOORD_1 === undefined ? atlas : new BufferAttribute(array(Float32Array, names.TEXCOORD_1), 2);
  geometry.setAttribute("source", source);
  geometry.setIndex(new BufferAttribute(array(Uint32Array, primitive.indices), 1));
  geometry.computeBoundingSphere();
  return geometry;
}

/** Line segments [mm] along the edges where the atlas is cut. */
export function seams(geometry: BufferGeometry): { positions: Float32Array; uv: Float32Array } {
  const position = geometry.getAttribute("position");
  const atlas = geometry.getAttribute("atlas");
  const index = geometry.getIndex()!.array;
  const places = new Map<string, number>();
  const place = new Int32Array(position.count);
  for (let i = 0; i < position.count; i++) {
    const key = `${position.getX(i)} ${position.getY(i)} ${position.getZ(i)}`;
    const known = places.get(key);
    place[i] = known ?? i;
    if (known === undefined) places.set(key, i);
  }
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
