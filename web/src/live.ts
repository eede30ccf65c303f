// Keeps the picture up with the scene: a draft while it changes, the whole when it rests.

import { api, clientName, NPY, Offline, Problem, sleep } from "./api";
import { powerOf } from "./lights";
import { bakedPart, DRAFT, type Baked, draftPart, groundPart, mapPart, shownMaps } from "./parts";
import { toScene, type State } from "./state";
import type { Scene, Showing } from "./types";
import { parseGlb } from "./view/glb";
import { type HalfImage, parseNpy, rangeOf } from "./view/npy";
import type { MapName } from "./view/look";
import { fromBlob, fromHalf } from "./view/textures";
import type { BufferGeometry, Texture } from "three";

const REST_MS = 220;
const PATIENCE_MS = 1500; // of the first picture with its maps
const HEADROOM = 1.3; // of drafts over the greatest value seen, which they clip

export interface Badge {
  state: "busy" | "draft" | "final" | "failed" | "stopped";
  texels: number;
  ms: number;
  /** Milliseconds per stage that ran, where the service says. */
  took?: [string, number][];
  stage?: string;
  fraction?: number;
}

export interface LiveEvents {
  badge?(badge: Badge): void;
  /** Lights and indices; `geometry` where the mesh is another. Without this event neither is asked for. */
  ground?(showing: Showing, geometry: BufferGeometry | null): void;
  light(texture: Texture, final: HalfImage | null): void;
  /** Makes a map ready; what it gives puts it on. */
  map?(kind: MapName, coded: Blob | null, srgb: boolean): Promise<() => void>;
  /** Whether a map is shown without being asked for, as another side wears the same. */
  lent?(kind: MapName, key: string): Promise<boolean>;
  settled?(): void;
  problem(error: unknown): void;
  online?(yes: boolean): void;
}

export class Live {
  private wanted: Baked | null = null;
  private shown = ""; // what the light on screen was made from
  private settledOn = "";
  private lit = ""; // what the light was made from when it came, before its maps
  private scene: Omit<Scene, "camera"> | null = null;
  private running = false;
  private moving = false;
  private changedAt = 0;
  private final: AbortController | null = null;
  private place = "";
  private geometryKey = "";
  private onScreen = ""; // the mesh and the layout that are shown
  private placing: Promise<void> = Promise.resolve(); // while lights and indices are on their way
  private grounds = new Set<string>(); // meshes and sizes that are known to be quick
  private maps: Partial<Record<MapName, string>> = {};
  private readonly worn: Partial<Record<MapName, Promise<void>>> = {}; // until each of them is shown
  private readonly ready = new Map<MapName, (on: boolean) => void>(); // shown with the light that belongs to them
  private dressing: Promise<unknown> = Promise.resolve(); // while maps are on their way
  private readonly client = clientName();
  private bound = 0; // greatest value of the light on screen
  private power = 0; // of the lights it came from
  private wake: () => void = () => undefined;
  image = "diffused";
  /** How often the light on screen was all that was wanted. */
  settles = 0;
  showing: Showing | null = null;
  private full: { key: string; image: HalfImage } | null = null; // the last light that came in full

  constructor(private readonly events: LiveEvents) {}

  /** Wants the light of a state; `moving`: it is likely to change again soon. */
  want(state: State, moving: boolean): void {
    const scene = toScene(state);
    if (!scene.material.layers.length) return;
    const baked = bakedPart(scene);
    const key = this.key(baked);
    this.scene = scene;
    this.dress();
    this.moving = moving;
    if (this.wanted && key === this.key(this.wanted)) {
      this.wake();
      return;
    }
    this.wanted = baked;
    this.changedAt = performance.now();
    this.final?.abort(new DOMException("stale", "AbortError"));
    this.wake();
    if (!this.running) void this.run();
  }

  /** Shows another image of the scene on the surface. */
  look(image: string): void {
    this.image = image;
    this.shown = this.settledOn = "";
    this.bound = 0;
    this.final?.abort(new DOMException("stale", "AbortError"));
    this.wake();
    if (!this.running && this.wanted) void this.run();
  }

  /** Asks for everything again, as after the service was away. */
  again(): void {
    this.shown = this.settledOn = this.place = "";
    this.wake();
    if (!this.running && this.wanted) void this.run();
  }

  /** Stops what goes on now. */
  cancel(): void {
    this.final?.abort(new DOMException("cancelled", "AbortError"));
    this.settledOn = this.wanted ? this.key(this.wanted) : "";
    this.shown = this.settledOn;
    this.events.badge?.({ state: "stopped", texels: 0, ms: 0 });
  }

