// From light to the colours of a display, as texsss/view/tonemap.py does.

import { Matrix3 } from "three";
import type { Tonemap } from "../types";

export const TONEMAPS: Record<Tonemap, number> = { linear: 0, agx: 1, aces: 2 };

/** GLSL `display(light)`; needs the define TONEMAP. */
export const TONE = /* glsl */ `
uniform float exposure; // factor
uniform mat3 agxIn, agxOut, acesIn, acesOut;

vec3 encode(vec3 c) {
  c = clamp(c, 0.0, 1.0);
#ifdef QUICK
  // within a level of the rest: roots are cheap where powers are not
  vec3 r = sqrt(c), s = sqrt(r), t = sqrt(s);
  return 0.662002687 * r + 0.684122060 * s - 0.323583601 * t - 0.0225411470 * c;
#endif
  return mix(12.92 * c, 1.055 * pow(max(c, 1e-6), vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c));
}
vec3 display(vec3 light) {
  light = clamp(light * exposure, 0.0, 1e6);
#if TONEMAP == ${TONEMAPS.agx}
  vec3 x = (log2(max(agxIn * light, exp2(-12.47393))) + 12.47393) / 16.5;
  x = clamp(x, 0.0, 1.0);
  vec3 y = vec3(15.5);
  y = y * x - 40.14;
  y = y * x + 31.96;
  y = y * x - 6.868;
  y = y * x + 0.4298;
  y = y * x + 0.1191;
  y = y * x - 0.00232;
  return clamp(agxOut * y, 0.0, 1.0);
#else
#if TONEMAP == ${TONEMAPS.aces}
  vec3 x = acesIn * light;
  x = (x * (x + 0.0245786) - 0.000090537) / (x * (0.983729 * x + 0.4329510) + 0.238081);
  light = acesOut * x;
#endif
  return encode(light);
#endif
}
`;

/** GLSL `dithered(colour)`: half a level of noise, so that dark gradients don't band. */
export const DITHER = /* glsl */ `
vec3 dithered(vec3 c) {
  float noise = fract(52.9829189 * fract(dot(gl_FragCoord.xy, vec2(0.06711056, 0.00583715))));
  return c + (noise - 0.5) / 255.0;
}
`;

const INSET = [
  [0.842479062253094, 0.0784335999999992, 0.0792237451477643],
  [0.0423282422610123, 0.878468636469772, 0.0791661274605434],
  [0.0423756549057051, 0.0784336, 0.879142973793104],
];
const ACES_IN = [
  [0.59719, 0.35458, 0.04823],
  [0.076, 0.90834, 0.01566],
  [0.0284, 0.13383, 0.83777],
];
const ACES_OUT = [
  [1.60475, -0.53108, -0.07367],
  [-0.10208, 1.10813, -0.00605],
  [-0.00327, -0.07276, 1.07602],
];

/** The matrix of these rows, each brought to a sum of 1, so that grey stays grey. */
function neutral(rows: number[][]): Matrix3 {
  const values = rows.flatMap((row) => row.map((value) => value / row.reduce((sum, one) => sum + one, 0)));
  return new Matrix3().set(...(values as Parameters<Matrix3["set"]>));
}

/** Exposure and matrices, which all materials share. */
export const toneUniforms = () => ({
  exposure: { value: 1 },
  agxIn: { value: neutral(INSET) },
  agxOut: { value: neutral(INSET).invert() },
  acesIn: { value: neutral(ACES_IN) },
  acesOut: { value: neutral(ACES_OUT) },
});
