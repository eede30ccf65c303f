// Meshes and maps of one's own: dropped or picked, uploaded, named in the scene; kept to be sent again.

import { api } from "./api";
import { h } from "./dom";
import type { State } from "./state";
import type { Store } from "./store";
import { showProblem, toast } from "./toast";
import type { Asset } from "./types";

const MESHES = /\.(obj|ply|stl|glb)$/i;
const IMAGES = /\.(png|jpe?g|webp|exr|hdr)$/i;

export interface FilesHost {
  initial: State;
  shown(kind: "mesh" | "map"): void;
  busy(text: string | null): void;
}

export class Files {
  /** File names of uploads by their sha256. */
  readonly names: Record<string, string> = {};
  private readonly kept = new Map<string, File>();

  constructor(
    private readonly store: Store,
    target: HTMLElement,
    private readonly host: FilesHost,
  ) {
    const over = (on: boolean) => target.classList.toggle("drop", on);
    // a file that misses its target must not replace the page
    for (const name of ["dragover", "drop"] as const) window.addEventListener(name, (event) => event.preventDefault());
    target.addEventListener("dragover", () => over(true));
    target.addEventListener("dragleave", () => over(false));
    target.addEventListener("drop", (event) => {
      over(false);
      const file = event.dataTransfer?.files[0];
      if (file) void this.take(file);
    });
  }

  /** A file of the person's choice. */
  pick(accept: string): Promise<File | null> {
    return new Promise((done) => {
      const input = h("input", { type: "file", accept });
      input.addEventListener("change", () => done(input.files?.[0] ?? null));
      input.addEventListener("cancel", () => done(null));
      input.click();
    });
  }

  async openMesh(): Promise<void> {
    const file = await this.pick(".obj,.ply,.stl,.glb,.png,.jpg,.jpeg,.webp");
    if (file) await this.take(file);
  }

  /** A mesh takes the place of the object, an image that of its colour. */
  async take(file: File): Promise<void> {
    if (IMAGES.test(file.name)) {
      const map = await this.takeMap(file);
      if (map)
        this.store.edit((state) => {
          state.maps[map].space = "srgb";
          state.surface.albedo = map;
        });
      return;
    }
    if (!MESHES.test(file.name)) {
      toast("This kind of file is not read here", `${file.name}: drop a mesh (OBJ, PLY, STL, GLB) or an image.`);
      return;
    }
    this.host.busy("mesh");
    const asset = await this.upload(file);
    this.host.busy(null);
    if (!asset) return;
    this.store.edit((state) => {
      state.mesh = { source: { asset: asset.asset } };
      state.maps = {};
      for (const kind of ["albedo", "normal", "normalise"] as const) delete state.surface[kind];
      for (const kind of ["roughness", "specular"] as const) if (typeof state.surface[kind] === "string") delete state.surface[kind];
      for (const layer of state.layers) layer.thickness_map = null;
      if (state.layers.some((layer) => layer.by === "given")) state.layers = structuredClone(this.host.initial.layers);
      state.lights = structuredClone(this.host.initial.lights);
      delete state.methods.parallax;
      if (state.methods.diffusion === "parallax") state.methods.diffusion = this.host.initial.methods.diffusion;
    });
    this.host.shown("mesh");
  }

  /** The object that the page came with. */
  sample(): void {
    const { mesh, maps, surface, lights } = this.host.initial;
    this.store.edit((state) => Object.assign(state, structuredClone({ mesh, maps, surface, lights })));
  }

  /** Uploads an image and names it in the scene; null when it could not. */
  async takeMap(file: File): Promise<string | null> {
    const asset = await this.upload(file);
    if (!asset) return null;
    if (asset.kind !== "map") {
      toast("Not an image", `${file.name} is a mesh: drop it on the picture.`);
      return null;
    }
    const stem = file.name.replace(/\.\w+$/, "").replace(/[^\w-]+/g, "-") || "map";
    this.store.edit((state) => void (state.maps[stem] = { source: { asset: asset.asset }, space: "linear" }), true);
    return stem;
  }

  private async upload(file: File): Promise<Asset | null> {
    try {
      const asset = await api.upload(file);
      this.kept.set(asset.asset, file);
      this.names[asset.asset] = file.name;
      return asset;
    } catch (error) {
      showProblem(error);
      return null;
    }
  }

  /** Sends again what a service that was started anew has lost; whether that was all. Else says what to do. */
  async again(): Promise<boolean> {
    const { mesh, maps } = this.store.state;
    const sources = [["the mesh", mesh.source] as const, ...Object.entries(maps).map(([name, map]) => [name, map.source] as const)];
    const gone: string[] = [];
    for (const [name, { asset }] of sources) {
      if (!asset) continue;
      const file = this.kept.get(asset);
      if (!file) gone.push(this.names[asset] ?? name);
      else if (!(await this.upload(file))) return false; // why has been said
    }
    if (gone.length) toast("The service no longer has your files", `It was started anew, and this page does not hold ${gone.join(", ")}. Drop ${gone.length > 1 ? "them" : "it"} on the picture again, or choose a scene under Object.`);
    return !gone.length;
  }
}
