// The light that is dragged around the object.

import { Vector3 } from "three";
import { aimed, apart, expanded, type Movable, movable, towards } from "./lights";
import type { Store } from "./store";
import type { Light, Showing } from "./types";
import type { Viewer } from "./view/viewer";

export class Aim {
  /** The number of the light that was chosen; it may be gone. */
  active = 0;
  private dragging = false;

  constructor(
    private readonly store: Store,
    private readonly viewer: Viewer,
    private readonly showing: () => Showing | null,
  ) {}

  /** The number of the light that dragging moves: the chosen one, else the first that can be. */
  among(lights: Light[]): number {
    const chosen = lights[this.active];
    return chosen && movable(chosen) ? this.active : Math.max(lights.findIndex(movable), 0);
  }

  /** Where it stands from the object's centre; null: nowhere in particular. */
  get direction(): Vector3 | null {
    const lights = expanded(this.store.state.lights, this.showing());
    const light = lights[this.among(lights)];
    return light && movable(light) && this.showing() ? towards(light, this.viewer.centre) : null;
  }

  /** Turns it around the camera's up and right [radians]; a studio comes apart into its lamps. */
  turn(yaw: number, pitch: number): void {
    const lights = apart(this.store.state.lights, this.showing());
    if (!lights) return; // soon
    const index = this.among(lights);
    const light = lights[index];
    if (!light || !movable(light)) return;
    const { matrixWorld } = this.viewer.camera;
    const up = new Vector3().setFromMatrixColumn(matrixWorld, 1);
    const right = new Vector3().setFromMatrixColumn(matrixWorld, 0);
    const direction = towards(light, this.viewer.centre).applyAxisAngle(up, yaw).applyAxisAngle(right, pitch);
    this.dragging = true;
    this.store.edit((next) => {
      next.lights = lights.map((one, i) => (i === index ? aimed(one as Movable, this.viewer.centre, direction) : one));
    }, true);
  }

  /** Ends a drag. */
  done(): void {
    if (this.dragging) this.store.commit();
    this.dragging = false;
  }
}
