// How a surface looks besides its baked light: gloss, maps, highlights; two of them can be compared.

import { type Texture, Vector2, Vector3, Vector4 } from "three";
import type { State } from "../state";
import type { Light, Showing, Triple } from "../types";
import { LIGHTS } from "./shaders";
import { blank } from "./textures";

export type MapName = "albedo" | "roughnessMap" | "specularMap" | "normalMap";

const MM2_PER_M2 = 1e6;

/** What differs between the sides of a comparison. */
export interface Look {
  light: Texture;
  scale: number;
  /** The service's picture of this view, and how much of it is shown. */
  march: Texture;
  marched: number;
  maps: Record<MapName, Texture | null>;
  roughness: number;
  specular: number;
  secondLobe: number;
  albedoRoot: boolean;
  normalY: number;
  eta: number;
  transmittance: number;
  beams: Beam[];
  ambient: Vector3;
}

/** A light as highlights and their shadows see it: from one place, or from far away. */
export interface Beam {
  /** [mm], 1; or towards it, 0. */
  place: Vector4;
  /** [W/sr × 1e6], or [W/m²]. */
  power: Vector3;
  /** Axis, and the cosine of the angle where it ends; -2: it shines everywhere. */
  cone: Vector4;
  /** Cosine of the angle up to which it is whole. */
  inner: number;
}

export function newLook(): Look {
  return {
    light: blank,
    scale: 1,
    march: blank,
    marched: 0,
    maps: { albedo: null, roughnessMap: null, specularMap: null, normalMap: null },
    roughness: 0.4,
    specular: 1,
    secondLobe: 0,
    albedoRoot: false,
    normalY: 1,
    eta: 1.3,
    transmittance: 1,
    beams: [],
    ambient: new Vector3(),
  };
}

/** Takes over what a state and the service say. */
export function dressLook(look: Look, state: State, showing: Showing | null, lights: Light[]): void {
  const { surface } = state;
  const number = (value: unknown, otherwise: number) => (typeof value === "number" ? value : otherwise);
  look.roughness = number(surface.roughness, 0.4);
  look.specular = number(surface.specular, 1);
  look.secondLobe = surface.second_lobe ?? 0;
  look.albedoRoot = surface.albedo_mode === "both";
  look.normalY = surface.normal_y === "-y" ? -1 : 1;
  look.eta = showing?.eta ?? look.eta;
  look.transmittance = showing?.transmittance ?? look.transmittance;
  look.beams = beamsOf(lights);
  look.ambient.set(0, 0, 0);
  for (const light of lights)
    if (light.type === "environment" && !light.map) look.ambient.add(new Vector3(...light.radiance));
}

const uniform = <T>(value: T) => ({ value });

/** Where the unfolded surface lies. */
export const sheetUniforms = () => ({
  unfold: uniform(0),
  sheetCentre: uniform(new Vector3()),
  sheetRight: uniform(new Vector3(1, 0, 0)),
  sheetUp: uniform(new Vector3(0, 1, 0)),
});

export const surfaceUniforms = () => ({
  lightA: uniform<Texture>(blank),
  lightB: uniform<Texture>(blank),
  scaleA: uniform(1),
  scaleB: uniform(1),
  albedo: uniform<Texture>(blank),
  albedoA: uniform<Texture>(blank),
  roughnessMap: uniform<Texture>(blank),
  specularMap: uniform<Texture>(blank),
  normalMap: uniform<Texture>(blank),
  march: uniform<Texture>(blank),
  viewport: uniform(new Vector2(1, 1)),
  marched: uniform(0),
  dim: uniform(1),
  normalY: uniform(1),
  eta: uniform(1.3),
  transmittance: uniform(1),
  roughness: uniform(0.4),
  specular: uniform(1),
  secondLobe: uniform(0),
  range: uniform(new Vector2(0, 1)),
  lightPlace: uniform(Array.from({ length: LIGHTS }, () => new Vector4())),
  lightPower: uniform(Array.from({ length: LIGHTS }, () => new Vector3())),
  lightCone: uniform(Array.from({ length: LIGHTS }, () => new Vector4())),
  lightInner: uniform(new Array<number>(LIGHTS).fill(1)),
  ambient: uniform(new Vector3()),
});

