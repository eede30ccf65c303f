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
  const position = array(Float32Array, names.POSITION).slice();
  for (let i = 0; i < position.length; i++) position[i] *= MM_PER_METRE;
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
