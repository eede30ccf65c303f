// The sun in the picture: where the light comes from, to be dragged.

import { Vector3 } from "three";
import { h, icon } from "../dom";
import type { Viewer } from "./viewer";

const REACH = 1.18; // of the object's radius: where the sun hangs
const MARGIN = 26;
const CLEAR = 24; // around the sun
const LINE = 100; // as styled

export class LightHandle {
  private readonly line = h("div", { class: "light-line", "aria-hidden": "true" });
  readonly button = h("button", { type: "button", class: "light-handle", title: "Drag to move the light" }, icon("sun"));
  private direction: Vector3 | null = null;

  constructor(
    overlay: HTMLElement,
    private readonly viewer: Viewer,
    events: { turn(yaw: number, pitch: number): void; done(): void },
  ) {
    this.button.setAttribute("aria-label", "Light: drag it, or use the arrow keys");
    overlay.append(this.line, this.button);
    let last: { x: number; y: number } | null = null;
    let away = 1; // -1: behind the object, where the same turn goes the other way
    const side = () => (this.button.classList.contains("behind") ? -1 : 1);
    this.button.addEventListener("pointerdown", (event) => {
      event.stopPropagation();
      this.button.setPointerCapture(event.pointerId);
      last = { x: event.clientX, y: event.clientY };
      away = side();
    });
    this.button.addEventListener("pointermove", (event) => {
      if (!last) return;
      const speed = (away * Math.PI) / Math.min(overlay.clientWidth, overlay.clientHeight);
      events.turn((event.clientX - last.x) * speed, (event.clientY - last.y) * speed);
      last = { x: event.clientX, y: event.clientY };
    });
    for (const end of ["pointerup", "pointercancel"] as const)
      this.button.addEventListener(end, () => {
        if (last) events.done();
        last = null;
      });
    this.button.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      if (!step) return;
      event.preventDefault();
      event.stopPropagation();
      events.turn(step[0] * 0.12 * side(), step[1] * 0.12 * side());
      events.done();
    });
  }

  /** Where the light comes from; null: from everywhere, which needs no sun. */
  set(direction: Vector3 | null): void {
    this.direction = direction;
    this.place();
  }

  place(): void {
    const shown = this.direction !== null && this.viewer.unfolded === 0;
    this.button.hidden = !shown;
    this.line.hidden = !shown;
    if (!this.direction || !shown) return;
    const { centre, radius } = this.viewer;
    const { clientWidth: width, clientHeight: height } = this.viewer.canvas;
    const at = this.viewer.project(centre.clone().addScaledVector(this.direction, REACH * radius));
    const middle = this.viewer.project(centre);
    // whole pixels: a browser without a graphics card need not blend it between them
    const x = Math.round(Math.min(Math.max(at.x, MARGIN), width - MARGIN));
    const y = Math.round(Math.min(Math.max(at.y, MARGIN), height - MARGIN));
    this.button.style.transform = `translate(${x}px, ${y}px)`;
    this.button.classList.toggle("behind", !at.front);
    this.line.classList.toggle("behind", !at.front);
    // moved and stretched, but never painted anew: that costs more than the whole line
    const length = Math.hypot(middle.x - x, middle.y - y);
    const angle = Math.atan2(middle.y - y, middle.x - x);
    const drawn = Math.max(0.45 * length - CLEAR, 0);
    this.line.style.transform = `translate(${x}px, ${y}px) rotate(${angle}rad) translate(${CLEAR}px) scale(${drawn / LINE}, 1)`;
  }
}
