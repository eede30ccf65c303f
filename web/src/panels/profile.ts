// How far light travels: the profile R(r), and every length in mm and in texels.

import uPlot from "uplot";
import { section } from "../controls";
import { h, plain } from "../dom";
import type { Profile, Rings, Showing } from "../types";

const CHANNELS = ["red", "green", "blue"];
const DECADES = 2000; // from the nearest distance shown to the farthest
const FAR_OFF = 0.05; // of a profile: a sum of Gaussians that is worth a word

export class ProfilePanel {
  readonly element: HTMLElement;
  private readonly plot = h("div", { class: "plot", role: "img" });
  private readonly table = h("table", { class: "numbers" });
  private readonly warnings = h("ul", { class: "advice", "aria-live": "polite" });
  private readonly photons = h("p", { class: "note", hidden: true }, "Dots: what photons do that are followed one by one (Monte Carlo), twice their error as a bar.");
  private chart: uPlot | null = null;
  private profile: Profile | null = null;
  private showing: Showing | null = null;

  constructor() {
    const caption = h("p", { class: "note" }, "Where the light leaves that enters at one point, for red, green and blue. Dashed: a texel.");
    this.element = section("How far light travels", caption, this.photons, this.plot, this.warnings, this.table);
  }

  set(profile: Profile, showing: Showing | null): void {
    this.profile = profile;
    this.showing = showing;
    this.draw();
  }

  /** Follows mesh and light map: texels, and what is said of the scale. */
  place(showing: Showing): void {
    const before = this.showing;
    this.showing = showing;
    if (JSON.stringify([before?.mesh, before?.atlas]) !== JSON.stringify([showing.mesh, showing.atlas])) this.draw();
  }

  /** Draws again, as when the colours of the page changed. */
  draw(): void {
    const { profile } = this;
    if (!profile || !this.plot.clientWidth) return;
    this.numbers(profile);
    const styles = getComputedStyle(this.plot);
    const colour = (name: string) => styles.getPropertyValue(name).trim();
    const first = profile.r_mm[profile.r_mm.length - 1] / DECADES;
    const rows = profile.r_mm.map((r, i) => ({ r, row: profile.reflectance_per_mm2[i] })).filter(({ r }) => r >= first);
    const column = (k: number) => rows.map(({ r, row }) => leaving(r, row[k]));
    const counted = profile.monte_carlo.flatMap((rings) => rings?.r_mm.map((r, i) => leaving(r, rings.reflectance_per_mm2[i])) ?? []);
    const highest = Math.max(1e-6, ...counted, ...[0, 1, 2].flatMap(column));
    const texel = this.showing?.atlas.texel_mm ?? 0;
    const axis = { stroke: colour("--dim"), grid: { stroke: colour("--line"), width: 1 }, ticks: { stroke: colour("--line"), width: 1 }, font: "11px system-ui" };
    const options: uPlot.Options = {
      width: this.plot.clientWidth,
      height: 170,
      legend: { show: false },
      cursor: { drag: { x: false, y: false }, y: false },
      scales: { x: { time: false, distr: 3 }, y: { range: [0, 1.08 * highest] } },
      axes: [
        { ...axis, label: "distance [mm]", labelSize: 16, labelFont: "11px system-ui", size: 30, values: (_, ticks) => ticks.map((tick) => (Math.abs(Math.log10(tick) - Math.round(Math.log10(tick))) < 1e-6 ? plain(tick) : "")) },
        { ...axis, size: 54, values: (_, ticks) => ticks.map((tick) => `${plain(tick)} %`) },
      ],
      hooks: { draw: [(chart) => mark(chart, texel, colour("--dim")), (chart) => profile.monte_carlo.forEach((rings, k) => rings && dots(chart, rings, colour(`--${CHANNELS[k]}`)))] },
      series: [{}, ...CHANNELS.map((name) => ({ label: name, stroke: colour(`--${name}`), width: 2, points: { show: false } }))],
    };
    this.chart?.destroy();
    this.chart = new uPlot(options, [rows.map(({ r }) => r), column(0), column(1), column(2)] as uPlot.AlignedData, this.plot);
    this.photons.hidden = !profile.monte_carlo.some(Boolean);
    const reach = profile.radius_mm["0.9"].map(plain).join(", ");
    this.plot.setAttribute("aria-label", `Scattering profile; nine tenths of the light leave within ${reach} mm for red, green, blue`);
  }

