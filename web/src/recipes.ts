// Materials to start from: published media, stacks of them, and colours with a depth.

import { fromColour } from "./material";
import { type Layer, presetLayer } from "./state";
import type { Preset, Triple } from "./types";

export interface Recipe {
  name: string;
  what: string;
  /** Whether it goes with the painted colours of the object; else its own colour is seen. */
  painted?: boolean;
  layers: (presets: Map<string, Preset>) => Layer[];
}

/** Names of the presets as people say them. */
export const SPOKEN: Record<string, string> = {
  apple: "Apple",
  chicken1: "Chicken",
  cream: "Cream",
  ketchup: "Ketchup",
  marble: "Marble",
  potato: "Potato",
  skin1: "Skin",
  skin2: "Fair skin",
  spectralon: "Spectralon (white standard)",
  wholemilk: "Milk",
  "fish-blood": "Fish blood",
  "fish-dermis": "Fish skin",
  "fish-organs": "Fish organs",
};

const plain =
  (name: string): Recipe["layers"] =>
  (presets) => [presetLayer(presets.get(name)!, null)];

function coloured(colour: Triple, distance_mm: Triple, eta: number): Recipe["layers"] {
  return (presets) => {
    const { sigma_a, sigma_s } = fromColour(colour, distance_mm);
    const base = presetLayer([...presets.values()][0], null);
    return [{ ...base, by: "colour", colour, distance_mm, sigma_a, sigma_s, g: 0, eta }];
  };
}

function stacked(...parts: [string, number | null][]): Recipe["layers"] {
  return (presets) => parts.map(([name, thickness]) => presetLayer(presets.get(name)!, thickness));
}

export const RECIPES: Recipe[] = [
  { name: "Skin", painted: true, what: "Human skin, as measured", layers: plain("skin1") },
  { name: "Fair skin", painted: true, what: "A second sample of human skin", layers: plain("skin2") },
  { name: "Marble", what: "Hard, with light that travels far", layers: plain("marble") },
  { name: "Milk", what: "Whole milk: bright and dense", layers: plain("wholemilk") },
  { name: "Wax", what: "A colour that light crosses for millimetres", layers: coloured([0.83, 0.6, 0.32], [2.6, 1.9, 1.1], 1.44) },
  { name: "Jade", what: "A green stone", layers: coloured([0.2, 0.55, 0.26], [0.9, 1.8, 1.1], 1.6) },
  { name: "Apple", what: "The flesh of an apple", layers: plain("apple") },
  { name: "Ketchup", what: "Nearly clear for red, dark for blue", layers: plain("ketchup") },
  { name: "Milk on ketchup", what: "A white film that lets red through: pull its thickness", layers: stacked(["wholemilk", 0.25], ["ketchup", null]) },
  { name: "Fish", painted: true, what: "Skin, blood and organs, three layers", layers: stacked(["fish-dermis", 0.4], ["fish-blood", 0.25], ["fish-organs", null]) },
];
