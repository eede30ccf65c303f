// The address holds what is shown: written when things rest, so that a reload or a link gives the same picture.

import type { Aim } from "./aim";
import type { Compare } from "./compare";
import type { InsidePanel } from "./panels/inside";
import { type Shared, writeHash } from "./share";
import type { State } from "./state";
import type { Pose } from "./view/orbit";

const REST_MS = 250;

export interface AddressHost {
  state(): State;
  pose(): Pose;
  /** Whether the camera has been placed: before, there is nothing to keep. */
  placed(): boolean;
  inside: InsidePanel;
  compare: Compare;
  aim: Aim;
}

export class Address {
  private timer = 0;

  constructor(private readonly host: AddressHost) {}

  /** Something changed; it is written once it rests. */
  remember(): void {
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => void this.write(), REST_MS);
  }

  async write(): Promise<void> {
    const { host } = this;
    if (!host.placed()) return;
    const view = { inside: host.inside.key, number: host.inside.chosenNumber, compare: host.compare.shared, light: host.aim.active, ...host.inside.laid };
    history.replaceState(null, "", await writeHash({ state: host.state(), pose: host.pose(), view }));
  }

  /** Shows what a link says besides state and pose. */
  restore(view: Shared["view"]): void {
    if (!view) return;
    this.host.aim.active = view.light ?? 0;
    if (view.inside && view.inside !== "picture") this.host.inside.choose(view.inside, view.number ?? 1);
    this.host.inside.lay(view);
    if (view.compare) this.host.compare.restore(view.compare);
  }
}
