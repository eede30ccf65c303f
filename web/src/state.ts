// What is undone, shared and saved: the scene as the panels see it, and the way to and from the service's.

import { fromColour, meanFreePath, toColour } from "./material";
import type { LayerSpec, Light, MapValue, MediumSpec, Methods, Preset, Scene, Triple } from "./types";

/** A layer as its card shows it. */
export interface Layer {
  /** Which of the fields below say what it is made of; `given`: as `medium` says, unknown to the card. */
  by: "preset" | "colour" | "coefficients" | "given";
  preset: string;
  colour: Triple;
  distance_mm: Triple;
  sigma_a: Triple;
  sigma_s: Triple;
  g: number;
  eta: number;
  phase?: MediumSpec["phase"];
  medium?: LayerSpec["medium"];
  /** null: without end. */
  thickness_mm: number | null;
  thickness_map: MapValue | null;
  muted: boolean;
}

/** A scene without its camera. */
export interface State extends Omit<Scene, "material" | "camera" | "version"> {
  layers: Layer[];
  depths?: Scene["material"]["depths"];
  surface: Scene["material"]["surface"];
}

const triple = (value: number | Triple | number[]): Triple =>
  (Array.isArray(value) ? (value.length === 3 ? value : [value[0], value[0], value[0]]) : [value, value, value]) as Triple;

/** A layer made of a preset. */
export function presetLayer(preset: Preset, thickness_mm: number | null): Layer {
  const sigma_a = triple(preset.sigma_a_per_mm);
  const sigma_s = triple(preset.sigma_s_per_mm);
  const g = triple(preset.g)[0];
  return {
    by: "preset",
    preset: preset.name,
    colour: toColour(sigma_a, sigma_s, g),
    distance_mm: meanFreePath(sigma_a, sigma_s),
    sigma_a,
    sigma_s,
    g,
    eta: preset.eta,
    thickness_mm,
    thickness_map: null,
    muted: false,
  };
}

/** Coefficients [1/mm] of a layer as it stands. */
export function coefficients(layer: Layer): { sigma_a: Triple; sigma_s: Triple } {
  return layer.by === "colour"
    ? fromColour(layer.colour, layer.distance_mm, layer.g)
    : { sigma_a: layer.sigma_a, sigma_s: layer.sigma_s };
}

/** The state of a scene of the service. */
export function fromScene(scene: Scene, presets: Preset[]): State {
  const { material, camera: _camera, version: _version, ...rest } = structuredClone(scene);
  const layers = material.layers.map((spec) => layerOf(spec, scene.media ?? {}, presets));
  return { ...rest, maps: rest.maps ?? {}, media: rest.media ?? {}, layers, ...(material.depths ? { depths: material.depths } : {}), surface: material.surface };
}

function layerOf(spec: LayerSpec, media: Record<string, MediumSpec>, presets: Preset[]): Layer {
  const named = (name: string) => presets.find((preset) => preset.name === name);
  const thickness = spec.thickness_mm ?? null;
  const painted = typeof thickness === "object" ? thickness : null;
  const number = typeof thickness === "number" ? thickness : painted ? (painted.range ?? [0, 1])[1] : null;
  const base = { ...presetLayer(named("skin1") ?? presets[0], number), thickness_map: painted };
  if (typeof spec.medium !== "string") return { ...base, by: "given", medium: spec.medium };
  const medium = media[spec.medium];
  const preset = named(medium?.preset ?? spec.medium);
  if (preset && (!medium || medium.preset)) return { ...presetLayer(preset, number), thickness_map: painted };
  const { sigma_a_per_mm: a, sigma_s_per_mm: s, g = 0, eta = 1.3 } = medium ?? {};
  const plain = (value: unknown): value is number | Triple => typeof value === "number" || Array.isArray(value);
  const even = !Array.isArray(g) || g.every((value) => value === g[0]); // a card has one for all colours
  if (!plain(a) || !plain(s) || !even) return { ...base, by: "given", medium: spec.medium };
  const [sigma_a, sigma_s, one] = [triple(a), triple(s), triple(g)[0]];
  const look = { colour: toColour(sigma_a, sigma_s, one), distance_mm: meanFreePath(sigma_a, sigma_s) };
  return { ...base, ...look, by: "coefficients", sigma_a, sigma_s, g: one, eta, ...(medium?.phase ? { phase: medium.phase } : {}) };
}

/** Ways of spreading whose light no other part receives. */
export const ALONE: Methods["diffusion"][] = ["octree", "parallax"];

const WITHOUT_EXTENT: Light["type"][] = ["point", "spot", "directional", "studio"];

/** Whether pictures march what scatters once: as asked, or, where that is left to the service, as it does. */
export function marches({ methods, lights }: Pick<State, "methods" | "lights">): boolean {
  const { single_scattering, profile, diffusion, angular } = methods;
  if (single_scattering !== "auto") return single_scattering !== "none";
  const fits = profile === "layered-sp3" && (diffusion === "surface" || diffusion === "uv");
  return fits && lights.some((light) => angular || WITHOUT_EXTENT.includes(light.type));
}

/** The scene that the service understands, but for its camera: layers that are muted are left out. */
export function toScene(state: State): Omit<Scene, "camera"> {
  const { layers, depths, surface, ...rest } = structuredClone(state);
  if (rest.methods.diffusion === "parallax" && !rest.methods.parallax?.layers.length) rest.methods.diffusion = "none"; // yet
  if (ALONE.includes(rest.methods.diffusion)) Object.assign(rest.methods, { interreflection: 0, angular: false });
  const heard = layers.filter((layer) => !layer.muted);
  const media: Record<string, MediumSpec> = {};
  for (const [name, medium] of Object.entries(state.media)) {
    const used = heard.some((layer) => layer.by === "given" && JSON.stringify(layer.medium).includes(`"${name}"`));
    if (used) media[name] = medium;
  }
  const specs = heard.map((layer, i): LayerSpec => {
    let medium: LayerSpec["medium"] = layer.preset;
    if (layer.by === "given") medium = layer.medium!;
    else if (layer.by !== "preset") {
      const { sigma_a, sigma_s } = coefficients(layer);
      medium = `layer-${i + 1}`;
      media[medium] = { sigma_a_per_mm: sigma_a, sigma_s_per_mm: sigma_s, g: layer.g, eta: layer.eta, ...(layer.phase ? { phase: layer.phase } : {}) };
    }
    const last = i === heard.length - 1;
    const finite = layer.thickness_mm ?? 1;
    if (depths) return { medium, thickness_mm: null }; // which says where layers end
    return { medium, thickness_mm: layer.thickness_map ?? (last ? layer.thickness_mm : finite) };
  });
  return { version: 1, ...rest, media, material: { layers: specs, ...(depths ? { depths } : {}), surface } };
}
