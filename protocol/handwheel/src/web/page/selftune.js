// Checking a motor's wiring, and tuning it by itself: what it will do is said before, and asked for once more; then
// what it is about; at its end what was found, its curves, and buttons that put it in force and back.

import { ask, on, told } from "/link.js";
import { button, el, entered, labelled, number, put, writer } from "/ui.js";
import { attempt, note } from "/strip.js";
import { save } from "/files.js";
import { draw } from "/curve.js";
import { onColors } from "/chart.js";

const ms = (value) => (value === null ? "never" : `${number(value)} ms`);
/** What both the prediction and the measurement have. */
const RESPONSE = [
  ["rise, 10 to 90 %", (of) => ms(of.rise_ms)],
  ["overshoot", (of) => `${number(of.overshoot_percent, 1)} %`],
  ["settling, within 5 %", (of) => ms(of.settling_ms)],
];
const MOTOR = [
  ["speed at full drive", ({ fit }) => `${number(fit.gain)} counts/s`],
  ["time constant, dead time", ({ fit }) => `${number(fit.time_constant_ms)} ms, ${number(fit.dead_time_ms, 1)} ms`],
  ["duty that moves nothing", ({ fit }) => `${number(fit.dead_band[0], 1)} % rising, ${number(fit.dead_band[1], 1)} % falling`],
  ["explains of the motion", ({ fit }) => `${number(fit.percent, 1)} %`],
];

/** The last result of each motor: of a check, of a tuning. */
const checks = new Map();
const tunings = new Map();
let motor = 1;
/** What begins when it is said yes to. */
let begin = null;
let duty;
let mayTurn;
let question;
let asked;
let yes;
let doing;
let checked;
let result;
let canvas;
let found;
let response;
let settings;
let inForce;

/** How a motor moves when it is tuned, in words. */
function moves({ moves: how, seconds, counts }) {
  return how === "turns"
    ? `turns freely both ways, for ${number(seconds)} s in all at the most, and steps to half of its speed at the end`
    : `moves to and fro about where it stands, within ${number(counts)} counts either way`;
}

async function propose(what) {
  const percent = entered(duty);
  if (percent === null) {
    note("highest duty: 1 to 100 percent are wanted", "error");
    return;
  }
  const its = motor;
  const most = `with no more than ${number(percent, Number.isInteger(percent) ? 0 : 1)} % duty`;
  let text = `Motor ${its} turns a moment each way, ${most}.`;
  const values = { motor: its, duty: percent };
  if (what === "check") values.set_polarity = mayTurn.checked;
  else {
    const plan = await attempt("plan", { motor: its }, `motor ${its}, tune`);
    if (!plan || its !== motor) return;
    text = `Motor ${its} ${moves(plan)}, ${most}.`;
  }
  begin = () => run(what, values);
  put(asked, `${text} Is it free to move, and nobody in its way? The space bar stops it.`);
  question.hidden = false;
  yes.focus();
}

function settle() {
  begin = null;
  question.hidden = true;
}

async function run(what, values) {
  try {
    const answer = await ask(what, values);
    (what === "check" ? checks : tunings).set(values.motor, answer);
    if (what === "tune") checks.set(values.motor, { motor: values.motor, ...answer.checked });
    note(`Motor ${values.motor}: ${what === "check" ? "its wiring is as it should be" : "tuned; nothing is changed until it is applied"}`, "good");
  } catch (error) {
    // What was found before is not what it is now.
    checks.set(values.motor, { error: error.message });
    if (what === "tune") tunings.delete(values.motor);
    note(`motor ${values.motor}, ${what}: ${error.message}`, "error");
  }
  show();
}

function showJob({ motor: its, what, doing: about }) {
  put(doing, its ? `Motor ${its}, ${what}: ${about}` : "");
}

function wiring(check) {
  if (!check) return "";
  if (check.error) return check.error;
  const ways = check.ways.map(({ moved, duty: at }, i) => `${i ? "falling" : "rising"}: ${number(moved)} counts at ${number(at)} % duty`);
  return [
    `Wiring as it should be (${ways.join("; ")})`,
    check.has_current ? "a current is seen" : "no current is seen: its sensor is missing, or setting “current sensor” should be 0",
    ...(check.turned_round ? ["its polarity was turned round: Save keeps that"] : []),
  ].join("; ");
}

const row = (name, ...cells) => el("tr", {}, el("th", { scope: "row", text: name }), ...cells.map((text) => el("td", { text })));