export type SurfaceUniforms = ReturnType<typeof surfaceUniforms>;

/** What the shader's defines say of a look. */
export function lookDefines(look: Look): Record<string, number> & { LIGHTS: number } {
  const { albedo, roughnessMap, specularMap, normalMap } = look.maps;
  const defines: Record<string, number> & { LIGHTS: number } = { LIGHTS: look.beams.length };
  if (albedo) defines.ALBEDO = look.albedoRoot ? 2 : 1;
  if (roughnessMap) defines.ROUGHNESS_MAP = 1;
  if (specularMap) defines.SPECULAR_MAP = 1;
  if (normalMap) defines.NORMAL_MAP = 1;
  if (albedo || roughnessMap || specularMap || normalMap) defines.SOURCE = 1;
  if (look.secondLobe > 0) defines.SECOND_LOBE = 1;
  return defines;
}

/** What B is held against, where their difference is shown; gives the defines that it needs. */
export function applyOther(look: Look, to: SurfaceUniforms): Record<string, number> {
  to.lightA.value = look.light;
  to.scaleA.value = look.scale;
  to.albedoA.value = look.maps.albedo ?? blank;
  return look.maps.albedo ? { DIFFERENCE: 1, ALBEDO_A: look.albedoRoot ? 2 : 1, SOURCE: 1 } : { DIFFERENCE: 1 };
}

/** Puts a look into the uniforms. */
export function applyLook(look: Look, to: SurfaceUniforms): void {
  to.lightB.value = look.light;
  to.scaleB.value = look.scale;
  to.march.value = look.march;
  to.marched.value = look.marched;
  for (const name of Object.keys(look.maps) as MapName[]) to[name].value = look.maps[name] ?? blank;
  for (const name of ["roughness", "specular", "secondLobe", "normalY", "eta", "transmittance"] as const) to[name].value = look[name];
  to.ambient.value.copy(look.ambient);
  look.beams.forEach(({ place, power, cone, inner }, i) => {
    to.lightInner.value[i] = inner;
    to.lightPlace.value[i].copy(place);
    to.lightPower.value[i].copy(power);
    to.lightCone.value[i].copy(cone);
  });
}

/** The first lights that make highlights; those with a size count as points. */
function beamsOf(lights: Light[]): Beam[] {
  const found: Beam[] = [];
  const add = (place: Triple, w: number, power: Triple, factor: number, axis?: Triple, outer_deg = 0, inner_deg = 0) => {
    const direction = new Vector3(...(axis ?? [0, 0, 1])).normalize();
    const cosine = axis ? Math.cos((outer_deg * Math.PI) / 180) : -2;
    const inner = Math.cos((Math.min(inner_deg, outer_deg - 0.01) * Math.PI) / 180);
    const cone = new Vector4(...direction.toArray(), cosine);
    found.push({ place: new Vector4(...place, w), power: new Vector3(...power).multiplyScalar(factor), cone, inner });
  };
  for (const light of lights) {
    if (light.type === "point") add(light.position_mm, 1, light.intensity_w_per_sr, MM2_PER_M2);
    else if (light.type === "spot")
      add(light.position_mm, 1, light.intensity_w_per_sr, MM2_PER_M2, light.direction, light.outer_deg ?? 25, light.inner_deg ?? 20);
    else if (light.type === "directional")
      add(new Vector3(...light.direction).normalize().toArray(), 0, light.irradiance_w_per_m2, 1);
    else if (light.type === "sphere") add(light.position_mm, 1, light.radiance, Math.PI * light.radius_mm ** 2);
    else if (light.type === "rectangle") {
      const across = new Vector3(...light.width_mm).cross(new Vector3(...light.height_mm));
      const area = across.length();
      add(light.position_mm, 1, light.radiance, area, across.normalize().toArray(), 90); // by the cosine
    }
  }
  return found.slice(0, LIGHTS);
}
