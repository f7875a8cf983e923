// A virtual board's world: a wall, what jams or is unplugged, the link, the batteries, the seed, and whatever
// else can be set, as JSON. It writes nothing to the board, and needs no arming.

import { on, told } from "/link.js";
import { button, el, entered, labelled, put } from "/ui.js";
import { scene } from "/scene.js";
import { attempt, note } from "/strip.js";

/** Those with controls of their own. */
const OWN = ["wall_cm", "jam", "unplugged", "link", "battery_v", "seed"];
/** A sonar that sees nothing. */
const NOTHING_CM = 255;
const MOTORS = [1, 2, 3, 4, 5, 6];

const panel = document.getElementById("panel-world");
const cards = new Map();
const raw = new Map();
let rawList;
let view;
let truth;
let wall;
let wallNow;
let seen;
let cut;
let seed;
let seedNow;
let banks;
let batteries;

const set = (key, value) => attempt("world", { set: { [key]: value } }, `world, ${key}`);
const overridden = () => told("world")?.state?.overridden ?? {};
const members = (key, count) => Array.from({ length: count }, (_, i) => overridden()[key]?.[i] ?? null);

/** One of six, the others as they are. */
function flip(key, i) {
  const all = members(key, MOTORS.length);
  all[i] = all[i] ? null : true;
  set(key, all);
}

function bank(key, selector, text) {
  const buttons = MOTORS.map((n, i) => button(`Motor ${n}`, () => flip(key, i), { [selector]: n, "aria-pressed": "false", "aria-label": `${text} motor ${n}` }));
  return { key, buttons };
}

class Raw {
  constructor(key) {
    this.input = el("input", { type: "text", spellcheck: "false", autocomplete: "off", placeholder: "as simulated", "aria-label": `${key}, JSON` });
    this.key = key;
    this.row = el("form", { "data-world": key, class: "raw", onsubmit: (event) => {
      event.preventDefault();
      this.set();
    } }, el("span", { text: key }), this.input, el("button", { type: "submit", text: "Set", "aria-label": `Set ${key}` }),
    button("Give back", () => set(key, null), { "aria-label": `Give ${key} back to the simulation` }));
  }

  set() {
    try {
      set(this.key, this.input.value.trim() ? JSON.parse(this.input.value) : null);
    } catch {
      note(`world, ${this.key}: not JSON; as [20, null, null, null, null, null]`, "error");
    }
  }

  show(value) {
    this.row.classList.toggle("changed", value !== undefined && value !== null);
    if (document.activeElement !== this.input) this.input.value = value === undefined || value === null ? "" : JSON.stringify(value);
  }
}

function hear({ state }) {
  if (panel.hidden || !state) return;
  const settable = state.settable ?? [];
  const is = overridden();
  for (const [key, card] of cards) card.hidden = !settable.includes(key) && key !== "link";
  view.drawing.parentElement.hidden = !state.motors;
  if (state.motors) view.show(state);
  const isThere = typeof state.wall_cm === "number";
  put(wallNow, isThere ? `A wall is ${Math.round(state.wall_cm)} cm ahead` : "No wall");
  for (const { key, buttons } of banks) {
    members(key, MOTORS.length).forEach((value, i) => buttons[i].setAttribute("aria-pressed", String(Boolean(value))));
  }
  const isCut = is.link === false;
  cut.setAttribute("aria-pressed", String(isCut));
  put(cut, isCut ? "Mend the link" : "Cut the link");
  members("battery_v", 3).forEach((volts, i) => {
    if (document.activeElement !== batteries[i]) batteries[i].value = volts ?? "";
  });
  put(seedNow, is.seed === undefined || is.seed === null ? "" : `now ${is.seed}`);
  const others = settable.filter((key) => !OWN.includes(key));
  if (others.join() !== [...raw.keys()].join()) {
    raw.clear();
    for (const key of others) raw.set(key, new Raw(key));
    rawList.replaceChildren(...[...raw.values()].map(({ row }) => row));
  }
  for (const [key, it] of raw) it.show(is[key]);
  if (truth.parentElement.open) {
    const { lcd, ...rest } = state; // a picture says that better
    put(truth, JSON.stringify(rest, null, 1));
  }
}

