// The studio: viewer, panels and the service, joined by one store.

import { Vector3 } from "three";
import { api } from "./api";
import { h, iconButton } from "./dom";
import { aimed, expanded, type Movable, movable, towards } from "./lights";
import { type Badge, Live } from "./live";
import { LayersPanel } from "./panels/layers";
import { LightPanel } from "./panels/light";
import { SurfaceSection, viewSection } from "./panels/look";
import { type Shared, writeHash } from "./share";
import { fromScene, type State, toScene } from "./state";
import { Store } from "./store";
import { clearProblems, showProblem, toast } from "./toast";
import type { Preset, Scene } from "./types";
import { LightHandle } from "./view/handle";
import type { Pose } from "./view/orbit";
import { Viewer } from "./view/viewer";

const DRAFT_BACKDROP: [[number, number, number], [number, number, number]] = [
  [0.02, 0.024, 0.03],
  [0.075, 0.082, 0.092],
];

export class App {
  readonly store: Store;
  readonly viewer: Viewer;
  readonly live: Live;
  readonly initial: State;
  private readonly layers: LayersPanel;
  private readonly lights: LightPanel;
  private readonly handle: LightHandle;
  private pose: Pose | null;
  private framed = "";
  private readonly camera: Scene["camera"];
  private dragging = false;
  activeLight = 0;

  constructor(scenes: { scene: Scene }[], presets: Preset[], shared: Shared | null) {
    const scene = { ...scenes[0].scene, ...shared?.scene } as Scene;
    this.camera = scene.camera;
    this.initial = fromScene(scene, presets);
    this.store = new Store(shared?.state ?? structuredClone(this.initial));
    this.pose = shared?.pose ?? null;
    const canvas = document.querySelector<HTMLCanvasElement>("#canvas")!;
    const frame = document.querySelector<HTMLElement>("#view")!;
    const overlay = document.querySelector<HTMLElement>("#overlay")!;
    this.viewer = new Viewer(canvas, frame, {
      moved: () => this.handle?.place(),
      rested: () => this.remember(),
      light: (yaw, pitch) => this.turnLight(yaw, pitch),
      lightDone: () => this.lightDone(),
      drawn: () => undefined,
      lost: () => undefined,
      restored: () => undefined,
    });
    this.handle = new LightHandle(overlay, this.viewer, { turn: (yaw, pitch) => this.turnLight(yaw, pitch), done: () => this.lightDone() });
    const badge = h("div", { id: "badge" });
    overlay.append(badge);
    this.live = new Live({
      badge: (value) => this.showBadge(badge, value),
      showing: (showing) => {
        this.viewer.uniforms.eta.value = showing.eta;
        this.viewer.uniforms.transmittance.value = showing.transmittance;
        this.lights.sync();
        this.showLights();
      },
      geometry: (geometry) => {
        this.viewer.setGeometry(geometry);
        this.frameFirst();
      },
      light: (texture) => this.viewer.setLight("B", texture),
      map: (kind, texture) => this.viewer.setMap(kind, texture),
      settled: () => clearProblems(),
      problem: showProblem,
      offline: () => undefined,
    });
    const host = {
      takeMap: (file: File) => this.takeMap(file),
      pickFile,
      announce: (text: string) => void (document.getElementById("status")!.textContent = text),
    };
    this.layers = new LayersPanel(this.store, presets, this.initial, host);
    const lightHost = {
      showing: () => this.live.showing,
      active: this.activeLight,
      select: (index: number) => {
        lightHost.active = this.activeLight = index;
        this.lights.sync();
        this.showLights();
      },
    };
    this.lights = new LightPanel(this.store, lightHost);
    const surface = new SurfaceSection(this.store, this.initial, host);
    const view = viewSection(this.store, this.initial);
    document.querySelector("#panel")!.append(this.layers.element, surface.element, this.lights.element, view.element);
    document.querySelector("#bar")!.append(
      h("strong", null, "texsss"),
      iconButton("undo", "Undo", () => this.store.undo(), "Ctrl+Z"),
      iconButton("redo", "Redo", () => this.store.redo(), "Ctrl+Shift+Z"),
    );
    this.store.listen(() => {
      this.layers.sync();
      this.lights.sync();
      surface.sync();
      for (const control of view.controls) control.sync();
      this.show();
      this.live.want(this.store.state, this.store.editing);
      if (!this.store.editing) this.remember();
    });
    this.show();
    this.live.want(this.store.state, false);
  }

