// What went wrong, said where people look, and at the field it concerns.

import { Problem } from "./api";
import { h, icon } from "./dom";

const LASTS_MS = 9000;

/** Shows a message; an error is announced at once. */
export function toast(title: string, detail = "", kind: "error" | "note" = "error"): void {
  const host = document.getElementById("toasts")!;
  const close = h("button", { type: "button", class: "icon-button", "aria-label": "Dismiss", onclick: () => one.remove() }, icon("remove"));
  const text = h("div", null, h("strong", null, title), detail ? h("p", null, detail) : null);
  const one = h("div", { class: `toast ${kind}`, role: kind === "error" ? "alert" : "status" }, text, close);
  host.append(one);
  while (host.children.length > 3) host.firstElementChild!.remove();
  setTimeout(() => one.remove(), LASTS_MS);
}

/** Shows a problem of the service: at its fields where they are on screen, and as a toast. */
export function showProblem(error: unknown): void {
  if (error instanceof Problem) {
    for (const { pointer, detail } of error.errors) {
      const field = [...document.querySelectorAll<HTMLElement>("[data-pointer]")].find((one) => pointer.startsWith(one.dataset.pointer!) || one.dataset.pointer!.startsWith(pointer + "/"));
      if (field) mark(field, detail);
    }
    const reason = error.errors[0]?.detail ?? error.message;
    toast(error.title, reason === error.message ? reason : error.message);
  } else {
    toast("Something broke in the page", error instanceof Error ? error.message : String(error));
    console.warn(error);
  }
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

/** Takes the marks away, once things are right again. */
export function clearProblems(): void {
  for (const said of document.querySelectorAll(".field-problem")) said.remove();
  for (const field of document.querySelectorAll("[aria-invalid]")) {
    field.removeAttribute("aria-invalid");
    field.removeAttribute("aria-describedby");
  }
}
