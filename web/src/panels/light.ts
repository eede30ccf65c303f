// The Light tab: setups to start from, and each light.

import { Vector3 } from "three";
import type { Aim } from "../aim";
import { colour, type Control, section, slider } from "../controls";
import { h, icon, iconButton, keepFocus } from "../dom";
import { apart, distanceOf, lamp, type Movable, movable, powerField, powerOf, SETUPS, UNITS, withPower } from "../lights";
import type { State } from "../state";
import type { Store } from "../store";
import type { Light, Showing, Triple } from "../types";

const NAMES: Record<Light["type"], string> = {
  studio: "Studio",
  point: "Lamp",
  spot: "Spotlight",
  directional: "Sun",
  rectangle: "Panel",
  sphere: "Ball",
  environment: "Surroundings",
};
const MOST = 8;

export interface LightHost {
  showing(): Showing | null;
  aim: Aim;
  select(index: number): void;
}

export class LightPanel {
  readonly element = h("div", { class: "lights" });
  private readonly list = h("ol", { class: "cards", "aria-label": "Lights" });
  private controls: Control[] = [];
  private structure = "";
  private readonly chips: HTMLElement[];
  private readonly adds: HTMLButtonElement[];

  constructor(
    private readonly store: Store,
    private readonly host: LightHost,
  ) {
    this.chips = SETUPS.map((setup) =>
      h("button", { type: "button", class: "chip", title: setup.what, onclick: () => this.store.edit((state) => void (state.lights = setup.make(this.centre, this.diagonal))) }, setup.name),
    );
    const more: [string, (centre: Vector3, size: number) => Light][] = [
      ["Lamp", (centre, size) => lamp([-0.8, 0.4, 0.6], [1.5, 1.5, 1.5], centre, 2 * size)],
      ["Sun", () => ({ type: "directional", direction: [-0.5, 0.6, 0.6], irradiance_w_per_m2: [1.5, 1.5, 1.5] })],
      ["Ball", (centre, size) => ({ type: "sphere", position_mm: centre.clone().add(new Vector3(-0.8, 0.4, 0.6).multiplyScalar(size)).toArray(), radius_mm: 0.15 * size, radiance: [12, 12, 12] })],
      ["Surroundings", () => ({ type: "environment", radiance: [0.2, 0.22, 0.26] })],
    ];
    const adds = more.map(([name, make]) =>
      h("button", { type: "button", onclick: () => this.addLight(make(this.centre, this.diagonal)) }, icon("add"), name),
    );
    this.adds = adds;
    this.element.append(
      section("Start from", h("div", { class: "chips", role: "group", "aria-label": "Light to start from" }, ...this.chips)),
      section("Lights", h("p", { class: "note" }, "Drag the sun in the picture, or drag anywhere with Shift or two fingers: the light goes around the object, behind it too."), this.list),
      section("Add", h("div", { class: "buttons", role: "group", "aria-label": "Add a light" }, ...adds)),
    );
  }

  private get centre(): Vector3 {
    const box = this.host.showing()?.mesh.box_mm;
    return box ? new Vector3(...box[0]).add(new Vector3(...box[1])).multiplyScalar(0.5) : new Vector3();
  }

  private get diagonal(): number {
    const box = this.host.showing()?.mesh.box_mm;
    return box ? new Vector3(...box[0]).distanceTo(new Vector3(...box[1])) : 100;
  }

  private addLight(light: Light): void {
    const lights = apart(this.store.state.lights, this.host.showing());
    if (!lights) return; // the studio's lamps are on their way
    this.host.aim.active = lights.length;
    this.store.edit((state) => void (state.lights = [...lights, light]));
  }

  sync(): void {
    const { lights } = this.store.state;
    const structure = JSON.stringify([lights.map((light) => light.type), this.host.aim.among(lights), this.host.showing()?.geometry]);
    // a slider that is held stays: one more of the same list comes when it is let go
    if (structure !== this.structure && !(this.structure && this.store.editing)) {
      this.structure = structure;
      this.controls = [];
      const cards = lights.map((light, index) => this.card(light, index));
      keepFocus(this.list, () => this.list.replaceChildren(...(cards.length ? cards : [h("li", { class: "note" }, "It is dark: add a light below, or start from one above.")])));
    } else for (const control of this.controls) control.sync();
    for (const add of this.adds) {
      add.disabled = (apart(lights, this.host.showing()) ?? lights).length >= MOST;
      add.title = add.disabled ? `${MOST} lights are the most here` : "";
    }
    const made = JSON.stringify(lights);
    SETUPS.forEach((setup, i) => this.chips[i].setAttribute("aria-pressed", String(JSON.stringify(setup.make(this.centre, this.diagonal)) === made)));
  }

