// The studio: viewer, panels and the service, joined by one store.

import { Address } from "./address";
import { Aim } from "./aim";
import { api, Problem } from "./api";
import { Bar, theme } from "./bar";
import { Compare } from "./compare";
import { exportDialog, helpDialog } from "./dialogs";
import { h, save } from "./dom";
import { portable } from "./export";
import { Files } from "./files";
import { expanded } from "./lights";
import { Live } from "./live";
import { Marching } from "./marching";
import type { Opening } from "./opening";
import { BeneathSection } from "./panels/beneath";
import { InsidePanel } from "./panels/inside";
import { LayersPanel } from "./panels/layers";
import { LightPanel } from "./panels/light";
import { SurfaceSection, viewSection } from "./panels/look";
import { MethodPanel } from "./panels/method";
import { ObjectPanel } from "./panels/object";
import { Profiles } from "./panels/profiles";
import { Tabs } from "./panels/tabs";
import { fromScene, type State, toScene } from "./state";
import { Status } from "./status";
import { Store } from "./store";
import { clearProblems, showProblem } from "./toast";
import type { Scene, Showing, Triple } from "./types";
import { LightHandle } from "./view/handle";
import { dressLook } from "./view/look";
import type { Pose } from "./view/orbit";
import { Viewer } from "./view/viewer";

const BACKDROP: Showing["background"] = [
  [0.02, 0.024, 0.03],
  [0.075, 0.082, 0.092],
];
const HOME = [0.62, 0.36, 0.7] as const; // where other meshes are seen from

const PATIENCE_MS = 1500; // of the panels with the first picture

/** Shows all that stands around the picture, which costs as much to paint as the picture where no graphics card does it. */
const furnished = (): void => document.body.classList.remove("opening");

/** A file's name as people say it. */
const spoken = (name: string): string => (name.charAt(0).toUpperCase() + name.slice(1)).replace(/[-_]/g, " ");

const reducedMotion = (): boolean => matchMedia("(prefers-reduced-motion: reduce)").matches;

export class App {
  readonly store: Store;
  readonly viewer: Viewer;
  readonly live: Live;
  readonly compare: Compare;
  readonly initial: State;
  readonly files: Files;
  readonly status: Status;
  readonly inside: InsidePanel;
  private readonly panels: { sync(): void }[];
  private readonly layers: LayersPanel;
  private readonly profiles: Profiles;
  private readonly lights: LightPanel;
  private readonly handle: LightHandle;
  private readonly marching: Marching;
  private readonly bar: Bar;
  readonly address: Address;
  readonly aim: Aim;
  private readonly camera: Scene["camera"];
  private pose: Pose | null;
  private framed = "";
  private radius = 1; // [mm] of the object when it was last seen
  private baking: AbortController | null = null;
  private arriving = false; // a mesh of one's own is

