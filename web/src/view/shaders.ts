// What the surface shows: baked light on its way out, highlights, exposure and tone map.
// The same formulas as texsss/view; so turning, glossing and exposing cost the service nothing.
//
// Defines, so that a pixel pays for nothing that is not asked for: SHOW, DIFFERENCE, ALBEDO (2: its root) and that
// of A, ROUGHNESS_MAP, SPECULAR_MAP, NORMAL_MAP, SOURCE (any of these five), SECOND_LOBE, MARCHED, LIGHTS, SHADOWS,
// TONEMAP; and QUICK: gloss is given at vertices, for frames that must come soon.

import { DITHER, TONE } from "./tone";

/** How many lights make highlights. */
export const LIGHTS = 8;

/** What the surface shows, by number. */
export const SHOWS = { picture: 0, light: 1, data: 2, direction: 3, grey: 4 } as const;

/** GLSL `placed(position, atlas)`: on the object, or on the sheet it is laid out on. */
export const SHEET = /* glsl */ `
uniform float unfold;
uniform vec3 sheetCentre, sheetRight, sheetUp;
vec4 placed(vec3 position, vec2 atlas) {
  vec3 sheet = sheetCentre + sheetRight * (atlas.x - 0.5) + sheetUp * (0.5 - atlas.y);
  return projectionMatrix * (modelViewMatrix * vec4(mix(position, sheet, unfold), 1.0));
}`;

/** GLSL `arriving(way, p)`: how much of a light arrives, by its depths. */
export const ARRIVING = /* glsl */ `
float arriving(mat4 way, vec3 p) {
  vec4 q = way * vec4(p, 1.0);
  return q.w <= 0.0 ? 1.0 : texture(shadowMap, q.xyz / q.w);
}`;

export const GLOSS = /* glsl */ `
uniform float eta, transmittance, roughness, specular, secondLobe;
#if LIGHTS > 0
uniform vec4 lightPlace[LIGHTS];  // position [mm], 1; or direction, 0
uniform vec3 lightPower[LIGHTS];  // W/sr × 1e6, or W/m²
uniform vec4 lightCone[LIGHTS];   // axis, cosine of the outer angle; -2: none
uniform float lightInner[LIGHTS]; // cosine of the inner angle
#endif
#if SHADOWS > 0
uniform mat4 shadowMatrix[SHADOWS];
uniform highp sampler2DShadow shadowMap;
#endif
uniform vec3 ambient;
const float PI = 3.14159265;

float fresnel(float mu, float n) {
  if (n == 1.0) return 0.0;
  float inner2 = 1.0 - (1.0 - mu * mu) / (n * n);
  if (inner2 <= 0.0) return 1.0;
  float inner = sqrt(inner2);
  float across = (mu - n * inner) / (mu + n * inner);
  float along = (n * mu - inner) / (n * mu + inner);
  return 0.5 * (across * across + along * along);
}
float stretch(float c, float a2) { return sqrt(a2 + (1.0 - a2) * c * c); }
float lobe(vec3 n, vec3 v, vec3 l, float rough) {
  float toLight = dot(n, l), toView = max(dot(n, v), 1e-6);
  if (toLight <= 0.0) return 0.0;
  float alpha = max(rough * rough, 1e-3), a2 = alpha * alpha;
  vec3 h = normalize(l + v);
  float toHalf = clamp(dot(n, h), 0.0, 1.0);
  vec3 s = cross(n, h);
  float d = dot(s, s) + a2 * toHalf * toHalf;
  float density = a2 / (PI * d * d);
  float masking = 0.5 / (toLight * stretch(toView, a2) + toView * stretch(toLight, a2));
  return density * masking * fresnel(clamp(dot(v, h), 0.0, 1.0), eta) * toLight;
}
#if SHADOWS > 0
${ARRIVING}
#endif
// radiance that the surface mirrors at p from the lights and even surroundings
vec3 highlights(vec3 n, vec3 v, vec3 p, float rough) {
  vec3 total = vec3(0.0);
#if LIGHTS > 0
  for (int i = 0; i < LIGHTS; i++) {
    vec3 to = lightPlace[i].xyz - p * lightPlace[i].w;
    float d2 = lightPlace[i].w > 0.5 ? dot(to, to) : 1.0;
    vec3 l = normalize(to);
    if (dot(n, l) <= 0.0) continue;
    float cone = lightCone[i].w > -1.5 ? smoothstep(lightCone[i].w, lightInner[i], dot(-l, lightCone[i].xyz)) : 1.0;
    float value = lobe(n, v, l, rough);
#ifdef SECOND_LOBE
    value = mix(value, lobe(n, v, l, min(rough * 1.6, 1.0)), secondLobe);
#endif
#if SHADOWS > 0
    if (i < SHADOWS && value > 1e-4) value *= arriving(shadowMatrix[i], p);
#endif
    total += lightPower[i] / d2 * cone * value;
  }
#endif
  // even surroundings, by the fit of Karis 2014
  float c = clamp(dot(n, v), 0.0, 1.0);
  vec4 r = rough * vec4(-1.0, -0.0275, -0.572, 0.022) + vec4(1.0, 0.0425, 1.04, -0.04);
  float a004 = min(r.x * r.x, exp2(-9.28 * c)) * r.x + r.y;
  vec2 ab = vec2(-1.04, 1.04) * a004 + r.zw;
  float f0 = (eta - 1.0) * (eta - 1.0) / ((eta + 1.0) * (eta + 1.0));
  return total + ambient * (eta == 1.0 ? 0.0 : f0 * ab.x + ab.y);
}
// turned so far towards the eye that it is seen
vec3 facing(vec3 n, vec3 v) {
  float c = dot(n, v);
  return c < 0.02 ? 0.02 * v + 0.9998 * normalize(n - c * v) : n;
}
// of the light beneath, how much leaves as radiance
float leaving(float c) { return (1.0 - fresnel(c, eta)) / (PI * transmittance); }
`;

