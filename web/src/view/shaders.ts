// What the surface shows: baked light on its way out, highlights, exposure and tone map.
// The same formulas as texsss/view; so turning, glossing and exposing cost the service nothing.

/** How many lights make highlights. */
export const LIGHTS = 8;

/** What the surface shows, by number. */
export const SHOWS = { picture: 0, light: 1, data: 2, direction: 3 } as const;

export const TONEMAPS = { linear: 0, agx: 1, aces: 2 } as const;

const TONE = /* glsl */ `
uniform float exposure; // factor
uniform int tonemap;
uniform mat3 agxIn, agxOut, acesIn, acesOut;

vec3 encode(vec3 c) {
  c = clamp(c, 0.0, 1.0);
  return mix(12.92 * c, 1.055 * pow(max(c, 1e-6), vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c));
}
vec3 display(vec3 light) {
  light = clamp(light * exposure, 0.0, 1e6);
  if (tonemap == 1) {
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
  }
  if (tonemap == 2) {
    vec3 x = acesIn * light;
    x = (x * (x + 0.0245786) - 0.000090537) / (x * (0.983729 * x + 0.4329510) + 0.238081);
    light = acesOut * x;
  }
  return encode(light);
}
// half a level of noise, so that dark gradients don't band
vec3 dithered(vec3 c) {
  float noise = fract(52.9829189 * fract(dot(gl_FragCoord.xy, vec2(0.06711056, 0.00583715))));
  return c + (noise - 0.5) / 255.0;
}
`;

export const BACKDROP = {
  vertex: /* glsl */ `
out float height;
void main() {
  height = position.y * 0.5 + 0.5;
  gl_Position = vec4(position.xy, 1.0, 1.0);
}`,
  fragment: /* glsl */ `
in float height;
out vec4 colour;
uniform vec3 top, bottom;
${TONE}
void main() {
  colour = vec4(dithered(display(mix(bottom, top, height))), 1.0);
}`,
};

