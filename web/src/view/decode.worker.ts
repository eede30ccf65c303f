// Decodes a coded map into half floats, once, for those who have no graphics card to do it at every pixel.

import { decode } from "../material";
import { toHalf } from "./npy";

export interface Decoded {
  /** RGBA half floats, row-major, v down. */
  values: Uint16Array<ArrayBuffer>;
  width: number;
  height: number;
}

self.onmessage = ({ data: { coded, srgb } }: MessageEvent<{ coded: Blob; srgb: boolean }>) =>
  decoded(coded, srgb).catch((error) => self.postMessage(`The image could not be decoded: ${error.message}`));

async function decoded(coded: Blob, srgb: boolean): Promise<void> {
  const bitmap = await createImageBitmap(coded, { colorSpaceConversion: "none", premultiplyAlpha: "none" });
  const { width, height } = bitmap;
  const context = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true })!;
  context.drawImage(bitmap, 0, 0);
  const bytes = context.getImageData(0, 0, width, height).data;
  const table = Uint16Array.from({ length: 256 }, (_, level) => toHalf(srgb ? decode(level / 255) : level / 255));
  const values = new Uint16Array(bytes.length);
  for (let i = 0; i < bytes.length; i++) values[i] = table[bytes[i]];
  self.postMessage({ values, width, height } satisfies Decoded, { transfer: [values.buffer] });
}