  /** All of the light that is wanted; null until it has come. */
  get values(): HalfImage | null {
    return this.wanted && this.full?.key === this.key(this.wanted) ? this.full.image : null;
  }

  /** Whether a map is the one shown as `kind`, once what was asked for has come. */
  async wears(kind: MapName, key: string): Promise<boolean> {
    await this.worn[kind];
    return (this.maps[kind] ?? "") === key;
  }

  private key(scene: object): string {
    return `${this.image} ${JSON.stringify(scene)}`;
  }

  private async run(): Promise<void> {
    this.running = true;
    let wait = 1;
    while (this.wanted && this.settledOn !== this.key(this.wanted)) {
      const scene = this.wanted;
      const key = this.key(scene);
      try {
        if (this.events.ground) await this.ground(scene, this.events.ground);
        this.dress();
        if (this.shown !== key && scene.atlas.size > DRAFT) {
          await this.draw(scene, true);
          this.shown = key;
          this.settledOn = "";
          continue; // what changed meanwhile is more urgent than the whole
        }
        const rest = this.changedAt + REST_MS - performance.now();
        if (this.moving || rest > 0) {
          await this.pause(this.moving ? 1000 : rest);
          continue;
        }
        await this.draw(scene, false);
        await Promise.all([this.placing, this.dressing]); // what failed of them is asked for again
        this.shown = this.settledOn = key;
        wait = 1;
        this.settles++;
        this.events.settled?.();
      } catch (error) {
        if ((error as Error)?.name === "AbortError") continue;
        if (error instanceof Problem && error.slug === "superseded") continue;
        this.events.badge?.({ state: "failed", texels: 0, ms: 0 });
        if (error instanceof Offline) {
          this.events.online?.(false);
          await this.pause(1000 * wait);
          wait = Math.min(2 * wait, 4);
          continue;
        }
        this.settledOn = this.shown = key; // until something else is wanted
        this.events.problem(error);
      }
    }
    this.running = false;
  }

  private pause(ms: number): Promise<void> {
    return new Promise((done) => {
      const timer = setTimeout(done, ms);
      this.wake = () => (clearTimeout(timer), done());
    });
  }

  /** Places and geometry, when they changed. */
  private async ground(scene: Baked, heard: NonNullable<LiveEvents["ground"]>): Promise<void> {
    const place = placeOf(scene);
    if (place === this.place) return;
    const start = performance.now();
    const abort = (this.final = new AbortController());
    const ground = groundOf(scene);
    const heavy = !this.grounds.has(ground);
    const progress = heavy
      ? (stage: string, fraction: number) =>
          this.events.badge?.({ state: "busy", texels: scene.atlas.size, ms: performance.now() - start, stage, fraction })
      : undefined;
    if (heavy || ground !== this.onScreen) {
      progress?.("surface", 0);
      const buffer = await api.geometry(groundPart(scene), { signal: abort.signal, progress });
      const showing = (this.showing = { ...(await api.showing(scene, { signal: abort.signal })), asked: scene.lights, place });
      const other = showing.geometry !== this.geometryKey;
      if (other) this.bound = 0;
      this.geometryKey = showing.geometry;
      this.onScreen = ground;
      heard(showing, other ? parseGlb(buffer) : null);
    } else {
      // lights and indices alone: the picture need not wait for them
      this.placing = api.showing(scene).then(
        (showing) => {
          if (this.place === place) heard((this.showing = { ...showing, asked: scene.lights, place }), null);
        },
        (error) => {
          if (this.place !== place) return;
          this.place = "";
          throw error;
        },
      );
      this.placing.catch(() => undefined); // heard before the picture has settled
    }
    this.place = place;
  }

