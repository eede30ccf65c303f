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
import { decode } from "../material";
import { type HalfImage, rgba, toHalf } from "./npy";

/** A grey texel, where nothing has been loaded. */
export const blank = new DataTexture(new Uint8Array([0, 0, 0, 255]), 1, 1);
blank.needsUpdate = true;

/** Linear values in half precision. */
export function fromHalf(image: HalfImage): Texture {
  return data(rgba(image), image.width, image.height);
}

function data(values: Uint16Array<ArrayBuffer>, width: number, height: number): Texture {
  const texture = new DataTexture(values, width, height, RGBAFormat, HalfFloatType);
  texture.minFilter = texture.magFilter = LinearFilter;
  texture.generateMipmaps = false;
  texture.wrapS = texture.wrapT = ClampToEdgeWrapping;
  texture.needsUpdate = true;
  return texture;
}

const bitmapOf = (blob: Blob) => createImageBitmap(blob, { colorSpaceConversion: "none", premultiplyAlpha: "none" });

/** A coded image: `srgb` values are decoded by the graphics card. */
export async function fromBlob(blob: Blob, srgb: boolean): Promise<Texture> {
  const texture = new Texture(await bitmapOf(blob));
  texture.flipY = false;
  texture.colorSpace = srgb ? SRGBColorSpace : NoColorSpace;
  texture.wrapS = texture.wrapT = ClampToEdgeWrapping;
  texture.magFilter = texture.minFilter = LinearFilter;
  texture.generateMipmaps = false;
  texture.needsUpdate = true;
  return texture;
}

/** A coded map that may tile. `decoded`: here, once, where no graphics card would do it at every pixel. */
export async function mapOf(blob: Blob, srgb: boolean, decoded: boolean): Promise<Texture> {
  const texture = decoded ? decodedHere(await bitmapOf(blob), srgb) : await fromBlob(blob, srgb);
  texture.wrapS = texture.wrapT = RepeatWrapping;
  texture.minFilter = decoded ? LinearMipmapNearestFilter : LinearMipmapLinearFilter;
  texture.generateMipmaps = true;
  texture.anisotropy = decoded ? 1 : 4;
  return texture;
}

function decodedHere(bitmap: ImageBitmap, srgb: boolean): Texture {
  const { width, height } = bitmap;
  const canvas = new OffscreenCanvas(width, height);
  const context = canvas.getContext("2d", { willReadFrequently: true })!;
  context.drawImage(bitmap, 0, 0);
  const bytes = context.getImageData(0, 0, width, height).data;
  const table = Uint16Array.from({ length: 256 }, (_, level) => toHalf(srgb ? decode(level / 255) : level / 255));
  const values = new Uint16Array(bytes.length);
  for (let i = 0; i < bytes.length; i++) values[i] = table[bytes[i]];
  return data(values, width, height);
}
