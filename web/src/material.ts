// Media from what people know: a colour and how far light travels.

import type { Triple } from "./types";

/**
 * Coefficients [1/mm] of the medium of which a half-space looks like `colour` (0..1, linear) under even
 * light, with mean free path 1 / sigma_t [mm]. As texsss/media/artist.py; source: d'Eon 2021, as OpenPBR
 * 1.1 prints it.
 */
export function fromColour(colour: Triple, mean_free_path_mm: Triple, g = 0): { sigma_a: Triple; sigma_s: Triple } {
  const sigma_a: number[] = [];
  const sigma_s: number[] = [];
  for (let k = 0; k < 3; k++) {
    const rho = Math.min(Math.max(colour[k], 0), 1);
    const s = 4.09712 + 4.20863 * rho - Math.sqrt(9.59217 + 41.6808 * rho + 17.7126 * rho ** 2);
    const s2 = Math.min(Math.max(s, 0), 1) ** 2;
    const albedo = (1 - s2) / (1 - g * s2);
    sigma_a.push((1 - albedo) / mean_free_path_mm[k]);
    sigma_s.push(albedo / mean_free_path_mm[k]);
  }
  return { sigma_a: sigma_a as Triple, sigma_s: sigma_s as Triple };
}

/** The inverse: how a half-space of a medium looks under even light, linear 0..1. */
export function toColour(sigma_a: Triple, sigma_s: Triple, g = 0): Triple {
  return [0, 1, 2].map((k) => {
    const reduced = sigma_s[k] * (1 - g);
    const s = Math.sqrt(1 - reduced / Math.max(sigma_a[k] + reduced, 1e-12));
    return ((1 - s) * (1 - 0.139 * s)) / (1 + 1.17 * s);
  }) as Triple;
}

/** 1 / sigma_t [mm]. */
export const meanFreePath = (sigma_a: Triple, sigma_s: Triple): Triple =>
  [0, 1, 2].map((k) => 1 / Math.max(sigma_a[k] + sigma_s[k], 1e-6)) as Triple;

const encode = (value: number): number =>
  value <= 0.0031308 ? 12.92 * value : 1.055 * Math.max(value, 0) ** (1 / 2.4) - 0.055;
/** A value of sRGB in 0..1 as light. */
export const decode = (value: number): number => (value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4);

/** A linear colour as #rrggbb. */
export const toHex = (colour: Triple): string =>
  "#" + colour.map((v) => Math.round(255 * Math.min(encode(v), 1)).toString(16).padStart(2, "0")).join("");

/** #rrggbb as a linear colour. */
export const fromHex = (hex: string): Triple =>
  [1, 3, 5].map((at) => decode(parseInt(hex.slice(at, at + 2), 16) / 255)) as Triple;
