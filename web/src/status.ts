// What goes on: the badge with size and time, progress with a way to cancel, the banner when something is away.

import { h, icon } from "./dom";
import type { Badge } from "./live";

const STAGES: Record<string, string> = {
  waiting: "Waiting for its turn",
  surface: "Reading the mesh",
  mesh: "Reading the mesh",
  atlas: "Laying the surface out",
  texels: "Measuring texels",
  seams: "Following seams",
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
  private readonly marched = h("span", { class: "marched" });
  private timer = 0;
  private lit = false; // some picture stands
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
      if ((badge.fraction ?? 0) < 1) this.bar.value = badge.fraction ?? 0;
      else this.bar.removeAttribute("value"); // that stage is done, and what follows has no fraction
      if (!this.timer) this.timer = window.setTimeout(() => (this.progress.hidden = false), PATIENCE_MS);
      this.badge.replaceChildren(dot(), `${badge.texels}²`, this.marched);
      return;
    }
    clearTimeout(this.timer);
    this.timer = 0;
    this.progress.hidden = true;
    this.last = badge;
    this.lit ||= badge.state === "draft" || badge.state === "final";
    const said = { failed: this.lit ? "no new picture: this one is of before" : "no picture", stopped: "stopped: change something to go on" }[badge.state as string] ?? `${badge.texels}² · ${Math.round(badge.ms)} ms`;
    this.badge.replaceChildren(dot(), said, badge.state === "draft" ? h("span", { class: "tag" }, "draft") : "", this.marched);
    const what = badge.state === "draft" ? "A draft: the whole follows when things rest" : "Texels of the light map, and how long it took";
    const stages = badge.took?.map(([stage, ms]) => `${STAGES[stage] ?? stage}: ${Math.round(ms)} ms`) ?? [];
    this.badge.title = [what, ...stages].join("\n");
  }

  /** What went on besides the picture is over. */
  done(): void {
    if (this.badge.dataset.state === "busy") this.show(this.last);
  }

  /** What is said of the march, which has no fraction. */
  march(text: string, going: boolean): void {
    this.marched.textContent = text;
    this.badge.classList.toggle("marching", going);
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
