// The six motors: a card each, with a strip chart, the numbers, and what drives it.

import { on, told } from "/link.js";
import { button, el, entered, labelled, number, put, writer } from "/ui.js";
import { attempt, note } from "/strip.js";
import { QUANTITIES, Samples } from "/samples.js";
import { onColors, STYLES, StripChart } from "/chart.js";

const SPANS_S = [5, 10, 30, 60];
/** Shown, its unit, and digits behind the point. */
const NUMBERS = {
  set_point: ["set-point", "", 0],
  velocity: ["velocity", "counts/s", 0],
  position: ["position", "counts", 0],
  duty: ["duty", "%", 1],
  current: ["current", "A", 2],
};
const DRIVES = { velocity: ["Velocity", "counts/s"], position: ["Position", "counts"], duty: ["Duty", "%"] };
/** Frames are drawn no closer together; of long spans, half as often; and where drawing is slow, in no more than
 * a quarter of the time, so that a slow computer still says that it is alive. */
const FRAME_MS = 50;
const SHARE = 4;
const NUMBERS_MS = 100;

const panel = document.getElementById("panel-motors");
const cards = [];
let spanMs = 10_000;
let isPaused = false;
let isDirty = true;
let drawnAt = 0;
let numbersAt = 0;
/** What the last frame took, in ms. */
let cost = 0;
let ramp;
let pauseButton;
let back;

class Card {
  constructor(motor) {
    this.motor = motor;
    this.samples = new Samples();
    this.frozen = null;
    this.shown = new Set(["set_point", "velocity", "duty", "current"]);
    this.quantity = "velocity";
    this.mode = "";
    this.cursor = null;
    this.state = null;
    this.canvas = el("canvas", { role: "img", "aria-label": `Motor ${motor}: strip chart` });
    this.chart = new StripChart(this.canvas);
    this.modeText = el("span", { class: "mode" });
    this.reason = el("span", { class: "reason" });
    this.clear = writer(button("Clear", () => this.ask("clear"), { "data-do": "clear", title: "clears this motor's faults" }));
    this.legend = new Map(QUANTITIES.map((name) => [name, this.legendItem(name)]));
    this.element = el("article", { class: "card motor", "data-motor": motor, "aria-label": `Motor ${motor}` },
      el("div", { class: "head" }, el("h2", { text: `Motor ${motor}` }), this.modeText, this.reason, this.clear,
        writer(button("Zero", () => this.ask("zero"), { "data-do": "zero", title: "its encoder's count becomes 0; the motor must be off" })),
        button("⤢", () => this.enlarge(), { "data-do": "large", "aria-label": `Motor ${motor} large or small`, title: "large or small", "aria-pressed": "false" }),
        button("×", () => this.hide(true), { "data-do": "hide", "aria-label": `Hide motor ${motor}`, title: "hide" })),
      el("div", { class: "chart" }, this.canvas),
      el("div", { class: "legend", role: "group", "aria-label": "What the chart shows" },
        ...Object.keys(NUMBERS).map((name) => this.legend.get(name).item)),
      el("div", { class: "drives" }, ...Object.keys(DRIVES).map((name) => this.form(name)),
        writer(button("Off", () => this.ask("off"), { class: "off", "data-do": "off", "aria-label": `Motor ${motor} off` }))));
    this.canvas.addEventListener("pointermove", (event) => {
      this.cursor = event.offsetX;
      isDirty = true;
    });
    this.canvas.addEventListener("pointerleave", () => {
      this.cursor = null;
      isDirty = true;
    });
    this.canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      const at = SPANS_S.indexOf(spanMs / 1000) + Math.sign(event.deltaY);
      if (SPANS_S[at]) setSpan(SPANS_S[at]);
    }, { passive: false });
  }

  legendItem(name) {
    const [text, unit] = NUMBERS[name];
    const value = el("b", { "data-number": name });
    const figure = el("span", { class: "figure" }, value, " ", el("span", { class: "unit", text: unit }));
    const item = el("button", { type: "button", "data-show": name, onclick: () => this.toggle(name) },
      swatch(name), el("span", { text }), figure);
    return { item, value, unit: figure.lastElementChild };
  }

  form(name) {
    const [text, unit] = DRIVES[name];
    const range = name === "duty" ? { min: -100, max: 100 } : {};
    const input = writer(el("input", { type: "number", step: "any", value: 0, "data-value": name, ...range }));
    const drive = writer(el("button", { type: "submit", "data-do": name, text: "Drive", "aria-label": `Motor ${this.motor}: drive by ${name}` }));
    return el("form", { novalidate: true, onsubmit: (event) => {
      event.preventDefault();
      const value = entered(input);
      if (value === null) note(`Motor ${this.motor}: ${name} must be a number${name === "duty" ? " from −100 to 100" : ""}`, "error");
      else this.ask("drive", { [name]: value, ms: entered(ramp) ?? 0 });
    } }, labelled(text, input, unit), drive);
  }

  ask(what, values = {}) {
    return attempt(what, { motor: this.motor, ...values }, `motor ${this.motor}, ${what}`);
  }

  /** Position and velocity share the upper pane: the one that is not there takes it. */
  toggle(name) {
    const isOther = (name === "position" || name === "velocity") && name !== this.quantity;
    if (isOther) this.show(name);
    else if (!this.shown.delete(name)) this.shown.add(name);
    this.press();
  }

  show(quantity) {
    this.shown.delete(this.quantity);
    this.shown.add(quantity);
    this.quantity = quantity;
    this.chart.value.high = this.chart.value.low;
  }

  press() {
    for (const [name, { item }] of this.legend) item.setAttribute("aria-pressed", String(this.shown.has(name)));
    isDirty = true;
  }

  hear(ms, state) {
    this.samples.push(ms, state);
    this.state = state;
    if (state.mode === this.mode) return;
    this.mode = state.mode;
    if ((state.mode === "position" || state.mode === "velocity") && this.quantity !== state.mode) {
      this.show(state.mode);
      this.press();
    }
  }

  numbers() {
    const { state } = this;
    if (!state) return;
    for (const [name, { value }] of this.legend) put(value, name === "set_point" && state.mode === "off" ? "–" : number(state[name], NUMBERS[name][2]));
    put(this.legend.get("set_point").unit, { velocity: "counts/s", position: "counts", PWM: "%" }[state.mode] ?? "");
    put(this.modeText, state.mode === "off" ? "off" : `${state.mode}${state.ours ? "" : " (another host)"}`);
    this.modeText.classList.toggle("on", state.mode !== "off");
    put(this.reason, state.reason ?? "");
    this.reason.title = state.reason ?? "";
    this.clear.hidden = !(told("faults")?.faults ?? []).some((fault) => fault.motor === this.motor);
  }

  hide(isHidden) {
    this.element.hidden = isHidden;
    if (isHidden) this.enlarge(false);
    arrange();
    if (isHidden) back.querySelector(`[data-back="${this.motor}"]`).focus();
  }

  enlarge(isLarge = !this.element.classList.contains("large")) {
    for (const { element } of cards) {
      element.classList.toggle("large", isLarge && element === this.element);
      element.querySelector('[data-do="large"]').setAttribute("aria-pressed", String(isLarge && element === this.element));
    }
    arrange();
  }
}

