// What stands in for the object while it moves, where no graphics card draws it: fewer faces, and of a solid
// those alone that turn towards the eye.

import { BufferAttribute, BufferGeometry, DynamicDrawUsage, type Vector3 } from "three";
import { Gloss } from "./gloss";
import type { Leaned } from "./lean.worker";
import { Reach } from "./reach";
import type { Shape } from "./shape";

const MOST_FACES = 5_000;

const plain = (geometry: BufferGeometry): Shape => {
  const values = (name: string) => geometry.getAttribute(name).array as Float32Array;
  const [position, normal, atlas, source] = ["position", "normal", "atlas", "source"].map(values);
  return { position, normal, atlas, source, index: geometry.getIndex()!.array as Uint32Array };
};

export class Quick {
  readonly geometry = new BufferGeometry();
  readonly gloss: Gloss;
  readonly reach: Record<"A" | "B", Reach>;
  private readonly all: ArrayLike<number>;
  /** (F, 4): the eye is in front where their product with (x, y, z, 1) is positive; null where both sides are seen. */
  private readonly planes: Float64Array | null;

  /** Made beside the page; `ready` hears it once, if nothing newer was asked for. */
  static of(geometry: BufferGeometry, ready: (quick: Quick) => void): { cancel(): void } {
    const worker = new Worker(new URL("./lean.worker.ts", import.meta.url), { type: "module" });
    worker.onmessage = ({ data }: MessageEvent<Leaned>) => {
      worker.terminate();
      ready(new Quick(data.shape ?? plain(geometry), data.solid));
    };
    worker.onerror = () => worker.terminate(); // then the object stands for itself
    worker.postMessage({ shape: plain(geometry), most: MOST_FACES });
    return { cancel: () => worker.terminate() };
  }

  private constructor(shape: Shape, solid: boolean) {
    const { position, normal, atlas, source, index } = shape;
    this.all = index;
    for (const [name, values, width] of [["position", position, 3], ["normal", normal, 3], ["atlas", atlas, 2], ["source", source, 2]] as const)
      this.geometry.setAttribute(name, new BufferAttribute(values, width));
    const Kind = position.length / 3 < 65536 ? Uint16Array : Uint32Array;
    this.geometry.setIndex(new BufferAttribute(new Kind(index), 1).setUsage(DynamicDrawUsage));
    this.gloss = new Gloss(this.geometry);
    this.reach = { A: new Reach(this.geometry), B: new Reach(this.geometry) };
    this.planes = solid ? planes(position, index) : null;
  }

  /** Keeps the faces that turn towards the eye [mm]. */
  towards(eye: Vector3): void {
    const { all, planes } = this;
    if (!planes) return;
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

  /** Keeps all, as for a surface that is laid flat. */
  everywhere(): void {
    if (!this.planes || this.geometry.drawRange.count === this.all.length) return;
    const index = this.geometry.getIndex()!;
    index.array.set(this.all);
    index.clearUpdateRanges();
    index.needsUpdate = true;
    this.geometry.setDrawRange(0, this.all.length);
  }
}

function planes(position: Float32Array, index: ArrayLike<number>): Float64Array {
  const found = new Float64Array((4 * index.length) / 3);
  for (let i = 0; i < index.length; i += 3) {
    const [a, b, c] = [3 * index[i], 3 * index[i + 1], 3 * index[i + 2]];
    const [ux, uy, uz] = [position[b] - position[a], position[b + 1] - position[a + 1], position[b + 2] - position[a + 2]];
    const [vx, vy, vz] = [position[c] - position[a], position[c + 1] - position[a + 1], position[c + 2] - position[a + 2]];
    const [x, y, z] = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
    found.set([x, y, z, -(x * position[a] + y * position[a + 1] + z * position[a + 2])], (4 * i) / 3);
  }
  return found;
}
