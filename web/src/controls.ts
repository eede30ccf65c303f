// Native form controls bound to the store: each knows how to show the state and to change it.

import { h, icon, newId, plain } from "./dom";
import type { Store } from "./store";
import type { State } from "./state";
import { fromHex, toHex } from "./material";
import type { Triple } from "./types";

/** Something on a panel that follows the state. */
export interface Control {
  element: HTMLElement;
  sync(): void;
}

interface SliderOptions {
  label: string;
  min: number;
  max: number;
  unit?: string;
  log?: boolean;
  /** What the number field takes beyond the slider. */
  limits?: [number, number];
  hint?: string;
  /** Where problems of the service point. */
  pointer?: string;
  get(state: State): number;
  set(state: State, value: number): void;
  initial?: (state: State) => number | undefined;
}

const STEPS = 1000;

/** A slider with a number field, its unit and a way back. */
export function slider(store: Store, options: SliderOptions): Control {
  const id = newId();
  const { min, max, log } = options;
  const [least, most] = options.limits ?? [min, max];
  const toPosition = (value: number) =>
    Math.round(STEPS * (log ? Math.log(Math.max(value, min) / min) / Math.log(max / min) : (value - min) / (max - min)));
  const toValue = (position: number) => {
    const share = position / STEPS;
    const value = log ? min * (max / min) ** share : min + share * (max - min);
    return Number(value.toPrecision(3));
  };
  const range = h("input", {
    type: "range",
    id,
    min: 0,
    max: STEPS,
    oninput: () => store.edit((state) => options.set(state, toValue(range.valueAsNumber)), true),
    onchange: () => store.commit(),
  });
  const number = h("input", {
    type: "number",
    class: "number",
    step: "any",
    min: least,
    max: most,
    "aria-label": options.unit ? `${options.label} in ${options.unit}` : `${options.label}, as a number`,
    "data-pointer": options.pointer,
    onchange: () => {
      const value = number.valueAsNumber;
      if (Number.isFinite(value)) store.edit((state) => options.set(state, Math.min(Math.max(value, least), most)));
      number.value = plain(options.get(store.state)); // what holds, which may be less
    },
    onblur: () => sync(),
  });
  const back = wayBack(store, options);
  const sync = () => {
    const value = options.get(store.state);
    const position = toPosition(value);
    if (range.valueAsNumber !== position && document.activeElement !== range) range.value = String(position);
    else if (document.activeElement === range && Math.abs(toValue(range.valueAsNumber) - value) > 1e-9 * Math.abs(value))
      range.value = String(position);
    range.setAttribute("aria-valuetext", `${plain(value)} ${options.unit ?? ""}`.trim());
    if (document.activeElement !== number || !number.value) number.value = plain(value);
    const initial = options.initial?.(store.state);
    back.hidden = initial === undefined || alike(initial, value);
  };
  const label = h("label", { for: id, title: options.hint }, options.label);
  const unit = h("span", { class: "unit" }, options.unit ?? "");
  const element = h("div", { class: "control slider" }, h("div", { class: "head" }, label, back, h("span", { class: "value" }, number, unit)), range);
  sync();
  return { element, sync };
}

/** A button that brings back what a control began with. */
function wayBack<T>(store: Store, options: { label: string; set(state: State, value: T): void; initial?: (state: State) => T | undefined }): HTMLButtonElement {
  const act = () => {
    const value = options.initial?.(store.state);
    if (value !== undefined) store.edit((state) => options.set(state, value));
  };
  return h("button", { type: "button", class: "reset", "aria-label": `Reset ${options.label}`, title: "Reset", onclick: act }, icon("reset"));
}

const alike = (initial: number, value: number): boolean => Math.abs(initial - value) <= 1e-6 * Math.max(Math.abs(initial), 1e-6);

interface ChoiceOptions<T extends string> {
  label: string;
  choices: [T, string][];
  hint?: string;
  pointer?: string;
  get(state: State): T;
  set(state: State, value: T): void;
}

/** One of a few. */
export function choice<T extends string>(store: Store, options: ChoiceOptions<T>): Control {
  const id = newId();
  const select = h(
    "select",
    {
      id,
      "data-pointer": options.pointer,
      onchange: () => store.edit((state) => options.set(state, select.value as T)),
    },
    ...options.choices.map(([value, name]) => h("option", { value }, name)),
  );
  const sync = () => void (select.value = options.get(store.state));
  const element = h("div", { class: "control row" }, h("label", { for: id, title: options.hint }, options.label), select);
  sync();
  return { element, sync };
}

interface ColourOptions {
  label: string;
  hint?: string;
  get(state: State): Triple;
  set(state: State, value: Triple): void;
}

/** A colour, linear in the state. */
export function colour(store: Store, options: ColourOptions): Control {
  const id = newId();
  const input = h("input", {
    type: "color",
    id,
    oninput: () => store.edit((state) => options.set(state, fromHex(input.value)), true),
    onchange: () => store.commit(),
  });
  const sync = () => void (input.value = toHex(options.get(store.state)));
  const element = h("div", { class: "control row", title: options.hint }, h("label", { for: id }, options.label), input);
  sync();
  return { element, sync };
}

interface CheckOptions {
  label: string;
  hint?: string;
  get(state: State): boolean;
  set(state: State, value: boolean): void;
}

/** Yes or no. */
export function check(store: Store, options: CheckOptions): Control {
  const input = h("input", {
    type: "checkbox",
    onchange: () => store.edit((state) => options.set(state, input.checked)),
  });
  const sync = () => void (input.checked = options.get(store.state));
  const element = h("label", { class: "control check", title: options.hint }, input, options.label);
  sync();
  return { element, sync };
}

interface TripleOptions {
  label: string;
  unit: string;
  least: number;
  pointer?: string;
  get(state: State): Triple;
  set(state: State, value: Triple): void;
  initial?: (state: State) => Triple | undefined;
}

/** Red, green and blue as numbers, and a way back. */
export function triple(store: Store, options: TripleOptions): Control {
  const names = ["red", "green", "blue"];
  const inputs = names.map((name, k) =>
    h("input", {
      type: "number",
      class: `number ${name}`,
      step: "any",
      min: options.least,
      "aria-label": `${options.label}, ${name}, in ${options.unit}`,
      "data-pointer": options.pointer,
      onchange: (event: Event) => {
        const value = (event.target as HTMLInputElement).valueAsNumber;
        if (Number.isFinite(value))
          store.edit((state) => {
            const next = [...options.get(state)] as Triple;
            next[k] = Math.max(value, options.least);
            options.set(state, next);
          });
        inputs[k].value = plain(options.get(store.state)[k]);
      },
    }),
  );
  const back = wayBack(store, options);
  const sync = () => {
    const values = options.get(store.state);
    values.forEach((value, k) => {
      if (document.activeElement !== inputs[k]) inputs[k].value = plain(value);
    });
    const initial = options.initial?.(store.state);
    back.hidden = initial === undefined || values.every((value, k) => alike(initial[k], value));
  };
  const legend = h("div", { class: "head" }, h("span", null, options.label), back, h("span", { class: "unit" }, options.unit));
  const element = h("div", { class: "control triple", role: "group", "aria-label": options.label }, legend, h("div", { class: "three" }, ...inputs));
  sync();
  return { element, sync };
}

/** A titled part of a panel. */
export function section(title: string, ...children: (Node | string | null | false)[]): HTMLElement {
  return h("section", { class: "section" }, h("h2", null, title), ...children);
}