function card(key, title, ...children) {
  const it = el("section", { class: "card", "data-key": key }, el("h2", { text: title }), ...children);
  cards.set(key, it);
  return it;
}

function makeWall() {
  wall = el("input", { id: "wall", type: "number", min: 0, max: 1000, step: 1, value: 100 });
  wallNow = el("p", { class: "now" });
  seen = el("p", { class: "dim" });
  return card("wall_cm", "Wall", el("p", { class: "dim", text: "The wheels drive towards it, and the sonars see it." }), wallNow, seen,
    el("form", { class: "line", onsubmit: (event) => {
      event.preventDefault();
      const cm = entered(wall);
      if (cm === null) note("world, wall: a distance from 0 to 1000 cm is wanted", "error");
      else set("wall_cm", cm);
    } }, labelled("Distance", wall, "cm"), el("button", { id: "wall-set", type: "submit", text: "Put it there" }),
    button("No wall", () => set("wall_cm", null), { id: "wall-off" })));
}

function makeBatteries() {
  batteries = ["board", "motors", "servos"].map((name, i) => el("input", { type: "number", min: 0, max: 30, step: 0.1, placeholder: "as is", "data-battery": i, "aria-label": `Battery of the ${name}, V` }));
  const change = () => set("battery_v", batteries.map((input) => entered(input)));
  for (const input of batteries) input.addEventListener("change", change);
  return card("battery_v", "Batteries", ...["board", "motors", "servos"].map((name, i) => labelled(name, batteries[i], "V")),
    el("p", { class: "line" }, button("As simulated", () => {
      for (const input of batteries) input.value = "";
      set("battery_v", null);
    })));
}

export function start() {
  banks = [bank("jam", "data-jam", "Jam"), bank("unplugged", "data-unplug", "Unplug the position sensor of")];
  cut = button("Cut the link", () => set("link", cut.getAttribute("aria-pressed") === "true"), { id: "cut", "aria-pressed": "false" });
  seed = el("input", { id: "seed", type: "number", min: 0, step: 1, value: 1 });
  seedNow = el("span", { class: "dim" });
  rawList = el("div");
  truth = el("pre", { tabindex: 0, "aria-label": "The simulated truth" });
  view = scene();
  panel.append(el("section", { class: "card wide" }, view.drawing), makeWall(),
    card("jam", "Jammed shafts", el("div", { class: "lights" }, ...banks[0].buttons)),
    card("unplugged", "Unplugged position sensors", el("div", { class: "lights" }, ...banks[1].buttons)),
    card("link", "Link between host and board", el("p", { class: "line" }, cut)),
    makeBatteries(),
    card("seed", "Seed of the noise", el("form", { class: "line", onsubmit: (event) => {
      event.preventDefault();
      const value = entered(seed);
      if (value === null) note("world, seed: a whole number is wanted", "error");
      else set("seed", value);
    } }, labelled("Seed", seed), el("button", { id: "seed-set", type: "submit", text: "Set" }), seedNow)),
    el("section", { class: "card wide" }, el("h2", { text: "Everything else that can be set" }), rawList),
    el("details", { class: "card wide" }, el("summary", { text: "The simulated truth, as JSON" }), truth));
  on("world", hear);
  on("sensors", ({ sonar_cm: sonars }) => {
    if (panel.hidden || !sonars) return;
    const seeing = sonars.map((cm, i) => [i + 1, cm]).filter(([, cm]) => cm !== NOTHING_CM);
    put(seen, seeing.length ? seeing.map(([n, cm]) => `sonar ${n} ${cm} cm`).join(", ") : "The sonars see nothing");
  });
}
