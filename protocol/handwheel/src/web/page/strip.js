// What is always in view below the bar: faults with their remedies, why a motor does not do what was asked, and
// what happened. An answer that refuses is told here too.

import { ask, on, told } from "/link.js";
import { duration, el, number, put, words, writer, button } from "/ui.js";

const NOTES = 50;
const STALE_MS = 1000;
/** Link loss: on record whenever a host has ended. It stops nothing by itself, so it is no alarm. */
const ON_RECORD = 22;

const faultList = document.getElementById("faults");
const noteList = document.getElementById("notes");

/** Tells the person something. `kind`: "error", "good" or none. */
export function note(text, kind = "") {
  const first = noteList.firstElementChild;
  if (first && first.dataset.text === text) {
    const times = Number(first.dataset.times) + 1;
    first.dataset.times = times;
    put(first.querySelector("time"), `${clock()} ×${times}`);
    return;
  }
  const item = el("li", { class: kind, "data-text": text, "data-times": 1 }, el("time", { text: clock() }), el("span", { text }));
  noteList.prepend(item);
  while (noteList.childElementCount > NOTES) noteList.lastElementChild.remove();
  noteList.scrollTop = 0;
}

const clock = () => new Date().toTimeString().slice(0, 8);

/** Asks, tells what is refused, and returns the answer; undefined if it was refused. */
export async function attempt(what, values = {}, whose = "") {
  try {
    return (await ask(what, values)) ?? null;
  } catch (error) {
    note(`${whose || what}: ${error.message}`, "error");
    return undefined;
  }
}

let faults = [];
let reasons = [];
let shown = "";
let lastState = 0;

/** Lines above the faults: what is wrong with the link, the board's own state. */
function general() {
  const lines = [];
  const board = told("board");
  const state = told("state");
  if (!told("socket")?.open) lines.push(["bad", "No connection to handwheel: it stops what this page drove; if it has ended, the board does by its link timeout. The page tries again every second."]);
  else if (board && !board.connected) lines.push(["bad", `No board: ${board.why ?? "it does not answer"}`]);
  else if (board?.has_state && told("job")?.has_state !== false && state && performance.now() - lastState > STALE_MS) lines.push(["bad", "The board's state has not come for a second: what you see is old"]);
  if (state?.obstacle) lines.push(["warn", "An obstacle is in the way: collision protection holds the wheels back"]);
  if (board?.connected && board.has_state === false && board.kind === "pms5005") lines.push(["warn", "This board tells no state of its motors (older firmware): charts show what its telemetry has"]);
  return lines;
}

function render() {
  const lines = general();
  const key = JSON.stringify([lines, reasons, faults, Boolean(told("faults")), Boolean(told("board"))]);
  if (key === shown) return;
  shown = key;
  const items = lines.map(([kind, text]) => el("li", { class: kind }, el("span", { text })));
  if (faults.length > 1) {
    const all = writer(button("Clear all", () => attempt("clear", {}, "clear all"), { id: "clear-all", "aria-label": "Clear all faults" }));
    items.push(el("li", { class: "bad" }, all, el("b", { text: `${faults.length} faults` })));
  }
  for (const fault of faults) items.push(faultLine(fault));
  for (const [motor, reason] of reasons) {
    if (faults.some((fault) => fault.motor === motor && reason.includes(fault.name))) continue; // said above
    items.push(el("li", { class: "warn", "data-reason": motor }, el("b", { text: `Motor ${motor}` }), el("span", { text: reason })));
  }
  if (!items.length && told("faults")) items.push(el("li", { class: "fine" }, el("span", { text: "No faults" })));
  else if (!items.length && told("board")) items.push(el("li", {}, el("span", { text: "This board has told nothing of faults" })));
  faultList.replaceChildren(...items);
}

function faultLine(fault) {
  const values = (fault.values ?? []).map(([name, value]) => `${name} ${words(value)}`).join(", ");
  const about = `at ${duration(fault.ms ?? 0)}${values ? `; ${values}` : ""}`;
  const clear = writer(button("Clear", () => attempt("clear", fault.motor ? { motor: fault.motor } : {}, `clear ${fault.name}`), {
    "data-do": "clear", "aria-label": `Clear fault ${fault.name} of ${fault.whose}`,
    title: fault.motor ? "" : "clears all that is latched",
  }));
  return el("li", { class: fault.number === ON_RECORD ? "" : "bad", "data-fault": fault.number }, clear,
    el("b", { text: `${capital(fault.whose)}: ${fault.name}` }),
    el("span", { text: fault.remedy ?? "" }),
    el("small", { text: `(fault ${number(fault.number)} ${about})` }));
}

const capital = (text) => String(text ?? "").replace(/^./, (letter) => letter.toUpperCase());

export function start() {
  on("note", ({ text }) => note(text));
  on("faults", (told) => {
    const rank = (fault) => (fault.number === ON_RECORD ? 1 : 0);
    faults = [...(told.faults ?? [])].sort((a, b) => rank(a) - rank(b) || b.ms - a.ms);
    render();
  });
  on("state", (state) => {
    lastState = performance.now();
    reasons = state.motors.flatMap((motor, i) => (motor.reason ? [[i + 1, motor.reason]] : []));
    render();
  });
  // While a tuning reads its recording no state comes.
  on("job", () => {
    lastState = performance.now();
  });
  for (const name of ["socket", "board"]) on(name, render);
  setInterval(render, 500);
}
