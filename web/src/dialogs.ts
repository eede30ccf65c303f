// Dialogs: help, and the scene for elsewhere.

import { h, iconButton, save } from "./dom";
import { asCommand, asJson, asPython } from "./export";
import { toast } from "./toast";
import type { Scene } from "./types";

const KEYS: [string, string][] = [
  ["Drag, arrows", "turn the object"],
  ["Shift and drag, Shift and arrows", "move the light (two fingers on a touch screen)"],
  ["Right drag, Ctrl and drag", "shift the view"],
  ["Wheel, + and -, pinch", "zoom"],
  ["F", "frame the object"],
  ["R", "reset the view"],
  ["C", "compare A | B"],
  ["T", "turntable"],
  ["S", "save a picture"],
  ["Ctrl Z, Ctrl Shift Z", "undo, redo"],
  ["?", "this help"],
];

function dialog(title: string, ...content: Node[]): HTMLDialogElement {
  const close = iconButton("remove", "Close", () => box.close());
  const id = `dialog-${title.toLowerCase().replace(/\W+/g, "-")}`;
  const box = h("dialog", { "aria-labelledby": id }, h("div", { class: "dialog-head" }, h("h2", { id }, title), close), ...content);
  box.addEventListener("click", (event) => {
    if (event.target === box) box.close(); // beside it
  });
  box.addEventListener("close", () => document.body.append(document.getElementById("toasts")!)); // which came into it
  document.body.append(box);
  return box;
}

export function helpDialog(): HTMLDialogElement {
  const words = h(
    "div",
    { class: "words" },
    h("p", null, "Light does not only bounce off skin, stone, wax or milk: it goes in, scatters among the layers below, and comes out somewhere else. That is why an ear glows red with the sun behind it, and why shadows on skin have soft, coloured edges."),
    h("p", null, "Here you build such a material from layers, light it, and see what it does on a mesh. The cut at the top of Material shows the layers to scale and how far red, green and blue spread. Compare A | B shows what would be missing without it."),
    h("p", null, "All lengths are real: thickness and distance are millimetres, so the size of your object matters. Look inside shows every step between the lamp and the picture, with its numbers."),
  );
  const keys = h("dl", { class: "keys" }, ...KEYS.flatMap(([key, what]) => [h("dt", null, key), h("dd", null, what)]));
  const notices = h("p", { class: "note" }, "This page loads nothing from elsewhere. ", h("a", { href: "/third-party.md" }, "What it is made of"), ".");
  return dialog("What am I looking at?", words, h("h3", null, "Keys"), keys, notices);
}

type Form = "json" | "command" | "python";

const FORMS: Record<Form, [string, string, (scene: Scene) => string]> = {
  json: ["Scene", "scene.json", asJson],
  command: ["Command line", "render.sh", asCommand],
  python: ["Python", "bake.py", asPython],
};

/** Where the scene is copied or saved in one of its forms. `model` makes the baked GLB. */
export function exportDialog(scene: () => Scene, model: () => Promise<void>): HTMLDialogElement & { refresh(): void } {
  const text = h("textarea", { readonly: true, rows: 14, spellcheck: "false", "aria-label": "The scene as text" });
  const select = h("select", { id: "export-form", onchange: () => refresh() }, ...Object.entries(FORMS).map(([key, [name]]) => h("option", { value: key }, name)));
  const refresh = () => void (text.value = FORMS[select.value as Form][2](scene()));
  const copy = h("button", { type: "button", class: "primary", onclick: () => copyText(text.value, "Copied") }, "Copy");
  const file = h("button", { type: "button", onclick: () => save(FORMS[select.value as Form][1], new Blob([text.value], { type: "text/plain" })) }, "Save as a file");
  const glb = h("button", {
    type: "button",
    onclick: async () => {
      box.close(); // progress and a way to cancel stand on the picture
      glb.disabled = true;
      await model().finally(() => (glb.disabled = false));
    },
  }, "Save the baked model (GLB)");
  const row = h("div", { class: "control row" }, h("label", { for: "export-form" }, "As"), select);
  const box = dialog("Take it with you", row, text, h("div", { class: "buttons" }, copy, file, glb));
  return Object.assign(box, { refresh });
}

/** Puts text on the clipboard and says so. */
export async function copyText(text: string, said: string, otherwise = "Select the text and copy it."): Promise<void> {
  try {
    await navigator.clipboard.writeText(text);
    toast(said, "", "note");
  } catch {
    toast("The clipboard is closed to this page", otherwise);
  }
}
