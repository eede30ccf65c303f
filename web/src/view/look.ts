// How a surface looks besides its baked light: gloss, maps, highlights; two of them can be compared.

import { Matrix3, type Texture, Vector2, Vector3, Vector4 } from "three";
import type { State } from "../state";
import type { Light, Showing, Triple } from "../types";
import { LIGHTS, MATRICES, SHOWS } from "./shaders";
import { blank } from "./textures";

export type MapName = "albedo" | "roughnessMap" | "specularMap" | "normalMap";

const MM2_PER_M2 = 1e6;

/** What differs between the sides of a comparison. */
export interface Look {
  light: Texture;
  scale: number;
  maps: Record<MapName, Texture | null>;
  roughness: number;
  specular: number;
  secondLobe: number;
  albedoRoot: boolean;
  normalY: number;
  eta: number;
  transmittance: number;
  lights: Light[];
}

export function newLook(): Look {
  return {
    light: blank,
    scale: 1,
    maps: { albedo: null, roughnessMap: null, specularMap: null, normalMap: null },
    roughness: 0.4,
    specular: 1,
    secondLobe: 0,
    albedoRoot: false,
    normalY: 1,
    eta: 1.3,
    transmittance: 1,
    lights: [],
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
  look.lights = lights;
}

const uniform = <T>(value: T) => ({ value });

const rows = (values: number[]): Matrix3 => new Matrix3().set(...(values as Parameters<Matrix3["set"]>));

/** Exposure and tone map, which all materials share. */
export const toneUniforms = () => ({
  exposure: uniform(1),
  tonemap: uniform(0),
  agxIn: uniform(rows(MATRICES.agx)),
  agxOut: uniform(rows(MATRICES.agx).invert()),
  acesIn: uniform(rows(MATRICES.acesIn)),
  acesOut: uniform(rows(MATRICES.acesOut)),
});

/** Where the unfolded surface lies. */
export const sheetUniforms = () => ({
  unfold: uniform(0),
  sheetCentre: uniform(new Vector3()),
  sheetRight: uniform(new Vector3(1, 0, 0)),
  sheetUp: uniform(new Vector3(0, 1, 0)),
});

export const surfaceUniforms = () => ({
  show: uniform<number>(SHOWS.picture),
  lightA: uniform<Texture>(blank),
  lightB: uniform<Texture>(blank),
  scaleA: uniform(1),
  scaleB: uniform(1),
  albedo: uniform<Texture>(blank),
  roughnessMap: uniform<Texture>(blank),
  specularMap: uniform<Texture>(blank),
  normalMap: uniform<Texture>(blank),
  march: uniform<Texture>(blank),
  hasAlbedo: uniform(false),
  hasRoughness: uniform(false),
  hasSpecular: uniform(false),
  hasNormal: uniform(false),
  albedoRoot: uniform(false),
  difference: uniform(false),
  viewport: uniform(new Vector2(1, 1)),
  marched: uniform(0),
  normalY: uniform(1),
  eta: uniform(1.3),
  transmittance: uniform(1),
  roughness: uniform(0.4),
  specular: uniform(1),
  secondLobe: uniform(0),
  range: uniform(new Vector2(0, 1)),
  lightCount: uniform(0),
  lightPlace: uniform(Array.from({ length: LIGHTS }, () => new Vector4())),
  lightPower: uniform(Array.from({ length: LIGHTS }, () => new Vector3())),
  lightCone: uniform(Array.from({ length: LIGHTS }, () => new Vector4(0, 0, 1, -2))),
  ambient: uniform(new Vector3()),
});

export type SurfaceUniforms = ReturnType<typeof surfaceUniforms>;

const HAS = { albedo: "hasAlbedo", roughnessMap: "hasRoughness", specularMap: "hasSpecular", normalMap: "hasNormal" } as const;

/** Puts a look into the uniforms. */
export function applyLook(look: Look, to: SurfaceUniforms): void {
  to.lightB.value = look.light;
  to.scaleB.value = look.scale;
  for (const name of Object.keys(HAS) as MapName[]) {
    to[name].value = look.maps[name] ?? blank;
    to[HAS[name]].value = look.maps[name] !== null;
  }
  for (const name of ["roughness", "specular", "secondLobe", "normalY", "eta", "transmittance"] as const) to[name].value = look[name];
  to.albedoRoot.value = look.albedoRoot;
  applyLights(look.lights, to);
}

/** The lights that make highlights; those with a size count as points, surroundings as even. */
function applyLights(lights: Light[], to: SurfaceUniforms): void {
  const { lightPlace, lightPower, lightCone, ambient } = to;
  ambient.value.set(0, 0, 0);
  let count = 0;
  const add = (place: Triple, w: number, power: Triple, factor: number, axis?: Triple, outer_deg = 0) => {
    if (count >= LIGHTS) return;
    lightPlace.value[count].set(...place, w);
    lightPower.value[count].fromArray(power).multiplyScalar(factor);
    const direction = new Vector3(...(axis ?? [0, 0, 1])).normalize();
    const cosine = axis ? Math.cos((outer_deg * Math.PI) / 180) : -2;
    lightCone.value[count].set(direction.x, direction.y, direction.z, cosine);
    count++;
  };
  for (const light of lights) {
    if (light.type === "point") add(light.position_mm, 1, light.intensity_w_per_sr, MM2_PER_M2);
    else if (light.type === "spot")
      add(light.position_mm, 1, light.intensity_w_per_sr, MM2_PER_M2, light.direction, light.outer_deg);
    else if (light.type === "directional")
      add(new Vector3(...light.direction).normalize().toArray(), 0, light.irradiance_w_per_m2, 1);
    else if (light.type === "sphere") add(light.position_mm, 1, light.radiance, Math.PI * light.radius_mm ** 2);
    else if (light.type === "rectangle") {
      const across = new Vector3(...light.width_mm).cross(new Vector3(...light.height_mm));
      const area = across.length();
      add(light.position_mm, 1, light.radiance, area, across.normalize().toArray(), 89);
    } else if (light.type === "environment" && !light.map) ambient.value.add(new Vector3(...light.radiance));
  }
  to.lightCount.value = count;
}