  constructor({ scenes, presets, shared, initial, state }: Opening) {
    this.camera = scenes[0].scene.camera;
    this.initial = initial;
    const store = (this.store = new Store(state));
    this.pose = shared?.pose ?? null;
    const find = (id: string) => document.getElementById(id)!;
    const overlay = find("overlay");

    const viewer = (this.viewer = new Viewer(find("canvas") as HTMLCanvasElement, find("view"), {
      moved: () => {
        this.handle?.place();
        this.marching?.moved();
      },
      rested: () => this.address.remember(),
      light: (yaw, pitch) => this.aim.turn(yaw, pitch),
      lightDone: () => this.aim.done(),
      lost: () => this.status.away("card", "The graphics card was taken away; waiting for it…"),
      restored: () => this.status.away("card", null),
    }));
    this.aim = new Aim(store, viewer, () => this.live.showing);
    this.status = new Status(() => (this.baking ? this.baking.abort() : this.files.cancel() || this.live.cancel()));
    const online = (yes: boolean) => this.status.away("service", yes ? null : "The service can't be reached. Trying again…");
    this.live = new Live({
      badge: (badge) => this.status.show(badge),
      ground: (showing, geometry) => {
        if (geometry) viewer.setGeometry(geometry);
        this.frameOnce();
        this.show();
        for (const panel of this.panels) panel.sync();
        this.profiles.panel.place(showing);
        this.compare.sync(store.editing);
        if (geometry && this.arriving) {
          const [low, high] = showing.mesh.box_mm;
          this.bar.announceMesh(Math.max(...high.map((most, k) => most - low[k])), showing.mesh.unit_assumed);
          this.arriving = false;
        }
        this.announce(geometry ? `${this.name} is shown, ${showing.mesh.faces} triangles` : "");
      },
      light: (texture, final) => {
        viewer.setLight("B", texture);
        requestAnimationFrame(() => requestAnimationFrame(furnished));
        if (final) this.inside.values(final);
      },
      map: (kind, coded, srgb) => viewer.setMap("B", kind, coded, srgb),
      settled: () => {
        clearProblems();
        this.profiles.want();
        this.marching.moved();
        viewer.prepare();
        void this.compare.measure();
      },
      problem: async (error) => (await this.problem(error)) && this.live.again(),
      online,
    });
    this.files = new Files(store, find("view"), {
      shown: (kind) => void (this.arriving ||= kind === "mesh"),
      named: () => {
        for (const panel of this.panels) panel.sync();
      },
      initial: this.initial,
      busy: (stage) => (stage ? this.status.show({ state: "busy", texels: store.state.atlas.size, ms: 0, stage, fraction: 0 }) : this.status.done()),
    });
    this.handle = new LightHandle(overlay, viewer, { turn: (yaw, pitch) => this.aim.turn(yaw, pitch), done: () => this.aim.done() });
    this.marching = new Marching({
      viewer,
      state: (side) => (side === "B" ? store.state : (this.compare?.shown ?? null)),
      pose: () => viewer.orbit.pose,
      allowed: () => ["picture", "single"].includes(this.inside.key) && viewer.unfolded === 0 && this.framed === JSON.stringify(store.state.mesh.source), // not another mesh over this one
      editing: () => store.editing,
      reducedMotion,
      said: (text, going) => this.status.march(text, going),
      online,
    });
    this.inside = new InsidePanel({
      viewer,
      state: () => store.state,
      showing: () => this.live.showing,
      look: (image) => {
        if (image !== this.live.image) this.live.look(image);
        this.compare.sync();
        this.address.remember();
      },
      single: (on) => {
        this.marching.alone = on;
        this.marching.moved();
      },
      reducedMotion,
      moved: () => {
        this.handle.place();
        this.marching.moved();
      },
      changed: () => this.address.remember(),
    });
    this.compare = new Compare({
      viewer,
      state: () => store.state,
      live: this.live,
      showing: () => this.live.showing,
      lights: (state, showing) => expanded(state.lights, showing),
      problem: (error) => this.problem(error),
      announce: (text) => this.announce(text),
      marched: () => (this.marching.alone ? "alone" : this.marching.wanted ? "also" : "no"),
      changed: () => {
        this.address.remember();
        this.marching.changed();
      },
    });

    this.address = new Address({
      state: () => store.state,
      pose: () => viewer.orbit.pose,
      placed: () => this.framed !== "",
      inside: this.inside,
      compare: this.compare,
      aim: this.aim,
    });

    const host = { takeMap: (file: File, space: "srgb" | "linear") => this.files.takeMap(file, space), pickFile: (accept: string) => this.files.pick(accept), announce: (text: string) => this.announce(text) };
    this.layers = new LayersPanel(store, presets, this.initial, host);
    this.profiles = new Profiles({ state: () => store.state, showing: () => this.live.showing, section: this.layers.section });
    this.lights = new LightPanel(store, {
      showing: () => this.live.showing,
      aim: this.aim,
      select: (index) => {
        this.aim.active = index;
        this.lights.sync();
        this.show();
      },
    });
    const known = scenes.map(({ name, summary, scene }) => ({ name: name === "default" ? "Axolotl" : spoken(name), summary, show: () => store.replace(fromScene(scene, presets)) }));
    const surface = new SurfaceSection(store, this.initial, host);
    const view = viewSection(store, this.initial);
    const object = new ObjectPanel(store, { showing: () => this.live.showing, openMesh: () => void this.files.openMesh(), sample: () => this.files.sample(), scene: () => this.scene(), name: () => this.name, scenes: known });
    const method = new MethodPanel(store, this.initial, host);
    const beneath = new BeneathSection(store, host);
    this.panels = [this.layers, surface, this.lights, { sync: () => view.controls.forEach((control) => control.sync()) }, object, method, beneath, this.inside];

    const tabs = new Tabs((name) => name === "Inside" && this.profiles.panel.draw());
    tabs.add("Material", this.layers.element, surface.element);
    tabs.add("Light", this.lights.element, view.element);
    tabs.add("Object", object.element);
    tabs.add("Inside", this.inside.element, this.profiles.panel.element, method.element, beneath.element);
    find("panel").append(tabs.list, tabs.panels);

    const help = helpDialog();
    const out = exportDialog(() => portable(this.scene(), this.files.names), () => this.saveModel());
    this.bar = new Bar(find("bar"), find("view"), {
      store,
      viewer,
      compare: this.compare,
      openMesh: () => void this.files.openMesh(),
      home: () => this.home(),
      frame: () => this.home(viewer.camera.position.clone().sub(viewer.orbit.target).toArray()),
      help: () => help.showModal(),
      exports: () => {
        out.refresh();
        out.showModal();
      },
      link: async () => {
        await this.address.write();
        return location.href;
      },
      rested: () => this.address.remember(),
      themed: () => this.profiles.panel.draw(),
      name: () => this.name,
    });
    const hint = h("p", { id: "hint" }, "Drag to turn · drag the sun to move the light · scroll to zoom");
    overlay.append(this.compare.overlay, this.inside.legend, this.status.banner, this.status.progress, hint, this.status.badge);
    document.querySelector("#view")!.addEventListener("pointerdown", () => setTimeout(() => hint.classList.add("gone"), 4000), { once: true });
    theme();

    store.listen(() => {
      for (const panel of this.panels) panel.sync();
      this.bar.sync();
      this.show();
      if (store.editing) viewer.redraw(true);
      this.live.want(store.state, store.editing);
      this.compare.sync(store.editing);
      this.profiles.changed();
      this.marching.changed();
      if (!store.editing) this.address.remember();
    });
    this.show();
    setTimeout(furnished, PATIENCE_MS);
    this.address.restore(shared?.view);
    this.live.want(store.state, false);
    void this.files.learn();
  }

