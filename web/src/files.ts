// Meshes and maps of one's own: dropped or picked, uploaded, named in the scene; kept to be sent again.

import { api } from "./api";
import { h } from "./dom";
import type { State } from "./state";
import type { Store } from "./store";
import { showProblem, toast } from "./toast";
import type { Asset, MapSpec } from "./types";

const MESHES = /\.(obj|ply|stl|glb)$/i;
const IMAGES = /\.(png|jpe?g|webp|exr|hdr)$/i;

export interface FilesHost {
  initial: State;
  shown(kind: "mesh" | "map"): void;
  /** Names were learnt. */
  named(): void;
  busy(text: string | null): void;
}

export class Files {
  /** File names of uploads by their sha256. */
  readonly names: Record<string, string> = {};
  private readonly kept = new Map<string, File>();
  private uploading: AbortController | null = null; // of a mesh

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
      if (event.dataTransfer!.files.length > 1) toast("One file at a time", `Of these only ${file!.name} was looked at; drop the others after it.`, "note");
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
      const map = await this.takeMap(file, "srgb");
      if (map) this.store.edit((state) => void (state.surface.albedo = map));
      return;
    }
    if (!MESHES.test(file.name)) {
      toast("This kind of file is not read here", `${file.name}: drop a mesh (OBJ, PLY, STL, GLB) or an image.`);
      return;
    }
    this.cancel(); // the last one counts
    const abort = (this.uploading = new AbortController());
    this.host.busy("mesh");
    const asset = await this.upload(file, abort.signal);
    if (this.uploading !== abort) return;
    this.uploading = null;
    this.host.busy(null);
    if (!asset) return;
    this.store.edit((state) => {
      state.mesh = { source: { asset: asset.asset } };
      state.maps = {};
      for (const kind of ["albedo", "normal", "normalise"] as const) delete state.surface[kind];
      for (const kind of ["roughness", "specular"] as const) if (typeof state.surface[kind] === "string") delete state.surface[kind];
      state.lights = structuredClone(this.host.initial.lights);
      this.unpaint(state);
    });
    this.host.shown("mesh");
  }

  /** Gives up an upload; whether there was one. */
  cancel(): boolean {
    const { uploading } = this;
    this.uploading = null;
    uploading?.abort(new DOMException("cancelled", "AbortError"));
    if (uploading) this.host.busy(null);
    return uploading !== null;
  }

  /** Takes away what lies on another object's coordinates. */
  private unpaint(state: State): void {
    for (const layer of state.layers) layer.thickness_map = null;
    if (state.layers.some((layer) => layer.by === "given")) state.layers = structuredClone(this.host.initial.layers);
    delete state.methods.parallax;
    delete state.depths;
    if (state.methods.march) delete state.methods.march.noise_map;
    if (state.methods.diffusion === "parallax") state.methods.diffusion = this.host.initial.methods.diffusion;
  }

  /** The object that the page came with. */
  sample(): void {
    const { mesh, maps, surface, lights } = this.host.initial;
    this.store.edit((state) => {
      this.unpaint(state);
      Object.assign(state, structuredClone({ mesh, maps, surface, lights }));
    });
  }

  /** Uploads an image and names it in the scene; null when it could not. */
  async takeMap(file: File, space: "srgb" | "linear"): Promise<string | null> {
    const asset = await this.upload(file);
    if (!asset) return null;
    if (asset.kind !== "map") {
      toast("Not an image", `${file.name} is a mesh: drop it on the picture.`);
      return null;
    }
    const stem = file.name.replace(/\.\w+$/, "").replace(/[^\w-]+/g, "-") || "map";
    const spec = { source: { asset: asset.asset }, space };
    let name = stem;
    // a map of that name stays: layers may be painted with it
    for (let n = 2; this.taken(name, spec); n++) name = `${stem}-${n}`;
    this.store.edit((state) => void (state.maps[name] = spec), true);
    return name;
  }

  private taken(name: string, spec: MapSpec): boolean {
    const there = this.store.state.maps[name];
    return there !== undefined && JSON.stringify(there) !== JSON.stringify(spec);
  }

  private async upload(file: File, signal?: AbortSignal): Promise<Asset | null> {
    try {
      const asset = await api.upload(file, signal);
      this.kept.set(asset.asset, file);
      this.names[asset.asset] = file.name;
      return asset;
    } catch (error) {
      if (!signal?.aborted) showProblem(error);
      return null;
    }
  }

  /** Learns the names of files that another page, or this one before, sent. */
  async learn(): Promise<void> {
    const { mesh, maps } = this.store.state;
    const sent = [mesh.source, ...Object.values(maps).map((map) => map.source)].map(({ asset }) => asset);
    const unknown = new Set(sent.filter((asset) => asset !== undefined && !this.names[asset]) as string[]);
    await Promise.all(
      [...unknown].map(async (asset) => {
        const found = await api.asset(asset).catch(() => null); // the service forgot it: rendering tells
        if (found) this.names[asset] = found.name;
      }),
    );
    if (unknown.size) this.host.named();
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
