// What is done with all settings at once: save, defaults, and a file on this computer: backup, diff, restore.

import { told } from "/link.js";
import { button, el, labelled, sure, words, writer } from "/ui.js";
import { attempt, note } from "/strip.js";

let text = null;
let differences;
let diffButton;
let restoreButton;

async function backup() {
  const file = await attempt("backup");
  if (typeof file !== "string") return;
  const url = URL.createObjectURL(new Blob([file], { type: "application/toml" }));
  const name = `${(told("board")?.kind ?? "board").replace(/[^\w-]/g, "")}-${new Date().toISOString().slice(0, 10)}.toml`;
  const anchor = el("a", { href: url, download: name });
  document.body.append(anchor);
  anchor.click();
  anchor.remove();
  setTimeout(() => URL.revokeObjectURL(url), 10_000);
  note(`Backup: ${name}`, "good");
}

async function read(input) {
  const [file] = input.files;
  text = file ? await file.text() : null;
  diffButton.disabled = text === null;
  // Only what was compared is restored.
  forget();
  if (text !== null) await diff();
}

function forget() {
  delete restoreButton.dataset.writes;
  restoreButton.disabled = true;
  differences.replaceChildren();
}

async function diff() {
  forget();
  const answer = await attempt("diff", { text }, "diff");
  if (!answer) return;
  show(answer);
  writer(restoreButton);
}

function show({ differ = [], missing = [] }, done = false) {
  const parts = [];
  if (!differ.length) parts.push(el("p", { text: done ? "Nothing differs now." : "Nothing differs: the board has what the file has." }));
  else {
    parts.push(el("table", {}, el("thead", {}, el("tr", {}, ...["Setting", "Board", "File"].map((head) => el("th", { scope: "col", text: head })))),
      el("tbody", {}, ...differ.map(({ name, board, file }) => el("tr", {}, el("th", { scope: "row", text: name }), el("td", { text: words(board) }), el("td", { text: words(file) }))))));
  }
  if (missing.length) parts.push(el("p", { text: `Not in the file, and left as they are: ${missing.join(", ")}` }));
  differences.replaceChildren(...parts);
}

async function restore() {
  const answer = await attempt("restore", { text }, "restore");
  if (answer === undefined) return;
  note("Restored and saved: the board has what the file has", "good");
  if (answer) show(answer, true);
}

export async function save() {
  if ((await attempt("save")) !== undefined) note("Saved: what is in force outlasts a restart", "good");
}

async function reset() {
  if ((await attempt("reset")) !== undefined) note("The defaults are in force, and saved", "good");
}

/** The card with all of it. */
export function make() {
  const file = el("input", { id: "file", type: "file", accept: ".toml,text/*" });
  file.addEventListener("change", () => read(file));
  differences = el("div", { id: "differences", "aria-live": "polite" });
  diffButton = button("Diff", diff, { id: "diff", disabled: true });
  restoreButton = sure("Restore", "Yes, put it in force and save", restore, { id: "restore", disabled: true });
  return el("aside", { class: "card files scrolls" },
    el("h3", { text: "On the board" }),
    el("p", { class: "line" }, writer(button("Save", save, { id: "save" })), writer(sure("Reset to defaults", "Yes, reset all and save", reset, { id: "reset" }))),
    el("p", { class: "dim", text: "Both only with all motors and servos off." }),
    el("h3", { text: "In a file" }),
    el("p", { class: "line" }, button("Backup", backup, { id: "backup" })),
    labelled("Backup to compare", file),
    el("p", { class: "line" }, diffButton, restoreButton),
    differences);
}
