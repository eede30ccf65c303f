// The one state of the page: edits, undo and redo, who listens.

import type { State } from "./state";

type Listener = () => void;

const MOST = 200;

export class Store {
  private past: string[] = [];
  private future: string[] = [];
  private readonly listeners = new Set<Listener>();
  /** The state before an edit that goes on, as a drag does. */
  private before: string | null = null;

  constructor(public state: State) {}

  listen(listener: Listener): void {
    this.listeners.add(listener);
  }

  /** Changes the state. `live`: the edit goes on until `commit`, and is one step of undo. */
  edit(change: (state: State) => void, live = false): void {
    this.before ??= JSON.stringify(this.state);
    const next = structuredClone(this.state);
    change(next);
    this.state = next;
    if (live) this.tell();
    else this.commit();
  }

  /** Ends a live edit. */
  commit(): void {
    const before = this.before;
    this.before = null;
    if (before !== null && before !== JSON.stringify(this.state)) {
      this.past.push(before);
      if (this.past.length > MOST) this.past.shift();
      this.future = [];
    }
    this.tell();
  }

  /** Takes another state's place, as a step of its own. */
  replace(state: State): void {
    this.edit((now) => {
      for (const key of Object.keys(now)) delete (now as unknown as Record<string, unknown>)[key];
      Object.assign(now, structuredClone(state));
    });
  }

  get canUndo(): boolean {
    return this.past.length > 0;
  }

  get canRedo(): boolean {
    return this.future.length > 0;
  }

  get editing(): boolean {
    return this.before !== null;
  }

  undo(): void {
    this.step(this.past, this.future);
  }

  redo(): void {
    this.step(this.future, this.past);
  }

  private step(from: string[], to: string[]): void {
    if (this.before !== null) this.commit();
    const next = from.pop();
    if (next === undefined) return;
    to.push(JSON.stringify(this.state));
    this.state = JSON.parse(next);
    this.tell();
  }

  private tell(): void {
    for (const listener of this.listeners) listener();
  }
}
