// Arming and stopping: the part of the page that safety rests on.
//
// A page opens disarmed, and is disarmed after each new connection. Armed, it says `alive` every 50 ms from the
// page's own thread, so that a page that hangs falls silent and is stopped; the space bar stops everything,
// whatever has the focus; a page that is hidden or left stops and disarms itself at once.

import { ask, on, say, tell } from "/link.js";
import { note, attempt } from "/strip.js";

const ALIVE_MS = 50;

const armButton = document.getElementById("arm");
const stopButton = document.getElementById("stop");
const armedBy = document.getElementById("armed-by");

let armed = { by: null, you: false };
let isArming = false;
let beat = 0;
let swallowed = false;

/** Stops everything, and tells how it came out. */
async function stop() {
  tell("stopping", {});
  stopButton.classList.add("sent");
  setTimeout(() => stopButton.classList.remove("sent"), 400);
  try {
    const how = (await ask("stop")) ?? {};
    note(stopped(how), how.confirmed === false || how.stands === false || how.opposed ? "error" : "good");
  } catch (error) {
    note(`STOP: ${error.message}. Use the emergency switch`, "error");
  }
}

function stopped({ confirmed, stands, opposed }) {
  const parts = [];
  if (confirmed === true) parts.push("the board has confirmed it");
  if (confirmed === false) parts.push("the board has NOT confirmed it: use the emergency switch");
  if (stands === true) parts.push("everything stands");
  if (stands === false) parts.push("something still moves");
  if (opposed) parts.push("another host drives on: stop that one");
  return `STOP: ${parts.join(", ") || "sent"}`;
}

function show() {
  clearInterval(beat);
  if (armed.you) beat = setInterval(() => say("alive"), ALIVE_MS);
  document.body.dataset.armed = armed.you ? "here" : armed.by ? "elsewhere" : "no";
  armButton.setAttribute("aria-checked", String(armed.you));
  armButton.textContent = armed.you ? "Disarm" : "Arm";
  label();
}

function label() {
  let text = "Disarmed: this page only watches";
  if (armed.you) {
    text = document.hasFocus()
      ? `Armed: this page (${armed.by}). Space bar stops`
      : `Armed: this page (${armed.by}). NO FOCUS: click here, or the space bar does nothing`;
  } else if (armed.by) text = `Armed: ${armed.by}. This page only watches`;
  if (armedBy.textContent !== text) armedBy.textContent = text;
  armedBy.classList.toggle("unfocused", armed.you && !document.hasFocus());
}

/** This page is left: nothing waits for an answer. */
function leave() {
  if (!armed.you && !isArming) return;
  say("disarm");
  isArming = false;
  tell("armed", { by: null, you: false });
  note("This page was hidden or left: it has stopped what it drove, and is disarmed");
}

function onKey(event) {
  // A held Enter key must not drive again what was just stopped.
  if (armed.you && event.repeat && event.key === "Enter") event.preventDefault();
  const isSpace = event.code === "Space" || event.key === " ";
  if (!isSpace) return;
  const isDown = event.type === "keydown";
  if (!armed.you && !isArming && !(swallowed && !isDown)) return;
  event.preventDefault();
  event.stopImmediatePropagation();
  if (isDown && !event.repeat) stop();
  swallowed = event.type !== "keyup";
}

export function start() {
  for (const type of ["keydown", "keypress", "keyup"]) window.addEventListener(type, onKey, { capture: true });
  document.addEventListener("visibilitychange", () => document.hidden && leave());
  document.addEventListener("freeze", leave);
  window.addEventListener("pagehide", leave);
  window.addEventListener("focus", label);
  window.addEventListener("blur", label);
  stopButton.addEventListener("click", stop);
  armButton.addEventListener("click", async () => {
    if (armed.you) {
      await attempt("disarm");
      return;
    }
    isArming = true;
    await attempt("arm");
    isArming = false;
  });
  on("armed", (told) => {
    armed = told;
    if (armed.you && document.hidden) leave();
    else show();
  });
}