  /** What the page's own shader shows of the state. */
  private show(): void {
    const { surface, output } = this.store.state;
    const { uniforms } = this.viewer;
    const number = (value: unknown, otherwise: number) => (typeof value === "number" ? value : otherwise);
    uniforms.roughness.value = number(surface.roughness, 0.4);
    uniforms.specular.value = number(surface.specular, 1);
    uniforms.secondLobe.value = surface.second_lobe ?? 0;
    uniforms.albedoRoot.value = surface.albedo_mode === "both";
    uniforms.normalY.value = surface.normal_y === "-y" ? -1 : 1;
    this.viewer.setOutput(output.exposure_ev, output.tonemap);
    this.viewer.setBackground(output.background ?? DRAFT_BACKDROP);
    this.showLights();
  }

  private showLights(): void {
    const lights = expanded(this.store.state.lights, this.live.showing);
    this.viewer.setLights(lights);
    const light = lights[this.activeLight];
    this.handle.set(light && movable(light) ? towards(light, this.viewer.centre) : null);
  }

  private turnLight(yaw: number, pitch: number): void {
    const { state } = this.store;
    const lights = expanded(state.lights, this.live.showing);
    const light = lights[this.activeLight];
    if (!light || !movable(light)) return;
    const up = new Vector3().setFromMatrixColumn(this.viewer.camera.matrixWorld, 1);
    const right = new Vector3().setFromMatrixColumn(this.viewer.camera.matrixWorld, 0);
    const direction = towards(light, this.viewer.centre).applyAxisAngle(up, yaw).applyAxisAngle(right, pitch);
    this.dragging = true;
    this.store.edit((next) => {
      next.lights = lights.map((one, i) => (i === this.activeLight ? aimed(one as Movable, this.viewer.centre, direction) : one));
    }, true);
  }

  private lightDone(): void {
    if (this.dragging) this.store.commit();
    this.dragging = false;
  }

  private frameFirst(): void {
    const mesh = JSON.stringify(this.store.state.mesh);
    if (this.framed === mesh) return;
    const first = this.framed === "";
    this.framed = mesh;
    const direction = this.camera.direction ?? [0.3, 0.2, 1];
    const home = this.viewer.framing(direction, this.camera.fov_y_deg);
    this.viewer.setPose(first && this.pose ? this.pose : home);
  }

  private showBadge(element: HTMLElement, badge: Badge): void {
    element.dataset.state = badge.state;
    element.textContent =
      badge.state === "busy" ? `${badge.stage ?? "working"} ${Math.round(100 * (badge.fraction ?? 0))} %` : `${badge.texels}² · ${Math.round(badge.ms)} ms${badge.state === "draft" ? " · draft" : ""}`;
  }

  private async takeMap(file: File): Promise<string | null> {
    try {
      const asset = await api.upload(file);
      if (asset.kind !== "map") {
        toast("Not an image", `${file.name} is a mesh; drop it on the picture.`);
        return null;
      }
      const stem = file.name.replace(/\.\w+$/, "").replace(/[^\w-]+/g, "-") || "map";
      this.store.state.maps[stem] = { source: { asset: asset.asset }, space: "linear" };
      return stem;
    } catch (error) {
      showProblem(error);
      return null;
    }
  }

  private remembering = 0;

  private remember(): void {
    clearTimeout(this.remembering);
    this.remembering = window.setTimeout(async () => {
      history.replaceState(null, "", await writeHash({ state: this.store.state, pose: this.viewer.orbit.pose }));
    }, 300);
  }

  /** The scene as it stands, camera included. */
  scene(): Scene {
    return { ...toScene(this.store.state), camera: { ...this.camera, ...this.viewer.orbit.pose, fit: false } };
  }
}

function pickFile(accept: string): Promise<File | null> {
  return new Promise((done) => {
    const input = h("input", { type: "file", accept });
    input.addEventListener("change", () => done(input.files?.[0] ?? null));
    input.addEventListener("cancel", () => done(null));
    input.click();
  });
}
