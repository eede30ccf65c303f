// The stack as a cut through the surface: thickness to scale, and how far light spreads in it.

import { h, plain, s } from "../dom";
import { toColour, toHex } from "../material";
import { coefficients, type Layer } from "../state";
import type { Profile } from "../types";

const WIDTH = 312;
const HEIGHT = 132;
const SURFACE = 20;
const LEAST_SHARE = 0.3; // of the height, for the layers that end
const HAIR = 3; // thinner layers than this many pixels are drawn so

/** The layer's colour as a swatch shows it. */
export function swatch(layer: Layer): string {
  if (layer.by === "given") return "#888888";
  const { sigma_a, sigma_s } = coefficients(layer);
  return toHex(layer.by === "colour" ? layer.colour : toColour(sigma_a, sigma_s, layer.g));
}

/** A picture of the layers. `profile` adds the reach of red, green and blue. */
export class CrossSection {
  readonly element = h("figure", { class: "cross-section" });
  private readonly caption = h("figcaption");
  private profile: Profile | null = null;
  private layers: Layer[] = [];
  private painted = false;

  constructor(private readonly pick: (index: number) => void) {}

  setProfile(profile: Profile | null): void {
    this.profile = profile;
    this.stale(false);
    this.draw(this.layers, this.painted);
  }

  /** The reach shown is of other layers. */
  stale(yes: boolean): void {
    this.element.classList.toggle("stale", yes);
  }

  /** `painted`: depth textures say where layers end; all are drawn alike. */
  draw(layers: Layer[], painted = false): void {
    this.painted = painted;
    this.layers = layers;
    const heard = layers.map((layer, index) => ({ layer, index })).filter(({ layer }) => !layer.muted);
    const finite = heard.reduce((sum, { layer }, i) => sum + (this.endless(heard.length, layer, i) ? 0 : (layer.thickness_mm ?? 1)), 0);
    const reach = Math.max(...(this.profile?.radius_mm["0.9"] ?? [0]), 0.05);
    // what is shown [mm]: all finite layers, and below them a depth that light reaches
    const endless = heard.length > 0 && this.endless(heard.length, heard[heard.length - 1].layer, heard.length - 1);
    const wide = finite > 0 ? Math.min(1.05 * reach, finite / LEAST_SHARE) : 1.05 * reach;
    const depth = endless ? Math.max(wide, 1.25 * finite) : Math.max(finite, 1e-3);
    const scale = (HEIGHT - SURFACE) / depth; // pixels per mm
    const svg = s("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img" });
    const defs = s("defs");
    svg.append(defs);
    let top = SURFACE;
    const words: string[] = [];
    const labels: SVGElement[] = []; // over everything
    heard.forEach(({ layer, index }, i) => {
      const last = i === heard.length - 1;
      const open = this.endless(heard.length, layer, i);
      const tall = open ? HEIGHT - top : Math.max((layer.thickness_mm ?? 1) * scale, HAIR);
      const fill = swatch(layer);
      const rect = s("rect", { x: 0, y: top, width: WIDTH, height: Math.max(tall, 0), fill, class: "stratum", onclick: () => this.pick(index) });
      svg.append(rect);
      if (!last) svg.append(s("line", { x1: 0, x2: WIDTH, y1: top + tall, y2: top + tall, class: "boundary" }));
      const thickness = layer.thickness_map || (painted && !open) ? "as painted" : open ? "endless" : `${plain(layer.thickness_mm ?? 1)} mm`;
      words.push(thickness);
      if (tall >= 15) {
        const label = `${index + 1} · ${thickness}`;
        labels.push(s("text", { x: WIDTH - 8, y: top + Math.min(tall / 2, 40) + 4, class: `label ${ink(fill)}` }, label));
      }
      top += tall;
    });
    this.reach(svg, defs, scale);
    this.ruler(svg, scale);
    svg.append(...labels);
    svg.setAttribute("aria-label", `Cut through the surface: ${words.length} layers, ${words.join(", ")}`);
    const reaches = (this.profile?.radius_mm["0.9"] ?? []).map((mm, k) => h("b", { class: ["red", "green", "blue"][k] }, plain(Number(mm.toPrecision(2)))));
    this.caption.replaceChildren(...(reaches.length ? ["Light that enters here comes out within ", ...joined(reaches), " mm: its red, green and blue."] : [""]));
    this.element.replaceChildren(svg, this.caption);
  }

  private endless(count: number, layer: Layer, i: number): boolean {
    return i === count - 1 && layer.thickness_mm === null && !layer.thickness_map;
  }

  private reach(svg: SVGElement, defs: SVGElement, scale: number): void {
    const x = WIDTH * 0.36;
    const spot = s("radialGradient", { id: "glow" }, s("stop", { offset: 0, class: "glow-in" }), s("stop", { offset: 1, class: "glow-out" }));
    defs.append(spot);
    const clip = s("clipPath", { id: "below" }, s("rect", { x: 0, y: SURFACE, width: WIDTH, height: HEIGHT - SURFACE }));
    defs.append(clip);
    const group = s("g", { "clip-path": "url(#below)", class: "reach" });
    const most = Math.max(...(this.profile?.radius_mm["0.9"] ?? [0])) * scale;
    group.append(s("circle", { cx: x, cy: SURFACE, r: Math.min(Math.max(most, 1), 2000), fill: "url(#glow)" }));
    const radii = this.profile?.radius_mm["0.9"] ?? [];
    const names = ["red", "green", "blue"];
    radii.forEach((radius, k) => {
      const place = { cx: x, cy: SURFACE, r: Math.min(radius * scale, 2000) };
      group.append(s("circle", { ...place, class: "under" }), s("circle", { ...place, class: names[k] }));
    });
    svg.append(group);
    svg.append(s("path", { d: `M${x} 1v${SURFACE - 3}m-4-5 4 5 4-5`, class: "beam" }));
    svg.append(s("line", { x1: 0, x2: WIDTH, y1: SURFACE, y2: SURFACE, class: "surface-line" }));
  }

  private ruler(svg: SVGElement, scale: number): void {
    const target = 60 / scale;
    const power = 10 ** Math.floor(Math.log10(target));
    const step = [1, 2, 5, 10].map((m) => m * power).filter((mm) => mm <= target * 1.2).pop() ?? power;
    const length = step * scale;
    const y = SURFACE - 7;
    svg.append(s("path", { d: `M${WIDTH - 8 - length} ${y - 3}v6m0-3h${length}m0-3v6`, class: "ruler" }));
    svg.append(s("text", { x: WIDTH - 14 - length, y: y + 4, class: "ruler-label" }, `${plain(step)} mm`));
  }
}

function ink(fill: string): string {
  const [r, g, b] = [1, 3, 5].map((at) => parseInt(fill.slice(at, at + 2), 16));
  return 0.3 * r + 0.59 * g + 0.11 * b > 140 ? "dark" : "light";
}

/** One, another and a third. */
const joined = (nodes: Node[]): (Node | string)[] => nodes.flatMap((node, k) => [k === 0 ? "" : k === nodes.length - 1 ? " and " : ", ", node]);