export const SURFACE = {
  vertex: /* glsl */ `
in vec2 atlas, source;
out vec3 vPosition, vNormal;
out vec2 vAtlas, vSource;
uniform float unfold;
uniform vec3 sheetCentre, sheetRight, sheetUp;
void main() {
  vPosition = position;
  vNormal = normal;
  vAtlas = atlas;
  vSource = source;
  vec3 flat_ = sheetCentre + sheetRight * (atlas.x - 0.5) + sheetUp * (0.5 - atlas.y);
  gl_Position = projectionMatrix * modelViewMatrix * vec4(mix(position, flat_, unfold), 1.0);
}`,
  fragment: /* glsl */ `
in vec3 vPosition, vNormal;
in vec2 vAtlas, vSource;
out vec4 colour;
uniform int show;
uniform sampler2D lightA, lightB, albedo, roughnessMap, specularMap, normalMap, march;
uniform bool hasAlbedo, hasRoughness, hasSpecular, hasNormal, albedoRoot, difference;
uniform float scaleA, scaleB; // of the images, which may hold fractions
uniform float marched, unfold, normalY;
uniform float eta, transmittance, roughness, specular, secondLobe;
uniform vec2 range, viewport;
uniform int lightCount;
uniform vec4 lightPlace[${LIGHTS}];  // position [mm], 1; or direction, 0
uniform vec3 lightPower[${LIGHTS}];  // W/sr × 1e6, or W/m²
uniform vec4 lightCone[${LIGHTS}];   // axis, cosine of the outer angle; -2: none
uniform vec3 ambient;
${TONE}
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
vec3 highlights(vec3 n, vec3 v, float rough) {
  vec3 total = vec3(0.0);
  float coarse = min(rough * 1.6, 1.0);
  for (int i = 0; i < ${LIGHTS}; i++) {
    if (i >= lightCount) break;
    vec3 to = lightPlace[i].xyz - vPosition * lightPlace[i].w;
    float d2 = lightPlace[i].w > 0.5 ? dot(to, to) : 1.0;
    vec3 l = normalize(to);
    float cone = lightCone[i].w > -1.5 ? smoothstep(lightCone[i].w, mix(lightCone[i].w, 1.0, 0.4), dot(-l, lightCone[i].xyz)) : 1.0;
    float value = lobe(n, v, l, rough);
    if (secondLobe > 0.0) value = mix(value, lobe(n, v, l, coarse), secondLobe);
    total += lightPower[i] / d2 * cone * value;
  }
  // even surroundings, by the fit of Karis 2014
  float c = clamp(dot(n, v), 0.0, 1.0);
  vec4 r = rough * vec4(-1.0, -0.0275, -0.572, 0.022) + vec4(1.0, 0.0425, 1.04, -0.04);
  float a004 = min(r.x * r.x, exp2(-9.28 * c)) * r.x + r.y;
  vec2 ab = vec2(-1.04, 1.04) * a004 + r.zw;
  float f0 = (eta - 1.0) * (eta - 1.0) / ((eta + 1.0) * (eta + 1.0));
  return total + ambient * (eta == 1.0 ? 0.0 : f0 * ab.x + ab.y);
}
vec3 mapped(vec3 n) {
  vec3 px = dFdx(vPosition), py = dFdy(vPosition);
  vec2 ux = dFdx(vSource), uy = dFdy(vSource);
  vec3 t = cross(py, n) * ux.x + cross(n, px) * uy.x;
  vec3 b = -(cross(py, n) * ux.y + cross(n, px) * uy.y); // v runs down
  float scale = inversesqrt(max(max(dot(t, t), dot(b, b)), 1e-20));
  vec3 m = texture(normalMap, vSource).xyz * 2.0 - 1.0;
  return normalize(t * scale * m.x + b * scale * m.y * normalY + n * m.z);
}
vec3 viridis(float t) {
  const vec3 c0 = vec3(0.2777, 0.0054, 0.3341), c1 = vec3(0.1051, 1.4046, 1.3846), c2 = vec3(-0.3309, 0.2148, 0.0951);
  const vec3 c3 = vec3(-4.6342, -5.7991, -19.3324), c4 = vec3(6.2283, 14.1799, 56.6906), c5 = vec3(4.7764, -13.7451, -65.3530), c6 = vec3(-5.4355, 4.6459, 26.3124);
  return c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * (c5 + t * c6)))));
}
void main() {
  vec3 n = normalize(vNormal);
  vec3 v = normalize(mix(cameraPosition - vPosition, n, unfold));
  if (hasNormal) n = mapped(n);
  float c = dot(n, v);
  if (c < 0.02) n = 0.02 * v + 0.9998 * normalize(n - c * v);
  c = max(c, 0.02);
  vec3 m = texture(lightB, vAtlas).rgb * scaleB;
  if (show == ${SHOWS.data}) {
    float t = clamp((m.g - range.x) / max(range.y - range.x, 1e-12), 0.0, 1.0);
    colour = vec4(clamp(viridis(t), 0.0, 1.0) * (0.82 + 0.18 * c), 1.0);
    return;
  }
  if (show == ${SHOWS.direction}) {
    colour = vec4(clamp((m - range.x) / max(range.y - range.x, 1e-12), 0.0, 1.0), 1.0);
    return;
  }
  vec3 tint = vec3(1.0);
  if (hasAlbedo) {
    tint = texture(albedo, vSource).rgb;
    if (albedoRoot) tint = sqrt(tint);
  }
  if (difference) {
    vec3 d = abs(m - texture(lightA, vAtlas).rgb * scaleA) * tint / PI;
    float t = clamp(max(d.r, max(d.g, d.b)) / max(range.y, 1e-12), 0.0, 1.0);
    colour = vec4(clamp(viridis(t), 0.0, 1.0), 1.0);
    return;
  }
  if (show == ${SHOWS.light}) {
    colour = vec4(dithered(display(m / PI)), 1.0);
    return;
  }
  vec3 light = m * tint * (1.0 - fresnel(c, eta)) / (PI * transmittance);
  float rough = hasRoughness ? texture(roughnessMap, vSource).g : roughness;
  float strength = hasSpecular ? texture(specularMap, vSource).g : specular;
  if (unfold < 0.5) light += strength * highlights(n, v, rough);
  if (marched > 0.0) light = mix(light, texture(march, vec2(gl_FragCoord.x, viewport.y - gl_FragCoord.y) / viewport).rgb, marched);
  colour = vec4(dithered(display(light)), 1.0);
}`,
};

export const LINES = {
  vertex: /* glsl */ `
in vec2 atlas;
uniform float unfold;
uniform vec3 sheetCentre, sheetRight, sheetUp;
void main() {
  vec3 flat_ = sheetCentre + sheetRight * (atlas.x - 0.5) + sheetUp * (0.5 - atlas.y);
  gl_Position = projectionMatrix * modelViewMatrix * vec4(mix(position, flat_, unfold), 1.0);
  gl_Position.z -= 2e-4 * gl_Position.w; // in front of the surface they lie on
}`,
  fragment: /* glsl */ `
out vec4 colour;
void main() { colour = vec4(1.0, 0.86, 0.35, 1.0); }`,
};

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

/** Rows that sum to 1, so that grey stays grey. */
const neutral = (rows: number[][]): number[] =>
  rows.flatMap((row) => row.map((value) => value / row.reduce((sum, one) => sum + one, 0)));

export const MATRICES = { agx: neutral(INSET), acesIn: neutral(ACES_IN), acesOut: neutral(ACES_OUT) };
