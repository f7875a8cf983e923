// What is driven besides motors: six servos by their pulse, eight outputs.

import { on } from "/link.js";
import { button, el, entered, labelled, number, put, writer } from "/ui.js";
import { attempt, note } from "/strip.js";

/** What most hobby servos bear; the board has the last word. */
const PULSE_US = [500, 2500];
/** A slider that is drawn sends no more often. */
const SEND_MS = 50;

const panel = document.getElementById("panel-io");
let servos;
let outputs;
let ramp;
/** What pages here have set; null until one has. */
let gpio = null;

class Servo {
  constructor(n) {
    this.n = n;
    const range = { min: PULSE_US[0], max: PULSE_US[1], value: 1500 };
    this.slider = writer(el("input", { type: "range", step: 10, ...range, "aria-label": `Servo ${n}, pulse in µs` }));
    this.input = writer(el("input", { type: "number", step: 1, ...range, "aria-label": `Servo ${n}, pulse in µs` }));
    this.pulse = el("b", { text: "no pulse" });
    this.sentAt = 0;
    this.timer = 0;
    // After a stop a slider that is still held sends nothing more: it must be taken anew.
    this.isHalted = false;
    on("stopping", () => {
      this.isHalted = true;
      clearTimeout(this.timer);
    });
    for (const type of ["pointerdown", "keydown"]) {
      this.slider.addEventListener(type, () => {
        this.isHalted = false;
      });
    }
    this.slider.addEventListener("input", () => {
      if (this.isHalted) {
        this.slider.value = this.input.value;
        return;
      }
      this.input.value = this.slider.value;
      this.soon();
    });
    this.row = el("form", { class: "servo", "data-servo": n, novalidate: true, onsubmit: (event) => {
      event.preventDefault();
      this.send();
    } }, el("span", { text: `Servo ${n}` }), this.slider, this.input, el("span", { class: "unit", text: "µs" }),
    writer(el("button", { type: "submit", text: "Go", "aria-label": `Servo ${n}: go there` })), this.pulse);
  }

  /** While the slider is drawn: not more often, and the last place for sure. */
  soon() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.send(), Math.max(0, this.sentAt + SEND_MS - performance.now()));
  }

  send() {
    const us = entered(this.input);
    if (this.input.disabled) return; // disarmed meanwhile
    this.sentAt = performance.now();
    if (us === null) note(`Servo ${this.n}: a pulse from ${PULSE_US[0]} to ${PULSE_US[1]} µs is wanted`, "error");
    else {
      this.slider.value = us;
      attempt("servo", { servo: this.n, us, ms: entered(ramp) ?? 0 }, `servo ${this.n}`);
    }
  }

  hear(us) {
    put(this.pulse, us === null || us === undefined ? "no pulse" : `${number(us)} µs`);
    const isHeld = [this.slider, this.input].includes(document.activeElement);
    if (us && !isHeld) this.slider.value = this.input.value = Math.round(us);
  }
}

function toggle(bit) {
  attempt("gpio", { outputs: (gpio ?? 0) ^ (1 << bit) }, "outputs");
}

export function start() {
  servos = [1, 2, 3, 4, 5, 6].map((n) => new Servo(n));
  ramp = el("input", { id: "servo-ms", type: "number", min: 0, max: 60000, step: 1, value: 0 });
  outputs = Array.from({ length: 8 }, (_, bit) => writer(button("", () => toggle(bit), { "data-gpio": bit, "aria-pressed": "false" })));
  outputs.forEach((output, bit) => output.append(el("span", { text: `GPIO${bit}` }), el("b", { text: "–" })));
  const unknown = el("p", { class: "dim", text: "Not known until a page here has set them: the first press sets all eight, the others to 0." });
  panel.append(el("section", { class: "card" },
    el("h2", { text: "Servos" }), labelled("Time to get there", ramp, "ms"), ...servos.map(({ row }) => row),
    el("p", { class: "dim", text: "A pulse holds until Stop." }),
    el("h2", { text: "Outputs" }), el("div", { class: "lights" }, ...outputs), unknown));
  on("state", ({ servos_us: pulses }) => {
    if (!panel.hidden) servos.forEach((servo, i) => servo.hear(pulses?.[i]));
  });
  on("outputs", (told) => {
    gpio = told.gpio ?? null;
    unknown.hidden = gpio !== null;
    outputs.forEach((output, bit) => {
      const isHigh = Boolean((gpio ?? 0) & (1 << bit));
      output.setAttribute("aria-pressed", String(isHigh));
      put(output.lastElementChild, gpio === null ? "–" : isHigh ? "1" : "0");
    });
  });
}