  private card(light: Light, index: number): HTMLElement {
    const at = (state: State): Light => state.lights[index] ?? light;
    const put = (state: State, next: Light) => void (state.lights[index] = next);
    const active = index === this.host.aim.among(this.store.state.lights);
    const keep = (control: Control) => (this.controls.push(control), control.element);
    const name = NAMES[light.type];
    const title = h(
      "button",
      { type: "button", class: "card-title", "aria-pressed": String(active), title: "The light that dragging moves", onclick: () => this.host.select(index) },
      icon("sun"),
      h("span", { class: "title" }, lights(this.store) > 1 ? `${name} ${index + 1}` : name),
      active && movable(light) ? h("span", { class: "tag" }, "moves") : null,
    );
    const remove = iconButton("remove", `Remove ${name.toLowerCase()} ${index + 1}`, () => {
      if (index < this.host.aim.active) this.host.aim.active--;
      this.store.edit((state) => void state.lights.splice(index, 1));
    });
    const body = h("div", { class: "card-body" });
    const unit = light.type === "studio" ? "×" : UNITS[powerField(light)];
    let shone: Triple = [1, 1, 1]; // its colour when it last did: darkness has none
    const peak = (state: State) => Math.max(...powerOf(at(state)));
    const scaled = (state: State, value: number) => {
      const power = powerOf(at(state));
      const most = Math.max(...power);
      if (most > 0) shone = power.map((one) => one / most) as Triple;
      put(state, withPower(at(state), shone.map((one) => one * value) as Triple));
    };
    const range = { studio: [0.05, 10], point: [0.001, 1000], spot: [0.001, 1000], directional: [0.05, 50], rectangle: [0.05, 500], sphere: [0.05, 500], environment: [0.02, 20] }[light.type];
    body.append(keep(slider(this.store, { label: "Strength", unit, min: range[0], max: range[1], limits: [0, 1e6], log: true, pointer: `/lights/${index}`, get: peak, set: scaled })));
    if (light.type !== "studio") {
      const shade = (state: State) => powerOf(at(state)).map((one) => one / Math.max(peak(state), 1e-12)) as Triple;
      const tint = (state: State, value: Triple) => {
        const most = Math.max(...value, 1e-6);
        const strength = peak(state);
        put(state, withPower(at(state), value.map((one) => (one / most) * strength) as Triple));
      };
      body.append(keep(colour(this.store, { label: "Colour", get: shade, set: tint })));
    }
    if (movable(light) && light.type !== "directional") {
      const { centre, diagonal } = this;
      const get = (state: State) => distanceOf(at(state) as Movable, centre) ?? diagonal;
      const set = (state: State, value: number) => {
        const now = at(state) as Extract<Movable, { position_mm: Triple }>;
        const position = new Vector3(...now.position_mm).sub(centre).setLength(value).add(centre);
        put(state, { ...now, position_mm: position.toArray() });
      };
      body.append(keep(slider(this.store, { label: "Distance", unit: "mm", min: 0.3 * diagonal, max: 10 * diagonal, limits: [1e-3, 1e6], log: true, get, set })));
    }
    if (light.type === "sphere") {
      const set = (state: State, value: number) => {
        const now = at(state);
        if (now.type === "sphere") put(state, { ...now, radius_mm: value });
      };
      const get = (state: State) => (at(state) as { radius_mm?: number }).radius_mm ?? 1;
      body.append(keep(slider(this.store, { label: "Radius", unit: "mm", min: 0.01 * this.diagonal, max: this.diagonal, limits: [1e-3, 1e5], log: true, get, set })));
    }
    if (light.type === "studio") {
      const take = () => this.store.edit((state) => void (state.lights = apart(state.lights, this.host.showing()) ?? state.lights));
      body.append(h("div", { class: "buttons" }, h("button", { type: "button", onclick: take }, "Take apart into lamps")));
    }
    return h("li", { class: `card open${active ? " active" : ""}` }, h("div", { class: "card-head" }, title, remove), body);
  }
}

const lights = (store: Store): number => store.state.lights.length;
