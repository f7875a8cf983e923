// What the board measures: sonars, infrared, batteries, inputs, and the rest by name.

import { on } from "/link.js";
import { el, facts, number, put, words } from "/ui.js";

const NOTHING_CM = 255;
/** Those that are only told by name; what they count. */
const OTHERS = [
  ["temperature", "temperature", ""], ["human", "human", ""], ["tilt", "tilt", ""], ["overheat", "overheat", ""], ["custom", "custom A/D", ""],
  ["reference", "reference", "A/D"], ["potentiometers", "potentiometers", "A/D"], ["remote", "infrared remote", ""],
];
const BATTERIES = ["board", "motors", "servos"];

const panel = document.getElementById("panel-io");
let sonars;
let infrared;
let batteries;
let inputs;
let others;

function bar(name, most, attributes) {
  const meter = el("meter", { min: 0, max: most, "aria-label": name });
  const value = el("b");
  return { meter, value, row: el("div", { class: "bar", ...attributes }, el("span", { text: name }), meter, value) };
}

function show({ meter, value }, of, text) {
  meter.value = of;
  put(value, text);
}

function hear(told) {
  if (panel.hidden) return;
  (told.sonar_cm ?? []).forEach((cm, i) => sonars[i] && show(sonars[i], cm ?? 0, cm === NOTHING_CM ? "nothing" : `${number(cm)} cm`));
  sonars.forEach(({ row }, i) => row.classList.toggle("nothing", told.sonar_cm?.[i] === NOTHING_CM));
  show(infrared, told.ir_cm ?? 0, `${number(told.ir_cm, 1)} cm`);
  const bits = Number(told.inputs) || 0;
  inputs.forEach((light, i) => {
    const isHigh = Boolean(bits & (1 << i));
    light.classList.toggle("on", isHigh);
    put(light.lastElementChild, isHigh ? "1" : "0");
  });
  facts(others, OTHERS.filter(([name]) => told[name] !== undefined).map(([name, text, unit]) => [text, `${words(told[name])} ${told[name] === null ? "" : unit}`]));
  OTHERS.filter(([name]) => told[name] !== undefined).forEach(([name], i) => {
    others.children[i].dataset.sensor = name;
  });
}

export function start() {
  sonars = [1, 2, 3, 4, 5, 6].map((n) => bar(`Sonar ${n}`, NOTHING_CM, { "data-sonar": n }));
  infrared = bar("Infrared", 80, { "data-sensor": "ir_cm" });
  batteries = BATTERIES.map((name, i) => bar(`Battery, ${name}`, [9, 24, 9][i], { "data-volts": name }));
  inputs = Array.from({ length: 8 }, (_, i) => el("span", { class: "light", "data-input": i }, el("span", { text: `IN${i}` }), el("b", { text: "–" })));
  others = el("dl", { class: "facts" });
  panel.append(
    el("section", { class: "card" }, el("h2", { text: "Ranges" }), ...sonars.map(({ row }) => row), infrared.row),
    el("section", { class: "card" }, el("h2", { text: "Batteries" }), ...batteries.map(({ row }) => row),
      el("h2", { text: "Inputs" }), el("div", { class: "lights" }, ...inputs),
      el("h2", { text: "Other sensors" }), others));
  on("sensors", hear);
  on("state", ({ battery_v: volts }) => {
    if (!panel.hidden) (volts ?? []).forEach((v, i) => show(batteries[i], v ?? 0, `${number(v, 2)} V`));
  });
}
