// Depth textures: pictures whose channels, one after the other, say how deep layers end (François et al. 2006).

import { check, type Control, slider } from "../controls";
import { h, icon, iconButton, keepFocus } from "../dom";
import type { State } from "../state";
import type { Store } from "../store";
import type { Depths } from "../types";
import { IMAGE_NAMES, MAP_FILES, type MapHost } from "./look";

const RANGE_MM: [number, number] = [0, 2]; // what black and white are, where nothing says so
const LOOKED_AT = 64; // texels of a side, for an alpha that says something

export class DepthsPart {
  readonly element = h("div", { class: "card depths", role: "group", "aria-label": "Depth textures" });
  private controls: Control[] = [];
  private structure = "";

  constructor(
    private readonly store: Store,
    private readonly host: MapHost,
    /** Gives the state a layer for each of so many channels, and one below. */
    private readonly fill: (state: State, channels: number) => void,
  ) {
    this.takeDrops();
    this.sync();
  }

  sync(): void {
    const { depths } = this.store.state;
    const structure = JSON.stringify([depths?.maps ?? null, depths?.invert ?? false]);
    if (structure === this.structure) return this.controls.forEach((control) => control.sync());
    this.structure = structure;
    this.controls = [];
    keepFocus(this.element, () => this.element.replaceChildren(this.body(depths)));
  }

  private body(depths: Depths | undefined): HTMLElement {
    const pick = async () => {
      const file = await this.host.pickFile(MAP_FILES);
      if (file) await this.take(file);
    };
    const title = "Red, green, blue and alpha say how deep the first four layers end; or drop an image here";
    const add = h("button", { type: "button", title, onclick: pick }, icon("map"), depths ? "The next four layers…" : "Depths from a texture…");
    if (!depths) return h("div", { class: "buttons" }, add);
    const keep = (control: Control) => (this.controls.push(control), control.element);
    const range = (k: 0 | 1, label: string) =>
      keep(
        slider(this.store, {
          label,
          unit: "mm",
          min: 0,
          max: 10,
          limits: [0, 1000],
          pointer: "/material/depths/range_mm",
          get: (state) => state.depths?.range_mm[k] ?? RANGE_MM[k],
          initial: () => RANGE_MM[k],
          set: ({ depths: at }, value) => {
            if (at) at.range_mm = k === 0 ? [value, Math.max(value, at.range_mm[1])] : [Math.min(value, at.range_mm[0]), value];
          },
        }),
      );
    const flag = (key: "invert" | "sort", label: string, hint: string) =>
      keep(check(this.store, { label, hint, get: (state) => state.depths?.[key] ?? false, set: ({ depths: at }, on) => void (at && (at[key] = on)) }));
    const ends = depths.invert ? (["White is", "Black is"] as const) : (["Black is", "White is"] as const);
    const maps = depths.maps.map((name, i) =>
      h("p", { class: "note" }, icon("map"), ` Layers end where “${name}” says `, iconButton("remove", `Take away depth texture ${name}`, () => this.remove(i))),
    );
    return h(
      "div",
      { class: "card-body" },
      ...maps,
      range(0, ends[0]),
      range(1, ends[1]),
      flag("invert", "Bright is shallow", "Exchanges what black and white mean"),
      flag("sort", "Put channels in order", "A channel above the one before it is refused; so each texel's are sorted"),
      h("div", { class: "buttons" }, add),
    );
  }

  private async take(file: File): Promise<void> {
    const [name, channels] = await Promise.all([this.host.takeMap(file, "linear"), channelsOf(file)]);
    if (!name) return;
    this.store.edit((state) => {
      state.maps[name] = { ...state.maps[name], channel: "rgba" };
      const before = state.depths?.maps ?? [];
      state.depths = { range_mm: [...RANGE_MM], ...state.depths, maps: [...before, name] };
      this.fill(state, 4 * before.length + channels);
    });
  }

  private remove(index: number): void {
    this.store.edit((state) => {
      state.depths?.maps.splice(index, 1);
      if (!state.depths?.maps.length) delete state.depths;
    });
  }

  private takeDrops(): void {
    const over = (on: boolean) => this.element.classList.toggle("drop", on);
    this.element.addEventListener("dragover", (event) => (event.preventDefault(), over(true)));
    this.element.addEventListener("dragleave", () => over(false));
    this.element.addEventListener("drop", (event) => {
      over(false);
      const file = event.dataTransfer?.files[0];
      if (!file || !IMAGE_NAMES.test(file.name)) return;
      event.preventDefault();
      event.stopPropagation();
      void this.take(file);
    });
  }
}

/** How many channels of an image say something: an alpha of 1 everywhere is none. */
async function channelsOf(file: File): Promise<number> {
  const bitmap = await createImageBitmap(file, { resizeWidth: LOOKED_AT, resizeHeight: LOOKED_AT, premultiplyAlpha: "none" }).catch(() => null);
  if (!bitmap) return 3; // of a kind that browsers do not read
  const context = new OffscreenCanvas(LOOKED_AT, LOOKED_AT).getContext("2d")!;
  context.drawImage(bitmap, 0, 0);
  return context.getImageData(0, 0, LOOKED_AT, LOOKED_AT).data.some((value, i) => i % 4 === 3 && value < 255) ? 4 : 3;
}
