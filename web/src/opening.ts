// What the first picture needs, asked for before the parts of the page that show it are there.

import { ahead, api, ASKED, GLB, NPY, PNG } from "./api";
import { bakedPart, DRAFT, draftPart, groundPart, mapPart, shownMaps } from "./parts";
import { readHash, type Shared } from "./share";
import { fromScene, type State, toScene } from "./state";
import type { Preset, Scene } from "./types";

/** What the page starts from. */
export interface Opening {
  scenes: { name: string; summary: string; scene: Scene }[];
  presets: Preset[];
  /** What the address holds. */
  shared: Shared | null;
  /** Why the address could not be read. */
  fault: string;
  /** What the page shows where the address says nothing. */
  initial: State;
  state: State;
}

export async function opening(): Promise<Opening> {
  let fault = "";
  const reading = readHash(location.hash).catch((error) => ((fault = String(error)), null));
  const [scenes, presets, shared] = await Promise.all([api.scenes(), api.presets(), reading]);
  const own = fromScene(scenes[0].scene, presets);
  try {
    const initial = shared?.scene ? fromScene(filled(scenes[0].scene, shared.scene), presets) : own;
    const state = shared?.state ? { ...own, ...shared.state, output: { ...own.output, ...shared.state.output }, methods: { ...own.methods, ...shared.state.methods } } : structuredClone(initial);
    if (!shared?.view?.inside || shared.view.inside === "picture") ask(state);
    else bakedPart(toScene(state)); // or it throws
    return { scenes, presets, shared, fault, initial, state };
  } catch (error) {
    return { scenes, presets, shared: null, fault: fault || String(error), initial: own, state: structuredClone(own) };
  }
}

/** A scene with parts of another, as the service takes parts: what they leave out has the defaults of the schema. */
function filled(scene: Scene, part: Partial<Scene>): Scene {
  const { atlas, methods, output } = scene;
  const made = { ...scene, ...part, atlas: { ...atlas, ...part.atlas }, methods: { ...methods, ...part.methods }, output: { ...output, ...part.output } };
  return { ...made, material: { ...made.material, surface: made.material.surface ?? {} } };
}

/** Asks for the light first as a draft, as `Live` will. */
function ask(state: State): void {
  const scene = toScene(state);
  if (!scene.material.layers.length) return;
  const baked = bakedPart(scene);
  const job = { progress: () => undefined };
  ahead(ASKED.geometry, groundPart(baked), { ...job, accept: GLB });
  for (const name of new Set(Object.values(shownMaps(scene))))
    if (name !== undefined && scene.maps[name]) ahead(ASKED.map(name), mapPart(scene, name), { accept: PNG });
  ahead(ASKED.showing, baked);
  const light = ASKED.image("diffused");
  if (baked.atlas.size > DRAFT) ahead(light, draftPart(baked), { ...job, accept: NPY });
  ahead(light, baked, { ...job, accept: NPY });
}
