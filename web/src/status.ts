// What goes on: the badge with size and time, progress with a way to cancel, the banner when something is away.

import { h, icon } from "./dom";
import type { Badge } from "./live";

const STAGES: Record<string, string> = {
  waiting: "Waiting for its turn",
  surface: "Reading the mesh",
  mesh: "Reading the mesh",
  atlas: "Laying the surface out",
  texels: "Measuring texels",
  occluder: "Preparing shadows",
  light: "Casting light",
  operators: "Joining neighbours",
  bank: "Spreading light",
  weights: "Solving the layers",
  exitance: "Summing up",
  marching: "Marching through the layers",
  files: "Writing files",
};
const PATIENCE_MS = 500; // before progress is shown

export class Status {
  readonly badge = h("div", { id: "badge", "data-state": "busy" }, "…");
  readonly banner = h("div", { class: "banner", role: "alert", hidden: true });
  readonly progress: HTMLElement;
  private readonly bar = h("progress", { max: 1, "aria-label": "Progress" });
  private readonly stage = h("span");
  private timer = 0;
  private readonly missing = new Map<string, string>();
  private last: Badge = { state: "stopped", texels: 0, ms: 0 };

  constructor(cancel: () => void) {
    const stop = h("button", { type: "button", onclick: cancel }, "Cancel");
    this.progress = h("div", { class: "progress", hidden: true }, h("div", null, this.stage, this.bar), stop);
  }

  show(badge: Badge): void {
    this.badge.dataset.state = badge.state;
    if (badge.state === "busy") {
      this.stage.textContent = STAGES[badge.stage ?? ""] ?? "Working";
      this.bar.value = badge.fraction ?? 0;
      if (!this.timer) this.timer = window.setTimeout(() => (this.progress.hidden = false), PATIENCE_MS);
      this.badge.replaceChildren(dot(), `${badge.texels}²`);
      return;
    }
    clearTimeout(this.timer);
    this.timer = 0;
    this.progress.hidden = true;
    this.last = badge;
    const said = { failed: "no picture", stopped: "stopped: change something to go on" }[badge.state as string] ?? `${badge.texels}² · ${Math.round(badge.ms)} ms`;
    this.badge.replaceChildren(dot(), said, badge.state === "draft" ? h("span", { class: "tag" }, "draft") : "");
    this.badge.title = badge.state === "draft" ? "A draft: the whole follows when things rest" : "Texels of the light map, and how long the service took";
  }

  /** What went on besides the picture is over. */
  done(): void {
    if (this.badge.dataset.state === "busy") this.show(this.last);
  }

  /** Something that goes on for long and has no fraction. */
  busy(text: string | null): void {
    this.badge.classList.toggle("marching", text !== null);
  }

  /** Says that something is away; null: it is back. */
  away(what: "card" | "service", text: string | null): void {
    if ((this.missing.get(what) ?? null) === text) return;
    if (text === null) this.missing.delete(what);
    else this.missing.set(what, text);
    this.banner.hidden = this.missing.size === 0;
    this.banner.replaceChildren(...(this.missing.size ? [icon("reset"), [...this.missing.values()].join(" ")] : []));
  }
}

const dot = () => h("span", { class: "state", "aria-hidden": "true" });