function swatch(name) {
  const space = "http://www.w3.org/2000/svg";
  const svg = document.createElementNS(space, "svg");
  const line = document.createElementNS(space, "line");
  for (const [key, value] of Object.entries({ width: 14, height: 8, "aria-hidden": "true", class: `swatch ${name}` })) svg.setAttribute(key, value);
  for (const [key, value] of Object.entries({ x1: 0, y1: 4, x2: 14, y2: 4, "stroke-dasharray": STYLES[name].dash.join(" ") || "none" })) line.setAttribute(key, value);
  svg.append(line);
  return svg;
}

function arrange() {
  const large = cards.some(({ element }) => element.classList.contains("large"));
  const there = cards.filter(({ element }) => !element.hidden).length;
  panel.dataset.columns = large ? 1 : there <= 2 ? there : there === 4 ? 2 : 3;
  panel.dataset.rows = large || there <= 2 ? 1 : 2;
  panel.classList.toggle("one", large);
  back.replaceChildren(...cards.filter(({ element }) => element.hidden).map((card) => button(`Show motor ${card.motor}`, () => {
    card.hide(false);
    card.element.querySelector('[data-do="hide"]').focus();
  }, { "data-back": card.motor })));
  isDirty = true;
}

function setSpan(seconds) {
  spanMs = seconds * 1000;
  for (const each of document.querySelectorAll("[data-span]")) each.setAttribute("aria-pressed", String(Number(each.dataset.span) === seconds));
  isDirty = true;
}

function pause() {
  isPaused = !isPaused;
  for (const card of cards) card.frozen = isPaused ? card.samples.copy() : null;
  pauseButton.setAttribute("aria-pressed", String(isPaused));
  pauseButton.textContent = isPaused ? "Go on" : "Pause";
  panel.classList.toggle("paused", isPaused);
  isDirty = true;
}

function frame(now) {
  requestAnimationFrame(frame);
  if (panel.hidden) return;
  if (now - numbersAt > NUMBERS_MS) {
    numbersAt = now;
    for (const card of cards) card.numbers();
  }
  if (!isDirty || now - drawnAt < Math.max(spanMs > 10_000 ? 2 * FRAME_MS : FRAME_MS, SHARE * cost)) return;
  drawnAt = now;
  isDirty = false;
  const begun = performance.now();
  for (const card of cards) {
    if (card.canvas.clientWidth) card.chart.draw(card.frozen ?? card.samples, spanMs, card.quantity, card.shown, card.cursor);
  }
  cost = performance.now() - begun;
}

export function start() {
  pauseButton = button("Pause", pause, { id: "pause", "aria-pressed": "false" });
  ramp = el("input", { id: "ramp", type: "number", min: 0, max: 60000, step: 1, value: 0 });
  back = el("span", { id: "hidden-motors" });
  document.getElementById("chart-tools").append(back, labelled("Ramp", ramp, "ms"), pauseButton,
    ...SPANS_S.map((s) => button(`${s} s`, () => setSpan(s), { "data-span": s, "aria-label": `Charts show ${s} s` })));
  for (let motor = 1; motor <= 6; motor += 1) cards.push(new Card(motor));
  panel.append(...cards.map(({ element }) => element));
  for (const card of cards) card.press();
  arrange();
  setSpan(10);
  const again = () => {
    isDirty = true;
  };
  new ResizeObserver(again).observe(panel);
  onColors(again);
  on("state", ({ ms, motors }) => {
    motors.forEach((state, i) => cards[i]?.hear(ms, state));
    if (!isPaused) isDirty = true;
  });
  requestAnimationFrame(frame);
}
