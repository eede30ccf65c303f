// What is asked of the service for a scene: those of its parts that the answer depends on.

import type { Scene } from "./types";

/** The edge of the lightmap while something moves; the service warms this size. */
export const DRAFT = 256;

export type Baked = ReturnType<typeof bakedPart>;

/** What the baked light depends on: what the page's own shader does and what is marched for a view is left out. */
export function bakedPart(scene: Omit<Scene, "camera">): Omit<Scene, "camera" | "output"> {
  const { output: _output, ...rest } = scene;
  const methods: Scene["methods"] = { ...rest.methods, single_scattering: "none", march_samples: 4 };
  delete methods.march;
  const { albedo, albedo_mode, normalise, normal, normal_y } = scene.material.surface;
  const lights = rest.lights;
  const used = new Set<string>(
    JSON.stringify([rest.material.layers, rest.material.depths, rest.media, rest.lights, albedo, normal, methods.diffusion === "parallax" && methods.parallax]).match(/"[^"]*"/g)?.map((s) => s.slice(1, -1)),
  );
  const maps = Object.fromEntries(Object.entries(rest.maps).filter(([name]) => used.has(name)));
  const surface = strip({ albedo, albedo_mode, normalise, normal, normal_y });
  return { ...rest, methods, lights, maps, material: { layers: rest.material.layers, depths: rest.material.depths, surface } };
}

/** The object without fields that are undefined. */
function strip<T extends object>(value: T): T {
  return Object.fromEntries(Object.entries(value).filter(([, one]) => one !== undefined)) as T;
}

/** What mesh and atlas are made from. */
export const groundPart = ({ mesh, atlas }: Pick<Scene, "mesh" | "atlas">) => ({ mesh, atlas });

/** The scene with a lightmap as small as a draft's. */
export const draftPart = (scene: Baked): Baked => ({ ...scene, atlas: { ...scene.atlas, raster: Math.min(DRAFT, scene.atlas.size) } });

/** The names of the maps that the page's own shader uses. */
export function shownMaps({ material, methods }: Pick<Scene, "material" | "methods">) {
  const { albedo, albedo_mode, roughness, specular, normal } = material.surface;
  return {
    albedo: albedo_mode === "pre" || methods.diffusion === "parallax" ? undefined : albedo, // else it is in the light
    roughnessMap: typeof roughness === "string" ? roughness : undefined,
    specularMap: typeof specular === "string" ? specular : undefined,
    normalMap: normal,
  };
}

/** One map of the scene. */
export const mapPart = ({ maps }: Pick<Scene, "maps">, name: string) => ({ maps: { [name]: maps[name] } });
