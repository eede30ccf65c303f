// Makes meshes lean beside the page, so that it never stands still.

import { lean } from "./lean";
import { isSolid, type Shape } from "./shape";

export interface Leaned {
  shape: Shape | null;
  solid: boolean;
}

onmessage = ({ data: { shape, most } }: MessageEvent<{ shape: Shape; most: number }>) => {
  const found: Leaned = { shape: lean(shape, most), solid: isSolid(shape) };
  postMessage(found);
};
