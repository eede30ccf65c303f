// The sum of Gaussians that comes near the profile, in numbers.

import { h, plain } from "../dom";
import type { Profile } from "../types";

const CHANNELS = ["red", "green", "blue"];

export class GaussiansTable {
  private readonly table = h("table");
  readonly element = h(
    "details",
    { class: "gaussians" },
    h("summary", null, "The Gaussians of its sum"),
    h("p", { class: "note" }, "The sum of weight × exp(−r²/2v) / 2πv comes near R(r), by the error of the fit. The weights sum up to the light that comes back."),
    this.table,
  );

  set({ gaussians: { variances_mm2, weights } }: Profile): void {
    const heads = ["σ [mm]", "v [mm²]"].map((name) => h("th", { scope: "col" }, name));
    const head = h("tr", null, ...heads, ...CHANNELS.map((name) => h("th", { scope: "col", class: name }, name)));
    const rows = variances_mm2.map((variance, k) => {
      const shares = weights[k].map((share) => h("td", null, short(share)));
      return h("tr", null, h("th", { scope: "row" }, short(Math.sqrt(variance))), h("td", null, short(variance)), ...shares);
    });
    this.table.replaceChildren(h("thead", null, head), h("tbody", null, ...rows));
  }
}

const short = (value: number): string => plain(Number(value.toPrecision(3)));
