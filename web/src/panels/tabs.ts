// Tabs, as the authoring practices have them: arrows change, one is reached by Tab.

import { h } from "../dom";

export class Tabs {
  readonly list = h("div", { class: "tabs", role: "tablist", "aria-label": "Settings" });
  readonly panels = h("div", { class: "tab-panels" });
  private readonly tabs: HTMLButtonElement[] = [];
  private readonly scrolled: Record<string, number> = {}; // how far each was, when it was left
  chosen = "";

  constructor(private readonly heard: (name: string) => void) {
    this.list.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
      if (!step) return;
      event.preventDefault();
      const now = this.tabs.findIndex((tab) => tab.dataset.name === this.chosen);
      const next = this.tabs[(now + step + this.tabs.length) % this.tabs.length];
      this.choose(next.dataset.name!);
      next.focus();
    });
  }

  add(name: string, ...content: Node[]): void {
    const key = name.toLowerCase();
    const tab = h("button", { type: "button", role: "tab", id: `tab-${key}`, "aria-controls": `panel-${key}`, "data-name": name, onclick: () => this.choose(name) }, name);
    this.tabs.push(tab);
    this.list.append(tab);
    this.panels.append(h("div", { class: "tab-panel", role: "tabpanel", id: `panel-${key}`, "aria-labelledby": `tab-${key}`, tabindex: 0 }, ...content));
    if (!this.chosen) this.choose(name);
    else this.choose(this.chosen);
  }

  choose(name: string): void {
    const changed = this.chosen !== name;
    if (changed) this.scrolled[this.chosen] = this.panels.scrollTop;
    this.chosen = name;
    this.tabs.forEach((tab, i) => {
      const on = tab.dataset.name === name;
      tab.setAttribute("aria-selected", String(on));
      tab.tabIndex = on ? 0 : -1;
      (this.panels.children[i] as HTMLElement).hidden = !on;
    });
    if (!changed) return;
    this.panels.scrollTop = this.scrolled[name] ?? 0;
    this.heard(name);
  }
}
