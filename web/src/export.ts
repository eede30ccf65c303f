// The scene for elsewhere: a file, a command, a program.

import type { Scene, Source } from "./types";

/** The scene as files of one's own: what was uploaded goes by its file's name. */
export function portable(scene: Scene, names: Record<string, string>): Scene {
  const copy = structuredClone(scene);
  const mend = (source: Source): Source => (source.asset ? { path: names[source.asset] ?? source.asset.slice(0, 8) } : source);
  copy.mesh.source = mend(copy.mesh.source);
  for (const map of Object.values(copy.maps)) map.source = mend(map.source);
  return copy;
}

export const asJson = (scene: Scene): string => `${JSON.stringify(scene, rounded, 2)}\n`;

/** A line for a shell that renders the picture. */
export function asCommand(scene: Scene): string {
  const quoted = JSON.stringify(scene, rounded).replace(/'/g, "'\\''");
  return `printf '%s' '${quoted}' > scene.json && texsss render scene.json --out picture.png\n`;
}

/** A program that bakes it. */
export function asPython(scene: Scene): string {
  return [
    "import json",
    "",
    "import texsss as tx",
    "",
    `scene = tx.Scene.parse(json.loads(r"""`,
    JSON.stringify(scene, rounded, 2),
    `"""))`,
    `baked = tx.bake(scene)  # .irradiance .exitance .radiance (H, W, 3)`,
    `baked.save("out")  # EXR, PNG, GLB, report.json`,
    "",
  ].join("\n");
}

/** Seven digits are more than single precision holds. */
function rounded(_: string, value: unknown): unknown {
  return typeof value === "number" && !Number.isInteger(value) ? Number(value.toPrecision(7)) : value;
}
