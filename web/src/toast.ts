// What went wrong, said where people look, and at the field it concerns.

import { Offline, Problem } from "./api";
import { h, icon } from "./dom";

const LASTS_MS = 9000; // of a note; an error stays until it is dismissed, or things have been right that long

/** Shows a message; an error is announced at once. In front of a dialog, where one is open. */
export function toast(title: string, detail = "", kind: "error" | "note" = "error"): void {
  const host = document.getElementById("toasts")!;
  const place = document.querySelector("dialog[open]") ?? document.body;
  if (host.parentElement !== place) place.append(host);
  const close = h("button", { type: "button", class: "icon-button", "aria-label": "Dismiss", onclick: () => one.remove() }, icon("remove"));
  const text = h("div", null, h("strong", null, title), detail ? h("p", null, detail) : null);
  const one = h("div", { class: `toast ${kind}`, role: kind === "error" ? "alert" : "status" }, text, close);
  host.append(one);
  while (host.children.length > 3) host.firstElementChild!.remove();
  if (kind === "note") fade(one);
}

/** Takes a message away after a while, not under the pointer or the focus. */
function fade(one: HTMLElement): void {
  setTimeout(() => (one.matches(":hover, :focus-within") ? fade(one) : one.remove()), LASTS_MS);
}

/** Shows a problem of the service: at its fields where they are on screen, and as a toast. */
export function showProblem(error: unknown): void {
  if (error instanceof Problem) {
    clearMarks();
    for (const { pointer, detail } of error.errors) {
      const field = fieldOf(pointer);
      if (field) mark(field, detail);
    }
    const reason = error.errors[0]?.detail ?? error.message;
    toast(error.title, reason === error.message ? reason : error.message);
  } else if (error instanceof Offline) toast("The service can't be reached", "Nothing is lost here: try again when it is back.");
  else {
    toast("Something broke in the page", error instanceof Error ? error.message : String(error));
    console.warn(error);
  }
}

/** The field that a pointer names, or the only one that it is about: by whole segments, the closest. */
function fieldOf(pointer: string): HTMLElement | undefined {
  const within = (one: string, other: string) => `${one}/`.startsWith(`${other}/`);
  const fields = [...document.querySelectorAll<HTMLElement>("[data-pointer]")].filter((field) => !field.closest("[hidden].control"));
  const above = fields.filter((field) => within(pointer, field.dataset.pointer!));
  above.sort((a, b) => b.dataset.pointer!.length - a.dataset.pointer!.length);
  const below = fields.filter((field) => within(field.dataset.pointer!, pointer));
  return above[0] ?? (below.length === 1 ? below[0] : undefined);
}

function mark(field: HTMLElement, detail: string): void {
  const box = field.closest(".control");
  if (!box) return;
  const id = `${field.id || field.dataset.pointer}-problem`;
  const said = h("p", { class: "field-problem", id }, detail);
  field.setAttribute("aria-invalid", "true");
  field.setAttribute("aria-describedby", id);
  box.append(said);
}

/** Things are right again: no field is marked, and what was said of errors goes by and by. */
export function clearProblems(): void {
  clearMarks();
  for (const one of document.querySelectorAll<HTMLElement>(".toast.error:not(.past)")) {
    one.classList.add("past");
    fade(one);
  }
}

function clearMarks(): void {
  for (const said of document.querySelectorAll(".field-problem")) said.remove();
  for (const field of document.querySelectorAll("[aria-invalid]")) {
    field.removeAttribute("aria-invalid");
    field.removeAttribute("aria-describedby");
  }
}