  private async draw(scene: Baked, draft: boolean): Promise<void> {
    const start = performance.now();
    const size = draft ? Math.min(DRAFT, scene.atlas.size) : scene.atlas.size;
    const sized = draft ? draftPart(scene) : scene;
    const ground = `${groundOf(scene)} ${size} ${scene.methods.diffusion} ${scene.methods.terms}`;
    const known = this.grounds.has(ground);
    const abort = new AbortController();
    if (!draft || !known) this.final = abort;
    const progress = (stage: string, fraction: number) =>
      this.events.badge?.({ state: "busy", texels: size, ms: performance.now() - start, stage, fraction });
    if (!known) progress("light", 0);
    const options = { signal: abort.signal, client: draft && known ? this.client : undefined, progress: known ? undefined : progress };
    let took: Badge["took"];
    const coded = draft && this.bound > 0 && this.image === "diffused";
    if (coded) {
      const brighter = Math.max(1, powerOfAll(scene.lights) / Math.max(this.power, 1e-12));
      const exposure_ev = -Math.ceil(2 * Math.log2(this.bound * brighter * HEADROOM)) / 2;
      const body = { ...sized, output: { exposure_ev, tonemap: "linear" } };
      const response = await api.image(body, this.image, { ...options, accept: "image/jpeg" });
      took = timing(response);
      const texture = await fromBlob(await response.blob(), true);
      texture.userData.scale = 2 ** -exposure_ev;
      this.wear(scene);
      this.events.light(texture, null);
    } else {
      const response = await api.image(sized, this.image, { ...options, accept: NPY });
      took = timing(response);
      const image = parseNpy(await response.arrayBuffer());
      this.bound = Math.max(rangeOf(image).high, 1e-6);
      this.power = powerOfAll(scene.lights);
      if (!draft) this.full = { key: this.key(scene), image };
      if (this.settles === 0) await Promise.race([this.dressing, sleep(PATIENCE_MS)]); // not grey first, then coloured
      this.wear(scene);
      this.events.light(fromHalf(image), draft ? null : image);
    }
    this.grounds.add(ground);
    this.grounds.add(groundOf(scene));
    const ms = performance.now() - start;
    this.events.badge?.({ state: draft ? "draft" : "final", texels: size, ms, took });
    this.events.online?.(true);
  }

  /** Asks for the maps that the page's own shader uses and does not have. */
  private dress(): void {
    const { scene } = this;
    const show = this.events.map;
    if (!scene || !show) return;
    const asked: Promise<void>[] = [];
    for (const [kind, name] of Object.entries(shownMaps(scene)) as [MapName, string | undefined][]) {
      const spec = name === undefined ? undefined : scene.maps[name];
      const key = spec ? JSON.stringify(spec) : "";
      if ((this.maps[kind] ?? "") === key) continue;
      this.maps[kind] = key;
      this.ready.get(kind)?.(false); // it is of the past
      this.ready.delete(kind);
      const ask = spec && name !== undefined ? () => api.map(mapPart(scene, name), name) : null;
      this.worn[kind] = new Promise((done) => asked.push(this.showMap(kind, ask, (spec?.space ?? "linear") === "srgb", show, done)));
    }
    if (!asked.length) return;
    this.dressing = Promise.all(asked);
    this.dressing.catch(() => undefined); // heard before the picture has settled
  }

  private async showMap(kind: MapName, ask: (() => Promise<Blob>) | null, srgb: boolean, show: NonNullable<LiveEvents["map"]>, done: () => void): Promise<void> {
    const key = this.maps[kind];
    try {
      if (key !== undefined && (await this.events.lent?.(kind, key))) return done();
      const coded = ask && (await ask());
      const wear = this.maps[kind] === key ? await show(kind, coded, srgb) : null;
      if (!wear || this.maps[kind] !== key) return done();
      this.ready.set(kind, (on) => ((on ? wear() : null), done()));
      if (this.wanted && this.lit === this.key(this.wanted)) this.put(kind);
    } catch (error) {
      done();
      if (this.maps[kind] !== key) return;
      this.maps[kind] = "unknown"; // to be asked for again
      throw error;
    }
  }

  /** Puts a map on that is ready. */
  private put(kind: MapName): void {
    this.ready.get(kind)?.(true);
    this.ready.delete(kind);
  }

  /** Puts on what belongs to the light of `scene`, not to what has been wanted since. */
  private wear(scene: Baked): void {
    this.lit = this.key(scene);
    if (this.wanted && this.key(this.wanted) === this.lit) for (const kind of this.ready.keys()) this.put(kind);
  }
}

/** What stages took, of a header Server-Timing. */
const timing = (response: Response): [string, number][] =>
  [...(response.headers.get("server-timing") ?? "").matchAll(/([\w-]+);dur=([\d.]+)/g)].map(([, stage, ms]) => [stage, Number(ms)]);

const powerOfAll = (lights: Scene["lights"]): number => lights.reduce((sum, light) => sum + Math.max(...powerOf(light)), 0);

/** What the answer of /v1/showing depends on. */
export function placeOf(scene: Baked): string {
  const { lights, methods, material, media } = scene;
  const first = material.layers[0].medium;
  const eta = typeof first === "string" ? (media[first]?.eta ?? media[first]?.preset ?? first) : first;
  const studio = lights.some((light) => light.type === "studio");
  const { terms, diffusion } = methods;
  return JSON.stringify([groundOf(scene), studio ? lights : [], eta, terms, diffusion, material.surface]);
}

const groundOf = (scene: Baked): string => JSON.stringify(groundPart(scene));
