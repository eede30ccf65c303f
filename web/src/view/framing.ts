// The nearest camera that sees a whole mesh.

import { type BufferGeometry, PerspectiveCamera, Vector3 } from "three";
import type { Triple } from "../types";
import type { Pose } from "./orbit";

const FILL = 0.86; // of the window

/** The camera from `direction` whose window of `aspect` the mesh fills; every vertex bounds it. */
export function framing(geometry: BufferGeometry, direction: Triple, fov_y_deg: number, aspect: number): Pose {
  const probe = new PerspectiveCamera(fov_y_deg, aspect);
  probe.position.fromArray(direction).normalize();
  probe.lookAt(0, 0, 0);
  probe.updateMatrixWorld();
  const axes = [new Vector3(), new Vector3(), new Vector3()];
  probe.matrixWorld.extractBasis(axes[0], axes[1], axes[2]);
  const half = Math.tan((fov_y_deg * Math.PI) / 360) * FILL;
  const tangents = [half * aspect, half];
  const centre = geometry.boundingSphere!.center;
  const positions = geometry.getAttribute("position").array;
  const high = [-Infinity, -Infinity];
  const low = [-Infinity, -Infinity];
  const local = new Vector3();
  // a vertex is in view when ±(across - middle) ≤ tangent (ahead + back)
  for (let i = 0; i < positions.length; i += 3) {
    local.fromArray(positions, i).sub(centre);
    const ahead = -local.dot(axes[2]);
    for (let k = 0; k < 2; k++) {
      const across = local.dot(axes[k]);
      high[k] = Math.max(high[k], across - tangents[k] * ahead);
      low[k] = Math.max(low[k], -across - tangents[k] * ahead);
    }
  }
  const back = Math.max(...[0, 1].map((k) => (high[k] + low[k]) / 2 / tangents[k]));
  const target = centre.clone();
  for (const k of [0, 1]) target.addScaledVector(axes[k], (high[k] - low[k]) / 2);
  const eye = target.clone().addScaledVector(axes[2], back);
  return { position_mm: eye.toArray(), target_mm: target.toArray(), fov_y_deg };
}