export const VERTEX = /* glsl */ `
in vec2 atlas, source;
out vec2 vAtlas;
#ifdef SOURCE
out vec2 vSource;
#endif
${SHEET}
#ifdef QUICK
in vec4 gloss; // as view/gloss.ts has it
out vec4 vGloss;
#else
out vec3 vPosition, vNormal;
#endif
void main() {
  vAtlas = atlas;
#ifdef SOURCE
  vSource = source;
#endif
#ifdef QUICK
  vGloss = gloss;
#else
  vPosition = position;
  vNormal = normal;
#endif
  gl_Position = placed(position, atlas);
}`;

export const FRAGMENT = /* glsl */ `
in vec2 vAtlas;
#ifdef SOURCE
in vec2 vSource;
#endif
out vec4 colour;
uniform sampler2D lightB;
uniform float scaleB; // of the image, which may hold fractions
uniform float dim; // of the picture, while another is on its way
${TONE}
${DITHER}
vec3 tinted(vec3 t, int way) { return way == 2 ? sqrt(t) : t; }
#ifdef ALBEDO
uniform sampler2D albedo;
vec3 tint() { return tinted(texture(albedo, vSource).rgb, ALBEDO); }
#else
vec3 tint() { return vec3(1.0); }
#endif
#ifdef ALBEDO_A
uniform sampler2D albedoA;
vec3 tintA() { return tinted(texture(albedoA, vSource).rgb, ALBEDO_A); }
#else
vec3 tintA() { return vec3(1.0); }
#endif

#ifdef QUICK
in vec4 vGloss;
void main() { colour = vec4(display(dim * (texture(lightB, vAtlas).rgb * tint() * (scaleB * vGloss.a) + vGloss.rgb)), 1.0); }
#else

in vec3 vPosition, vNormal;
uniform sampler2D lightA, roughnessMap, specularMap, normalMap, march;
uniform float scaleA, marched, unfold, normalY;
uniform vec2 range, viewport;
${GLOSS}
#ifdef NORMAL_MAP
vec3 mapped(vec3 n) {
  vec3 px = dFdx(vPosition), py = dFdy(vPosition);
  vec2 ux = dFdx(vSource), uy = dFdy(vSource);
  vec3 t = cross(py, n) * ux.x + cross(n, px) * uy.x;
  vec3 b = -(cross(py, n) * ux.y + cross(n, px) * uy.y); // v runs down
  float scale = inversesqrt(max(max(dot(t, t), dot(b, b)), 1e-20));
  vec3 m = texture(normalMap, vSource).xyz * 2.0 - 1.0;
  return normalize(t * scale * m.x + b * scale * m.y * normalY + n * m.z);
}
#endif
vec3 viridis(float t) {
  const vec3 c0 = vec3(0.2777, 0.0054, 0.3341), c1 = vec3(0.1051, 1.4046, 1.3846), c2 = vec3(-0.3309, 0.2148, 0.0951);
  const vec3 c3 = vec3(-4.6342, -5.7991, -19.3324), c4 = vec3(6.2283, 14.1799, 56.6906), c5 = vec3(4.7764, -13.7451, -65.3530), c6 = vec3(-5.4355, 4.6459, 26.3124);
  return clamp(c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * (c5 + t * c6))))), 0.0, 1.0);
}
vec3 inRange(vec3 value) { return clamp((value - range.x) / max(range.y - range.x, 1e-12), 0.0, 1.0); }

void main() {
  vec3 n = normalize(vNormal);
  vec3 v = normalize(mix(cameraPosition - vPosition, n, unfold));
#ifdef NORMAL_MAP
  n = mapped(n);
#endif
  n = facing(n, v);
  float c = dot(n, v);
  vec3 m = texture(lightB, vAtlas).rgb * scaleB;
#if SHOW == ${SHOWS.data}
  colour = vec4(viridis(inRange(m).g) * (0.82 + 0.18 * c), 1.0);
#elif SHOW == ${SHOWS.direction}
  colour = vec4(inRange(m), 1.0);
#elif SHOW == ${SHOWS.grey}
  colour = vec4(vec3(0.12 + 0.38 * c), 1.0);
#elif defined(DIFFERENCE)
  vec3 d = abs(m * tint() - texture(lightA, vAtlas).rgb * scaleA * tintA()) / PI;
  colour = vec4(viridis(inRange(vec3(max(d.r, max(d.g, d.b)))).g), 1.0);
#elif SHOW == ${SHOWS.light}
  colour = vec4(dithered(display(m / PI)), 1.0);
#else
  vec3 light = m * tint() * leaving(c);
  float rough = roughness, strength = specular;
#ifdef ROUGHNESS_MAP
  rough = dot(texture(roughnessMap, vSource).rgb, vec3(1.0 / 3.0));
#endif
#ifdef SPECULAR_MAP
  strength = dot(texture(specularMap, vSource).rgb, vec3(1.0 / 3.0));
#endif
  if (unfold < 0.5) light += strength * highlights(n, v, vPosition, rough);
  light *= dim;
#ifdef MARCHED
  light = mix(light, texture(march, vec2(gl_FragCoord.x, viewport.y - gl_FragCoord.y) / viewport).rgb, marched);
#endif
  colour = vec4(dithered(display(light)), 1.0);
#endif
}
#endif`;
