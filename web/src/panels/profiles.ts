// Asks how far light travels in the layers as they are, for the plot and for the cut through them.

import { api } from "../api";
import { bakedPart } from "../parts";
import { type State, toScene } from "../state";
import type { Showing } from "../types";
import { GaussiansTable } from "./gaussians";
import { ProfilePanel } from "./profile";
import type { CrossSection } from "./section";

const REST_MS = 60;

export interface ProfilesHost {
  state(): State;
  showing(): Showing | null;
  section: CrossSection;
}

export class Profiles {
  readonly panel = new ProfilePanel();
  private readonly gaussians = new GaussiansTable();
  private shown = "";
  private timer = 0;
  private asking = new AbortController();

  constructor(private readonly host: ProfilesHost) {
    this.panel.element.append(this.gaussians.element);
  }

  /** The layers changed: what is shown is of the former ones until they have their light. */
  changed(): void {
    this.host.section.stale(keyOf(this.host.state()) !== this.shown);
  }

  /** Shows the profile of the layers as they are now, soon. */
  want(): void {
    const key = keyOf(this.host.state());
    clearTimeout(this.timer);
    this.asking.abort(); // a late answer would stand for what was undone
    if (key === this.shown) return;
    const { signal } = (this.asking = new AbortController());
    const { section, showing } = this.host;
    const state = this.host.state();
    this.timer = window.setTimeout(async () => {
      try {
        const found = await api.profile(bakedPart(toScene(state)), { signal });
        if (signal.aborted) return;
        this.shown = key;
        this.panel.set(found, showing());
        this.gaussians.set(found);
        section.setProfile(found);
      } catch {
        if (!signal.aborted) section.setProfile(null); // the picture's own request tells why
      }
    }, REST_MS);
  }
}

/** What a profile depends on. */
function keyOf(state: State): string {
  const { mesh: _mesh, atlas: _atlas, lights: _lights, seed: _seed, ...matter } = bakedPart(toScene(state));
  return JSON.stringify(matter);
}
