// The scene as the service takes it; see GET /v1/schema. Lengths in mm, colours linear.

export type Triple = [number, number, number];

export interface Source {
  asset?: string;
  builtin?: string;
  path?: string;
}

export interface MapSpec {
  source: Source;
  space?: "srgb" | "linear";
  channel?: "rgb" | "rgba" | "r" | "g" | "b" | "a" | "luminance";
}

export interface MapValue {
  map: string;
  range?: [number, number];
  invert?: boolean;
}

export interface MediumSpec {
  preset?: string;
  sigma_a_per_mm?: number | Triple | MapValue;
  sigma_s_per_mm?: number | Triple | MapValue;
  g?: number | Triple;
  eta?: number;
  phase?: "henyey-greenstein" | "schlick";
}

export interface Mix {
  mix: [string, string];
  mask: string;
}

export interface LayerSpec {
  medium: string | Mix;
  thickness_mm?: number | MapValue | null;
}

/** Textures whose channels say where layers end. */
export interface Depths {
  maps: string[];
  range_mm: [number, number];
  invert?: boolean;
  sort?: boolean;
}

export interface Surface {
  albedo?: string;
  albedo_mode?: "pre" | "post" | "both";
  normalise?: boolean;
  normal?: string;
  normal_y?: "+y" | "-y";
  roughness?: number | string;
  specular?: number | string;
  second_lobe?: number;
}

export type Light =
  | { type: "studio"; intensity: number }
  | { type: "point"; position_mm: Triple; intensity_w_per_sr: Triple }
  | { type: "directional"; direction: Triple; irradiance_w_per_m2: Triple }
  | {
      type: "spot";
      position_mm: Triple;
      direction: Triple;
      intensity_w_per_sr: Triple;
      inner_deg: number;
      outer_deg: number;
    }
  | { type: "rectangle"; position_mm: Triple; width_mm: Triple; height_mm: Triple; radiance: Triple }
  | { type: "sphere"; position_mm: Triple; radius_mm: number; radiance: Triple }
  | { type: "environment"; radiance: Triple; map?: string; rotation_deg?: number; samples?: number };

export interface Camera {
  fit?: boolean;
  direction?: Triple;
  position_mm?: Triple;
  target_mm?: Triple;
  fov_y_deg: number;
  resolution?: [number, number];
  samples?: number;
}

export interface Methods {
  profile: "dipole" | "better-dipole" | "multipole" | "layered-diffusion" | "layered-sp3";
  diffusion: "none" | "uv" | "surface" | "octree" | "poisson" | "parallax";
  rule: "exit" | "entry" | "geometric-mean";
  terms: number;
  incidence: "diffuse" | "normal" | { angle_deg: number };
  single_scattering: "auto" | "none" | "uniform" | "exact";
  march_samples: number;
  transmission?: boolean;
  /** How often light that left one part of the object lights others. */
  interreflection?: number;
  /** Beside a march, other light enters and leaves by its angle. */
  angular?: boolean;
  octree?: { epsilon: number };
  poisson?: { taps: number; passes: number; reduction: number };
  march?: { noise: number; noise_uv: number; deepest_mm: number | number[] | null; noise_map?: string | null };
  parallax?: Parallax;
}

/** Pictures beneath the surface, from the outermost down. */
export interface Parallax {
  opacity?: number | string | null;
  layers: { base: string; depth_mm: number; opacity?: number | string; spread?: number }[];
}

/** What the service takes where a scene is silent. */
export const OCTREE: NonNullable<Methods["octree"]> = { epsilon: 0.05 };
export const POISSON: NonNullable<Methods["poisson"]> = { taps: 12, passes: 2, reduction: 2 };
export const MARCH: NonNullable<Methods["march"]> = { noise: 0, noise_uv: 0, deepest_mm: null };

export type Tonemap = "linear" | "agx" | "aces";

export interface Scene {
  version?: 1;
  mesh: { source: Source; unit_mm?: number; up?: string; v?: string };
  atlas: { uv?: string; size: number; padding_texels?: number; raster?: number };
  maps: Record<string, MapSpec>;
  media: Record<string, MediumSpec>;
  material: { layers: LayerSpec[]; depths?: Depths; surface: Surface };
  lights: Light[];
  camera: Camera;
  methods: Methods;
  output: { exposure_ev: number; tonemap: Tonemap; background?: Triple };
  seed?: number;
}

/** What POST /v1/showing answers. */
export interface Showing {
  geometry: string;
  mesh: { name: string; faces: number; unit_mm: number; unit_assumed: boolean; box_mm: [Triple, Triple] };
  atlas: { origin: string; charts: number; texels: number; texel_mm: number };
  lights: Light[];
  /** What `lights` is the answer to; the page's own note. */
  asked?: Light[];
  /** What all of this depends on; the page's own note, too. */
  place?: string;
  background: Triple | [Triple, Triple];
  eta: number;
  transmittance: number;
  variances_mm2: number[];
}

export interface Preset {
  name: string;
  sigma_a_per_mm: Triple;
  sigma_s_per_mm: Triple;
  g: Triple | [number];
  eta: number;
  mean_free_path_mm: Triple;
}

/** What POST /v1/profile answers. */
export interface Profile {
  r_mm: number[];
  /** The profile itself; of its sum of Gaussians, see there. */
  reflectance_per_mm2: number[][];
  total: number[];
  gaussians: { variances_mm2: number[]; weights: number[][]; reflectance_per_mm2: number[][] };
  radius_mm: Record<string, number[]>;
  mean_free_path_mm: (number | null)[];
  diffusion_length_mm: (number | null)[];
  fit_error: number[];
  /** Per channel, where Monte Carlo was asked. */
  monte_carlo: (Rings | null)[];
}

/** A profile over rings, with its standard error. */
export interface Rings {
  r_mm: number[];
  reflectance_per_mm2: number[];
  error_per_mm2: number[];
}

export interface Asset {
  asset: string;
  kind: "mesh" | "map";
  name: string;
  bytes: number;
}