  private numbers(profile: Profile): void {
    const texel = this.showing?.atlas.texel_mm ?? null;
    const rows: [string, (number | null)[], boolean][] = [
      ["Mean free path", profile.mean_free_path_mm, true],
      ["Diffusion length", profile.diffusion_length_mm, true],
      ["Half leaves within", profile.radius_mm["0.5"], true],
      ["90 % leaves within", profile.radius_mm["0.9"], true],
      ["99 % leaves within", profile.radius_mm["0.99"], true],
      ["Comes back", profile.total, false],
      ["Error of the fit", profile.fit_error, false],
    ];
    const cell = (value: number | null, length: boolean) => {
      if (value === null) return "∞";
      if (!length) return value < 0.02 ? `${plain(100 * value)} %` : `${(100 * value).toFixed(0)} %`;
      return two(value);
    };
    const head = h("tr", null, h("th", { scope: "col" }, "mm (tx: texels)"), ...CHANNELS.map((name) => h("th", { scope: "col", class: name }, name)));
    const body = rows.map(([name, values, length]) => h("tr", null, h("th", { scope: "row" }, name), ...values.map((value) => h("td", null, cell(value, length), length && texel && value !== null ? h("small", null, `${two(value / texel)} tx`) : null))));
    this.table.replaceChildren(h("thead", null, head), h("tbody", null, ...body));
    this.warnings.replaceChildren(...this.warn(profile, texel).map((text) => h("li", null, text)));
  }

  /** What is wrong with the scale, in sentences. */
  private warn(profile: Profile, texel: number | null): string[] {
    const said: string[] = [];
    const off = Math.max(...profile.fit_error);
    if (off > FAR_OFF) said.push(`The sum of Gaussians is ${plain(Number((100 * off).toPrecision(2)))} % away from the profile: more of them, under Method, come closer.`);
    const most = Math.max(...profile.radius_mm["0.99"]);
    const narrow = CHANNELS.filter((_, k) => texel && profile.radius_mm["0.5"][k] < texel);
    if (texel && narrow.length) {
      const half = Math.min(...profile.radius_mm["0.5"]);
      const which = narrow.length < CHANNELS.length ? ` of the ${narrow.join(" and ")} light` : " of the light";
      said.push(`Half${which} stays within ${plain(Number((half / texel).toPrecision(2)))} texels: the picture can hardly show how it spreads. A larger light map, or a smaller object, would.`);
    }
    const box = this.showing?.mesh.box_mm;
    if (box) {
      const size = Math.max(...[0, 1, 2].map((k) => box[1][k] - box[0][k]));
      if (most > size) said.push(`Light spreads over ${plain(most)} mm, farther than the object is long (${plain(size)} mm). Is its unit right?`);
    }
    return said;
  }
}

/** Light that leaves per step of log r, in percent: on a logarithmic axis areas are shares. */
const leaving = (r: number, perArea: number): number => 100 * 2 * Math.PI * r * r * perArea;

const two = (value: number): string => plain(Number(value.toPrecision(2)));

/** Rings of Monte Carlo, each a dot with a bar of two standard errors up and down. */
function dots(chart: uPlot, rings: Rings, stroke: string): void {
  const { ctx, bbox } = chart;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  ctx.strokeStyle = ctx.fillStyle = stroke;
  ctx.lineWidth = devicePixelRatio;
  rings.r_mm.forEach((r, i) => {
    const place = (value: number) => chart.valToPos(leaving(r, value), "y", true);
    const x = chart.valToPos(r, "x", true);
    const [value, error] = [rings.reflectance_per_mm2[i], 2 * rings.error_per_mm2[i]];
    ctx.beginPath();
    ctx.moveTo(x, place(value - error));
    ctx.lineTo(x, place(value + error));
    ctx.stroke();
    ctx.beginPath();
    ctx.arc(x, place(value), 2.2 * devicePixelRatio, 0, 2 * Math.PI);
    ctx.fill();
  });
  ctx.restore();
}

/** A dashed line at `x`, where it is on the chart. */
function mark(chart: uPlot, x: number, stroke: string): void {
  const { ctx, bbox } = chart;
  const at = chart.valToPos(x, "x", true);
  if (!(x > 0) || at < bbox.left || at > bbox.left + bbox.width) return;
  ctx.save();
  ctx.strokeStyle = stroke;
  ctx.setLineDash([4, 4]);
  ctx.beginPath();
  ctx.moveTo(at, bbox.top);
  ctx.lineTo(at, bbox.top + bbox.height);
  ctx.stroke();
  ctx.restore();
}
