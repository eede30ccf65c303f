// The bar on top, and the keys.

import type { Compare } from "./compare";
import { copyText } from "./dialogs";
import { h, iconButton, plain, save } from "./dom";
import type { Store } from "./store";
import { toast } from "./toast";
import type { Viewer } from "./view/viewer";

export interface BarHost {
  store: Store;
  viewer: Viewer;
  compare: Compare;
  openMesh(): void;
  home(): void;
  frame(): void;
  help(): void;
  exports(): void;
  link(): Promise<string>;
  rested(): void;
  themed(): void;
  name(): string;
}

const TURN_PER_S = 0.5; // radians of the turntable

export class Bar {
  private readonly undo: HTMLButtonElement;
  private readonly redo: HTMLButtonElement;
  private readonly table: HTMLButtonElement;
  private turning = 0;
  private pointed = true; // the focus came by a pointer

  constructor(
    element: HTMLElement,
    view: HTMLElement,
    private readonly host: BarHost,
  ) {
    const { store } = host;
    this.undo = iconButton("undo", "Undo", () => store.undo(), "Ctrl Z");
    this.redo = iconButton("redo", "Redo", () => store.redo(), "Ctrl Shift Z");
    this.table = iconButton("turn", "Turntable", () => this.turn(), "T");
    this.table.setAttribute("aria-pressed", "false");
    const brand = h("span", { class: "brand" }, h("span", { class: "orb", "aria-hidden": "true" }), h("strong", null, "texsss"), h("span", { class: "motto" }, "light beneath the surface"));
    const group = (label: string, ...buttons: Node[]) => h("div", { class: "group", role: "group", "aria-label": label }, ...buttons);
    element.append(
      brand,
      group("Object", iconButton("open", "Open a mesh", () => host.openMesh(), "or drop one on the picture")),
      group("Edit", this.undo, this.redo),
      group("View", host.compare.button, this.table, iconButton("frame", "Frame the object", () => host.frame(), "F"), iconButton("home", "Reset the view", () => host.home(), "R")),
      group("Share", iconButton("camera", "Save a picture", () => void this.shoot(), "S"), iconButton("link", "Copy a link to this", () => void this.link()), iconButton("export", "Take it with you", () => host.exports())),
      group("Page", iconButton("theme", "Light or dark page", () => (swapTheme(), host.themed())), iconButton("help", "Help and keys", () => host.help(), "?")),
    );
    view.addEventListener("pointerdown", () => this.turn(false));
    document.addEventListener("pointerdown", () => (this.pointed = true), true);
    document.addEventListener("keydown", (event) => this.key(event));
    this.sync();
  }

  sync(): void {
    this.undo.disabled = !this.host.store.canUndo;
    this.redo.disabled = !this.host.store.canRedo;
  }

  /** Tells how large a mesh that came is [mm], since scattering depends on it. */
  announceMesh(size_mm: number, assumed: boolean): void {
    const size = size_mm < 1000 ? `${plain(Number(size_mm.toPrecision(2)))} mm` : `${plain(Number((size_mm / 1000).toPrecision(2)))} m`;
    const right = assumed ? "That is a guess: its file names no unit. " : "";
    toast(`The mesh is here, ${size} long`, `${right}If it should be larger or smaller, change Size under Object: how far light travels in it depends on it.`, "note");
  }

  private turn(on = this.turning === 0): void {
    cancelAnimationFrame(this.turning);
    const was = this.turning !== 0;
    this.turning = 0;
    this.table.setAttribute("aria-pressed", String(on));
    if (!on) {
      if (was) this.host.rested();
      return;
    }
    let before = performance.now();
    const step = (now: number) => {
      this.host.viewer.orbit.turn((-(now - before) / 1000) * TURN_PER_S);
      before = now;
      this.turning = requestAnimationFrame(step);
    };
    this.turning = requestAnimationFrame(step);
  }

  private async shoot(): Promise<void> {
    save(`${this.host.name() || "texsss"}.png`, await this.host.viewer.screenshot());
  }

  private async link(): Promise<void> {
    await copyText(await this.host.link(), "The link is copied", "The address of this page is the link: copy it from there.");
  }

  private key(event: KeyboardEvent): void {
    const field = event.target instanceof HTMLElement && event.target.matches("input:not([type=range]):not([type=checkbox]), select, textarea");
    if (document.querySelector("dialog[open]")) return;
    if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z" && !field) {
      event.preventDefault();
      if (event.shiftKey) this.host.store.redo();
      else this.host.store.undo();
      return;
    }
    if (event.key === "Tab") this.pointed = false;
    if (field || event.ctrlKey || event.metaKey || event.altKey || event.repeat) return;
    // single letters are for the picture and the bar, and for who points; to who goes from field to field by keys
    // or speaks they may mean something else there
    if (!this.pointed && event.target !== document.body && !(event.target as Element).closest("#view, #bar")) return;
    const acts: Record<string, () => void> = {
      f: () => this.host.frame(),
      r: () => this.host.home(),
      c: () => this.host.compare.toggle(),
      t: () => this.turn(),
      s: () => void this.shoot(),
      "?": () => this.host.help(),
    };
    const act = acts[event.key.toLowerCase()];
    if (!act) return;
    event.preventDefault();
    act();
  }
}

const KEY = "texsss-theme";

/** The theme that was chosen, else dark: colours are judged best before a dark ground. */
export function theme(): void {
  let chosen: string | null = null;
  try {
    chosen = localStorage.getItem(KEY);
  } catch {
    // storage may be closed to the page
  }
  if (chosen) document.documentElement.dataset.theme = chosen;
}

function swapTheme(): void {
  const root = document.documentElement;
  root.dataset.theme = root.dataset.theme === "light" ? "dark" : "light";
  try {
    localStorage.setItem(KEY, root.dataset.theme);
  } catch {
    // it holds until the page is closed
  }
}
