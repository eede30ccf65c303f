// Elements in one line each.

type Child = Node | string | null | undefined | false;
type Props = Record<string, unknown>;

/** An element; `on…` are listeners, `class` and attributes as in HTML, other functions and objects set as given. */
export function h<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  props: Props | null = null,
  ...children: Child[]
): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  dress(element, props);
  element.append(...children.filter((child): child is Node | string => Boolean(child)));
  return element;
}

/** The same for SVG. */
export function s(tag: string, props: Props | null = null, ...children: Child[]): SVGElement {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  dress(element, props);
  element.append(...children.filter((child): child is Node | string => Boolean(child)));
  return element;
}

function dress(element: Element, props: Props | null): void {
  for (const [name, value] of Object.entries(props ?? {})) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value as EventListener);
    else element.setAttribute(name, value === true ? "" : String(value));
  }
}

const FOCUSABLE = "button:not(:disabled), input:not(:disabled), select:not(:disabled)";

/** Builds the inside of `root` anew and puts the focus where it was, or as near as there is something. */
export function keepFocus(root: HTMLElement, build: () => void): void {
  const path: number[] = [];
  let at: Element | null = document.activeElement;
  const had = at !== null && at !== root && root.contains(at);
  for (; had && at && at !== root; at = at.parentElement) path.unshift([...at.parentElement!.children].indexOf(at));
  build();
  if (!had) return;
  let now: Element = root;
  for (const i of path) now = now.children[Math.min(i, now.children.length - 1)] ?? now;
  for (let near: Element | null = now; near && root.contains(near); near = near.parentElement) {
    const found = near.matches(FOCUSABLE) ? near : near.querySelector(FOCUSABLE);
    if (found instanceof HTMLElement) return found.focus({ preventScroll: true });
  }
}

const PATHS: Record<string, string> = {
  undo: "M9 7 4 12l5 5M4 12h10a6 6 0 0 1 6 6",
  redo: "m15 7 5 5-5 5M20 12H10a6 6 0 0 0-6 6",
  open: "M4 19V6h6l2 3h8v10zM12 16v-4m-2 2 2-2 2 2",
  compare: "M12 3v18M4 7h5v10H4zM15 7h5v10h-5z",
  link: "M10 14a4 4 0 0 0 6 0l3-3a4 4 0 0 0-6-6l-1 1m2 4a4 4 0 0 0-6 0l-3 3a4 4 0 0 0 6 6l1-1",
  export: "M12 4v11m-4-4 4 4 4-4M5 20h14",
  camera: "M4 8h4l2-3h4l2 3h4v11H4zM12 10a3.5 3.5 0 1 0 0 7 3.5 3.5 0 0 0 0-7",
  help: "M12 3a9 9 0 1 0 0 18 9 9 0 0 0 0-18M9.6 9.5a2.5 2.5 0 1 1 3.4 2.3c-.7.3-1 .8-1 1.7M12 16.6v.4",
  theme: "M12 4a8 8 0 1 0 8 8 6 6 0 0 1-8-8",
  eye: "M2.5 12S6 5.5 12 5.5 21.5 12 21.5 12 18 18.5 12 18.5 2.5 12 2.5 12M12 9a3 3 0 1 0 0 6 3 3 0 0 0 0-6",
  hidden: "M4 4l16 16M9 6.2A9 9 0 0 1 12 5.500c6 0 9.500 6.500 9.500 6.500a16 16 0 0 1-3 3.700M6 8a16 16 0 0 0-3.500 4S6 18.500 12 18.500a9 9 0 0 0 3.500-.7",
  up: "m6 14 6-6 6 6",
  down: "m6 10 6 6 6-6",
  remove: "M6 6l12 12M18 6 6 18",
  reset: "M5 12a7 7 0 1 0 2.300-5.200M5 4v4.500h4.500",
  add: "M12 5v14M5 12h14",
  sun: "M12 8a4 4 0 1 0 0 8 4 4 0 0 0 0-8M12 2v2.500M12 19.500V22M2 12h2.500M19.500 12H22M4.900 4.900l1.800 1.800M17.300 17.300l1.800 1.800M4.900 19.100l1.800-1.800M17.300 6.700l1.800-1.800",
  frame: "M4 9V4h5M15 4h5v5M20 15v5h-5M9 20H4v-5",
  home: "M4 11.500 12 4l8 7.500M6.500 10v9.500h11V10",
  turn: "M20 12a8 3.500 0 1 1-5-3.200M13 6l2.500 2.700L13 11.500",
  unfold: "M4 6l5-2 6 2 5-2v14l-5 2-6-2-5 2zM9 4v14M15 6v14",
  map: "M4 5h16v14H4zM4 15l5-5 4 4 3-2.500 4 3.500",
  pin: "M12 15v6M8 4h8l-1 6 2.500 3v1.500h-11V13L9 10z",
};

/** A line drawing; it takes the colour of the text. */
export function icon(name: keyof typeof PATHS | string): SVGElement {
  return s("svg", { viewBox: "0 0 24 24", class: "icon", "aria-hidden": "true" }, s("path", { d: PATHS[name] }));
}

/** A button that is a drawing; `label` is what it is called and its tooltip. */
export function iconButton(name: string, label: string, act: (event: Event) => void, keys = ""): HTMLButtonElement {
  const props = { type: "button", class: "icon-button", "aria-label": label, title: keys ? `${label} (${keys})` : label };
  return h("button", { ...props, onclick: act }, icon(name));
}

let ids = 0;

/** An id that no other element has. */
export const newId = (): string => `e${++ids}`;

/** A number as people write it: three digits that matter. */
export function plain(value: number): string {
  if (!Number.isFinite(value)) return "∞";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size < 0.001 || size >= 1e5) return value.toExponential(1);
  return String(Number(value.toPrecision(3)));
}

/** Saves bytes or text as a file. */
export function save(name: string, content: Blob): void {
  const url = URL.createObjectURL(content);
  h("a", { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 10_000);
}