function show() {
  const check = checks.get(motor);
  const tuned = tunings.get(motor);
  put(checked, wiring(check));
  checked.classList.toggle("bad", Boolean(check?.error));
  result.hidden = !tuned;
  if (!tuned) return;
  found.replaceChildren(...MOTOR.map(([name, value]) => row(name, value(tuned))));
  response.replaceChildren(...RESPONSE.map(([name, value]) => row(name, value(tuned.measured), value(tuned.predicted))));
  settings.replaceChildren(...tuned.settings.map(({ name, before, value }) => row(name, number(before), number(value))));
  showInForce();
  showCurve();
}

/** A value every so often, as the chart takes samples. */
function curve(of) {
  const tuned = tunings.get(motor);
  return { unit: tuned.unit, target: tuned.target, samples: tuned.curves[of].map((value, i) => [i * tuned.interval_ms, value]) };
}

function showCurve() {
  if (!result.hidden && canvas.clientWidth) draw(canvas, curve("measured"), { ...curve("predicted"), color: "--duty" });
}

function showInForce() {
  const tuned = tunings.get(motor);
  if (!tuned) return;
  const now = new Map((told("settings")?.settings ?? []).map(({ name, value }) => [name, value]));
  const are = (which) => tuned.settings.every((setting) => now.get(setting.name) === setting[which]);
  put(inForce, are("value") ? "What was found is in force" : are("before") ? "What was before is in force" : "Other values are in force");
}

async function set(which, words) {
  const { settings: list, motor: its } = tunings.get(motor);
  const values = Object.fromEntries(list.map((setting) => [setting.name, setting[which]]));
  if ((await attempt("set", { values }, `motor ${its}, settings`)) !== undefined) note(`Motor ${its}: ${words}`, "good");
}

/** Another motor is looked at. */
export function pick(wanted) {
  motor = wanted;
  settle();
  show();
}

const head = (...texts) => el("thead", {}, el("tr", {}, ...texts.map((text) => el("th", { scope: "col", text }))));

/** The card. */
export function make() {
  duty = writer(el("input", { id: "highest-duty", type: "number", min: 1, max: 100, step: "any", value: 50 }));
  mayTurn = writer(el("input", { id: "set-polarity", type: "checkbox" }));
  doing = el("span", { id: "job", role: "status" });
  asked = el("span");
  yes = writer(button("Yes, begin", () => {
    const act = begin;
    settle();
    act?.();
  }, { id: "self-yes" }));
  question = el("p", { id: "self-question", class: "line asking", role: "alert", hidden: true }, asked, yes, button("No", settle, { id: "self-no" }));
  checked = el("p", { id: "wiring" });
  canvas = el("canvas", { id: "tuned-curve", role: "img", "aria-label": "The confirming step: measured, and predicted (dashed)" });
  [found, response, settings] = [el("tbody"), el("tbody"), el("tbody")];
  inForce = el("span", { id: "in-force", role: "status" });
  result = el("div", { id: "tuned", hidden: true },
    el("div", { class: "curve" }, canvas),
    el("div", {},
      el("table", {}, head("The motor", ""), found),
      el("table", { id: "tuned-response" }, head("The step that confirmed it", "measured", "predicted (dashed)"), response)),
    el("div", {},
      el("table", { id: "tuned-settings" }, head("Setting", "before", "found"), settings),
      el("p", { class: "line" },
        writer(button("Apply", () => set("value", "what was found is in force, and lost at a restart unless it is saved"), { id: "self-apply" })),
        writer(button("Roll back", () => set("before", "what was before is in force"), { id: "self-back" })),
        writer(button("Save", () => save(), { id: "self-save", "aria-label": "Save all settings, with what was found" })),
        inForce)));
  new ResizeObserver(showCurve).observe(canvas);
  onColors(showCurve);
  on("job", showJob);
  on("settings", showInForce);
  on("armed", ({ you }) => you || settle());
  return el("div", { class: "card", id: "self" },
    el("div", { class: "line" },
      writer(button("Check wiring", () => propose("check"), { id: "self-check" })),
      el("label", { class: "field" }, mayTurn, el("span", { text: "and turn its polarity round if that is wrong" })),
      writer(button("Tune by itself", () => propose("tune"), { id: "self-tune" })),
      labelled("with at most", duty, "% duty"), doing),
    question, checked, result);
}
