// Tuning a motor: its gains and its other settings, and a step with its curve and figures beside those of the
// step before.

import { on, told } from "/link.js";
import { button, el, entered, labelled, number, put, words, writer } from "/ui.js";
import { attempt, note } from "/strip.js";
import { fill, HEAD } from "/field.js";
import { save } from "/files.js";
import { draw } from "/curve.js";
import { onColors } from "/chart.js";
import * as selftune from "/selftune.js";

const LONGEST_MS = 60_000;
const UNITS = { velocity: "counts/s", position: "counts" };
const FIGURES = [
  // Positions of the wire wrap; those of the chart count turn by turn.
  ["target", (s) => `${number(s.asked)}${s.asked === s.target ? "" : `, here ${number(s.target)}`} ${s.unit ?? ""}`],
  ["rise, 10 to 90 %", (s) => (s.rise_ms === null ? "never" : `${number(s.rise_ms)} ms`)],
  ["overshoot", (s) => `${number(s.overshoot_percent, 1)} %`],
  ["settling, within 5 %", (s) => (s.settling_ms === null ? "never" : `${number(s.settling_ms)} ms`)],
  ["steady error", (s) => `${number(s.steady_error, 1)} ${s.unit ?? ""}`],
  ["limited by", (s) => words(s.why ?? "nothing")],
  ["gains", (s) => s.gains],
];

const HINT = "A higher Kp is faster and stiffer, until it overshoots; Kd damps that; Ki takes away the error that is left, and overshoots. What is entered is in force at once, and lost at a restart unless it is saved.";

const panel = document.getElementById("panel-tune");
const fields = new Map();
/** The last two steps of each motor, the newest first. */
const steps = new Map();
let motor = 1;
let picks;
let body;
let canvas;
let figures;
let stepButton;
let now;
let of;
let target;
let lasts;
let unit;
let unsaved;

/** Those of a motor: a bank's member has its number behind its name. Joints are an arm's. */
const isIts = ({ name }) => name.endsWith(` ${motor}`) && !name.startsWith("joint ");
const isGain = ({ name }) => / K[pid] \d$/.test(name);

function showSettings() {
  const its = (told("settings")?.settings ?? []).filter(isIts);
  const rank = (setting) => (isGain(setting) ? (setting.name.startsWith(of.value) ? 0 : 1) : 2);
  fill(body, fields, its.map((setting, i) => [rank(setting), i, setting]).sort((a, b) => a[0] - b[0] || a[1] - b[1]).map(([, , setting]) => setting));
}

function pick(wanted) {
  motor = wanted;
  for (const each of picks) each.setAttribute("aria-pressed", String(Number(each.dataset.pick) === motor));
  showSettings();
  showSteps();
  selftune.pick(motor);
}

function gains(name) {
  const its = (told("settings")?.settings ?? []).filter((setting) => isIts(setting) && isGain(setting) && setting.name.startsWith(name));
  return its.map((setting) => `${setting.name.split(" ")[1]} ${setting.value}`).join(", ") || "–";
}

async function step() {
  if (stepButton.classList.contains("busy")) return;
  const name = of.value;
  const to = entered(target);
  const ms = entered(lasts);
  if (to === null || ms === null) {
    note(`step: a target, and a time from 100 to ${LONGEST_MS} ms, are wanted`, "error");
    return;
  }
  const its = { motor, ms, [name]: to };
  const with_ = gains(name);
  stepButton.classList.add("busy");
  put(stepButton, "Stepping");
  const answer = await attempt("step", its, `motor ${motor}, step`);
  stepButton.classList.remove("busy");
  put(stepButton, "Step");
  if (!answer) return;
  steps.set(its.motor, [{ unit: UNITS[name], ...answer, gains: with_, asked: to }, ...(steps.get(its.motor) ?? [])].slice(0, 2));
  showSteps();
}

function showSteps() {
  const [last, before] = steps.get(motor) ?? [];
  panel.classList.toggle("has-step", Boolean(last));
  if (!panel.hidden) draw(canvas, last, before);
  figures.replaceChildren(...FIGURES.map(([name, value]) => el("tr", {},
    el("th", { scope: "row", text: name }), el("td", { text: last ? value(last) : "–" }), el("td", { class: "before", text: before ? value(before) : "–" }))));
}

function showNow({ motors }) {
  const state = motors[motor - 1];
  if (panel.hidden || !state) return;
  put(now, `${state.mode}, ${number(state.position)} counts, ${number(state.velocity)} counts/s, ${number(state.duty, 1)} %, ${number(state.current, 2)} A${state.reason ? `; ${state.reason}` : ""}`);
}

export function start() {
  picks = [1, 2, 3, 4, 5, 6].map((n) => button(`Motor ${n}`, () => pick(n), { "data-pick": n }));
  now = el("p", { class: "now" });
  unsaved = el("span", { class: "dim" });
  body = el("tbody");
  of = el("select", { id: "step-of" }, el("option", { value: "velocity", text: "velocity" }), el("option", { value: "position", text: "position" }));
  target = writer(el("input", { id: "step-target", type: "number", step: "any", value: 4000 }));
  lasts = writer(el("input", { id: "step-ms", type: "number", min: 100, max: LONGEST_MS, step: 1, value: 2000 }));
  stepButton = writer(el("button", { id: "step", type: "submit", text: "Step" }));
  canvas = el("canvas", { id: "step-curve", role: "img", "aria-label": "The step's curve, and the one before it" });
  figures = el("tbody");
  const targetField = labelled("to", target, UNITS.velocity);
  unit = targetField.lastElementChild;
  of.addEventListener("change", () => {
    put(unit, UNITS[of.value]);
    showSettings();
  });
  panel.append(
    el("div", { class: "picks", role: "group", "aria-label": "Which motor" }, ...picks, now, unsaved,
      writer(button("Save", () => save(), { id: "tune-save", "aria-label": "Save all settings" }))),
    selftune.make(),
    el("div", { class: "two" },
      el("div", { class: "card scrolls" }, el("p", { class: "dim", text: HINT }), el("table", { class: "settings" }, HEAD(), body)),
      el("div", { class: "card step" },
        el("form", { class: "line", onsubmit: (event) => {
          event.preventDefault();
          step();
        } }, labelled("Step", of), targetField, labelled("for", lasts, "ms"), stepButton),
        el("div", { class: "curve" }, canvas, el("p", { class: "empty", text: "Arm, and press Step: the motor jumps to the target, and stops after that time. The curve and its figures stand here, with those of the step before." })),
        el("table", { id: "step-figures" }, el("thead", {}, el("tr", {}, el("td"), el("th", { scope: "col", text: "this step" }), el("th", { scope: "col", text: "the one before (faint)" }))), figures))));
  new ResizeObserver(() => showSteps()).observe(canvas);
  onColors(showSteps);
  on("settings", (told) => {
    showSettings();
    put(unsaved, told.unsaved ? "● Not saved" : "All is saved");
  });
  on("state", showNow);
  pick(1);
}
