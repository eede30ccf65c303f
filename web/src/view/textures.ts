// Images of the service as textures; v runs down in both.

import {
  ClampToEdgeWrapping,
  DataTexture,
  HalfFloatType,
  LinearFilter,
  LinearMipmapLinearFilter,
  LinearMipmapNearestFilter,
  NoColorSpace,
  RGBAFormat,
  RepeatWrapping,
  SRGBColorSpace,
  Texture,
} from "three";
import type { Decoded } from "./decode.worker";
import { type HalfImage, rgba } from "./npy";

/** A grey texel, where nothing has been loaded. */
export const blank = new DataTexture(new Uint8Array([0, 0, 0, 255]), 1, 1);
blank.needsUpdate = true;

/** Linear values in half precision. */
export function fromHalf(image: HalfImage): Texture {
  return data(rgba(image), image.width, image.height);
}

/** How bitmaps are made of coded images: nothing is converted. */
const AS_CODED: ImageBitmapOptions = { colorSpaceConversion: "none", premultiplyAlpha: "none" };

function data(values: Uint16Array<ArrayBuffer>, width: number, height: number): Texture {
  const texture = new DataTexture(values, width, height, RGBAFormat, HalfFloatType);
  texture.minFilter = texture.magFilter = LinearFilter;
  texture.generateMipmaps = false;
  texture.wrapS = texture.wrapT = ClampToEdgeWrapping;
  texture.needsUpdate = true;
  return texture;
}

/** Smaller ones beside it, for pixels that cover many texels: fewer are fetched from far apart in memory. */
export function coarsened(texture: Texture): void {
  texture.minFilter = LinearMipmapNearestFilter;
  texture.generateMipmaps = true;
}

/** A coded image: `srgb` values are decoded by the graphics card. */
export async function fromBlob(blob: Blob, srgb: boolean): Promise<Texture> {
  const texture = new Texture(await createImageBitmap(blob, AS_CODED));
  texture.flipY = false;
  texture.colorSpace = srgb ? SRGBColorSpace : NoColorSpace;
  texture.wrapS = texture.wrapT = ClampToEdgeWrapping;
  texture.magFilter = texture.minFilter = LinearFilter;
  texture.generateMipmaps = false;
  texture.needsUpdate = true;
  return texture;
}

/** A coded map that may tile. `decoded`: once, beside the page, where no graphics card would do it at every pixel. */
export async function mapOf(blob: Blob, srgb: boolean, decoded: boolean): Promise<Texture> {
  const texture = await (decoded ? decodedBeside(blob, srgb) : fromBlob(blob, srgb));
  texture.wrapS = texture.wrapT = RepeatWrapping;
  texture.minFilter = decoded ? LinearMipmapNearestFilter : LinearMipmapLinearFilter;
  texture.generateMipmaps = true;
  texture.anisotropy = decoded ? 1 : 4;
  return texture;
}

/** Made beside the page, which goes on meanwhile. */
function decodedBeside(coded: Blob, srgb: boolean): Promise<Texture> {
  const worker = new Worker(new URL("./decode.worker.ts", import.meta.url), { type: "module" });
  return new Promise<Texture>((done, fail) => {
    worker.onmessage = ({ data: found }: MessageEvent<Decoded | string>) =>
      typeof found === "string" ? fail(new Error(found)) : done(data(found.values, found.width, found.height));
    worker.onerror = (event) => fail(new Error(event.message || "the image could not be decoded"));
    worker.postMessage({ coded, srgb });
  }).finally(() => worker.terminate());
}
