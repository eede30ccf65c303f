// The light that is dragged around the object.

import { Vector3 } from "three";
import { aimed, expanded, type Movable, movable, towards } from "./lights";
import type { Store } from "./store";
import type { Showing } from "./types";
import type { Viewer } from "./view/viewer";

export class Aim {
  /** The number of the light that dragging moves. */
  active = 0;
  private dragging = false;

  constructor(
    private readonly store: Store,
    private readonly viewer: Viewer,
    private readonly showing: () => Showing | null,
  ) {}

  /** Where it stands from the object's centre; null: nowhere in particular. */
  get direction(): Vector3 | null {
    const lights = expanded(this.store.state.lights, this.showing());
    const light = lights[this.active] ?? lights[0];
    return light && movable(light) && this.showing() ? towards(light, this.viewer.centre) : null;
  }

  /** Turns it around the camera's up and right [radians]; a studio comes apart into its lamps. */
  turn(yaw: number, pitch: number): void {
    const lights = expanded(this.store.state.lights, this.showing());
    const index = Math.min(this.active, lights.length - 1);
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