  private get name(): string {
    const { asset } = this.store.state.mesh.source;
    const name = asset ? (this.files.names[asset] ?? "mesh") : (this.live.showing?.mesh.name ?? "");
    return name.replace(/\.\w+$/, "");
  }

  /** What the page's own shader shows of the state. */
  private show(): void {
    const { state } = this.store;
    const lights = expanded(state.lights, this.live.showing);
    dressLook(this.viewer.looks.B, state, this.live.showing, lights);
    this.viewer.setOutput(state.output.exposure_ev, state.output.tonemap);
    this.viewer.setBackground(state.output.background ?? BACKDROP);
    this.handle.set(this.aim.direction);
  }

  /** The camera is placed when a mesh is new, and never again. */
  private frameOnce(): void {
    const mesh = JSON.stringify(this.store.state.mesh.source);
    const before = this.radius;
    this.radius = this.viewer.radius;
    if (this.framed === mesh) return this.rescale(this.radius / before);
    const first = this.framed === "";
    this.framed = mesh;
    if (first && this.pose) this.viewer.setPose(this.pose);
    else this.home();
  }

  /** The same view of an object whose unit is another. */
  private rescale(ratio: number): void {
    if (Math.abs(ratio - 1) < 0.01) return;
    const { position_mm, target_mm, fov_y_deg } = this.viewer.orbit.pose;
    const scaled = (place: Triple) => place.map((one) => one * ratio) as Triple;
    this.viewer.setPose({ position_mm: scaled(position_mm), target_mm: scaled(target_mm), fov_y_deg });
  }

  private home(direction?: [number, number, number]): void {
    const own = JSON.stringify(this.store.state.mesh.source) === JSON.stringify(this.initial.mesh.source);
    const from = direction ?? (own ? this.camera.direction : undefined) ?? [...HOME];
    const pose = this.viewer.framing(from, this.camera.fov_y_deg);
    if (pose) this.viewer.setPose(pose);
    this.address.remember();
  }

  /** Tells of a problem; whether it was mended instead. */
  private async problem(error: unknown): Promise<boolean> {
    const lost = error instanceof Problem && error.errors.some((one) => one.pointer.endsWith("/asset"));
    if (!lost) showProblem(error);
    return lost && (await this.files.again());
  }

  private announce(text: string): void {
    if (text) document.getElementById("status")!.textContent = text;
  }

  private async saveModel(): Promise<void> {
    try {
      const { camera: _camera, ...scene } = this.scene();
      const progress = (stage: string, fraction: number) => this.status.show({ state: "busy", texels: scene.atlas.size, ms: 0, stage, fraction });
      this.baking = new AbortController();
      save("model.glb", await api.bake(scene, { progress, signal: this.baking.signal }));
    } catch (error) {
      if ((error as Error).name !== "AbortError") showProblem(error);
    } finally {
      this.baking = null;
      this.status.done();
    }
  }

  /** The scene as it stands, camera included: what the service would make a picture of. */
  scene(): Scene {
    const { clientWidth: width, clientHeight: height } = this.viewer.canvas;
    const resolution: [number, number] = [width, height];
    return { ...toScene(this.store.state), camera: { fit: false, samples: 9, ...this.viewer.orbit.pose, resolution } };
  }
}
