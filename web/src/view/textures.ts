// Images of the service as textures; v runs down in both.

import {
  ClampToEdgeWrapping,
  DataTexture,
  HalfFloatType,
  LinearFilter,
  LinearMipmapLinearFilter,
  NoColorSpace,
  RGBAFormat,
  RepeatWrapping,
  SRGBColorSpace,
  Texture,
} from "three";
import { type HalfImage, rgba } from "./npy";

/** A grey texel, where nothing has been loaded. */
export const blank = new DataTexture(new Uint8Array([0, 0, 0, 255]), 1, 1);
blank.needsUpdate = true;

/** Linear values in half precision. */
export function fromHalf(image: HalfImage): Texture {
  const texture = new DataTexture(rgba(image), image.width, image.height, RGBAFormat, HalfFloatType);
  texture.minFilter = texture.magFilter = LinearFilter;
  texture.generateMipmaps = false;
  texture.wrapS = texture.wrapT = ClampToEdgeWrapping;
  texture.needsUpdate = true;
  return texture;
}

/** A coded image: `srgb` values are decoded by the graphics card. */
export async function fromBlob(blob: Blob, options: { srgb: boolean; tile?: boolean }): Promise<Texture> {
  const bitmap = await createImageBitmap(blob, { colorSpaceConversion: "none", premultiplyAlpha: "none" });
  const texture = new Texture(bitmap);
  texture.flipY = false;
  texture.colorSpace = options.srgb ? SRGBColorSpace : NoColorSpace;
  texture.wrapS = texture.wrapT = options.tile ? RepeatWrapping : ClampToEdgeWrapping;
  texture.magFilter = LinearFilter;
  texture.minFilter = options.tile ? LinearMipmapLinearFilter : LinearFilter;
  texture.generateMipmaps = options.tile ?? false;
  if (options.tile) texture.anisotropy = 4;
  texture.needsUpdate = true;
  return texture;
}
