// Lights as people place them: which one moves, from where it shines, how strongly.

import { Vector3 } from "three";
import type { Light, Showing, Triple } from "./types";

/** Light that has a place or direction, which can be dragged. */
export type Movable = Extract<Light, { type: "point" | "spot" | "directional" | "sphere" | "rectangle" }>;

export const movable = (light: Light): light is Movable => !["studio", "environment"].includes(light.type);

/** The lights with a studio's lamps in its place, as the service placed them. */
export function expanded(lights: Light[], showing: Showing | null): Light[] {
  if (!showing || !lights.some((light) => light.type === "studio")) return lights;
  return showing.lights;
}

/** The same to be written into the scene: null while what the service placed is of other lights. */
export function apart(lights: Light[], showing: Showing | null): Light[] | null {
  if (!lights.some((light) => light.type === "studio")) return lights;
  return showing && JSON.stringify(showing.asked) === JSON.stringify(lights) ? showing.lights : null;
}

const vector = (values: Triple): Vector3 => new Vector3(...values);

/** Unit direction from the object's centre to a light. */
export function towards(light: Movable, centre: Vector3): Vector3 {
  const to = light.type === "directional" ? vector(light.direction) : vector(light.position_mm).sub(centre);
  return to.lengthSq() > 0 ? to.normalize() : new Vector3(0, 0, 1);
}

/** The light in another direction from the centre, as far away as before; what aims goes on aiming. */
export function aimed(light: Movable, centre: Vector3, direction: Vector3): Movable {
  if (light.type === "directional") return { ...light, direction: direction.toArray() };
  const distance = vector(light.position_mm).distanceTo(centre);
  const position_mm = centre.clone().addScaledVector(direction, distance).toArray();
  if (light.type === "spot") return { ...light, position_mm, direction: direction.clone().negate().toArray() };
  if (light.type === "rectangle") {
    const width = vector(light.width_mm).length();
    const height = vector(light.height_mm).length();
    const across = new Vector3(0, 1, 0).cross(direction);
    if (across.lengthSq() < 1e-9) across.set(1, 0, 0);
    across.normalize();
    const up = direction.clone().cross(across);
    return { ...light, position_mm, width_mm: across.multiplyScalar(width).toArray(), height_mm: up.multiplyScalar(height).toArray() };
  }
  return { ...light, position_mm };
}

/** The same light on an object that is `ratio` times as large: as bright there, seen from the same side. */
export function resized(light: Light, ratio: number): Light {
  const grown = (place: Triple) => place.map((one) => one * ratio) as Triple;
  switch (light.type) {
    case "point":
    case "spot":
      return { ...light, position_mm: grown(light.position_mm), intensity_w_per_sr: light.intensity_w_per_sr.map((one) => one * ratio ** 2) as Triple };
    case "sphere":
      return { ...light, position_mm: grown(light.position_mm), radius_mm: light.radius_mm * ratio };
    case "rectangle":
      return { ...light, position_mm: grown(light.position_mm), width_mm: grown(light.width_mm), height_mm: grown(light.height_mm) };
    default:
      return light;
  }
}

/** Distance from the centre [mm]; none for distant lights. */
export function distanceOf(light: Movable, centre: Vector3): number | null {
  return light.type === "directional" ? null : vector(light.position_mm).distanceTo(centre);
}

type Power = "intensity_w_per_sr" | "irradiance_w_per_m2" | "radiance";

const FIELD: Record<Exclude<Light["type"], "studio">, Power> = {
  point: "intensity_w_per_sr",
  spot: "intensity_w_per_sr",
  directional: "irradiance_w_per_m2",
  rectangle: "radiance",
  sphere: "radiance",
  environment: "radiance",
};

export const UNITS: Record<Power, string> = {
  intensity_w_per_sr: "W/sr",
  irradiance_w_per_m2: "W/m²",
  radiance: "W/(m² sr)",
};

/** The field that says how strong a light is. */
export const powerField = (light: Exclude<Light, { type: "studio" }>): Power => FIELD[light.type];

export function powerOf(light: Light): Triple {
  if (light.type === "studio") return [light.intensity, light.intensity, light.intensity];
  return (light as unknown as Record<Power, Triple>)[powerField(light)];
}

export function withPower<L extends Light>(light: L, power: Triple): L {
  if (light.type === "studio") return { ...light, intensity: power[0] };
  return { ...light, [powerField(light)]: power };
}

/** The lamp that gives `irradiance` [W/m²] at the centre, `distance` [mm] away. */
export function lamp(direction: Triple, irradiance: Triple, centre: Vector3, distance: number): Light {
  const position_mm = centre.clone().addScaledVector(vector(direction).normalize(), distance).toArray();
  const factor = (distance / 1000) ** 2;
  return { type: "point", position_mm, intensity_w_per_sr: irradiance.map((one) => one * factor) as Triple };
}

export interface Setup {
  name: string;
  what: string;
  make(centre: Vector3, diagonal: number): Light[];
}

const PI = Math.PI;

export const SETUPS: Setup[] = [
  { name: "Studio", what: "A key, a rim from behind, a dim fill", make: () => [{ type: "studio", intensity: 1.3 }] },
  {
    name: "From behind",
    what: "See what shines through thin parts",
    make: (centre, size) => [lamp([-0.25, 0.35, -1], [3.2 * PI, 3 * PI, 2.8 * PI], centre, 2 * size), lamp([0.7, 0.2, 1], [0.12, 0.14, 0.17], centre, 2 * size)],
  },
  {
    name: "From the side",
    what: "Light and shadow meet in a soft, coloured edge",
    make: (centre, size) => [lamp([1, 0.35, 0.25], [1.6 * PI, 1.55 * PI, 1.5 * PI], centre, 2 * size)],
  },
  { name: "Sun", what: "A distant light", make: () => [{ type: "directional", direction: [0.5, 0.7, 0.6], irradiance_w_per_m2: [3.6, 3.5, 3.3] }, { type: "environment", radiance: [0.12, 0.15, 0.2] }] },
  { name: "Cloudy", what: "Even light from everywhere", make: () => [{ type: "environment", radiance: [0.9, 0.95, 1.05] }] },
];
