// The other boards: an arm's six joints, a CM-5's servos. They are watched here; Stop works as everywhere.

import { on } from "/link.js";
import { el, facts, number, put, words } from "/ui.js";
import { healthRows } from "/linkpage.js";

const TICKS = 255;
const joints = document.getElementById("panel-joints");
const servos = document.getElementById("panel-servos");

/** Makes the rows that are missing, and drops those that are too many. */
function rows(body, count, make) {
  while (body.childElementCount > count) body.lastElementChild.remove();
  while (body.childElementCount < count) body.append(make(body.childElementCount));
}

const head = (...names) => el("thead", {}, el("tr", {}, ...names.map((text) => el("th", { scope: "col", text }))));

function startJoints() {
  const about = el("p", { class: "now", role: "status" });
  const body = el("tbody");
  joints.append(el("section", { class: "card" }, el("h2", { text: "Joints" }), about,
    el("table", { class: "figures" }, head("Joint", "Position", "0 to 255 ticks", ""), body)));
  on("joints", ({ powered, connected, joints: all }) => {
    put(about, `${connected ? "The arm is connected" : "No arm is connected"}; its power is ${powered ? "on" : "off"}`);
    rows(body, all.length, (i) => el("tr", { "data-joint": i + 1 },
      el("th", { scope: "row", text: `Joint ${i + 1}` }), el("td"), el("td", {}, el("meter", { min: 0, max: TICKS, "aria-label": `Joint ${i + 1}, ticks` })), el("td")));
    all.forEach(({ position, moving }, i) => {
      const [, value, bar, moves] = body.children[i].children;
      put(value, `${number(position)} ticks`);
      bar.firstChild.value = position ?? 0;
      put(moves, moving ? "moving" : "");
    });
  });
}

const REGISTERS = [["position", "Position", ""], ["speed", "Speed", ""], ["load", "Load", ""], ["voltage_v", "Voltage", "V"], ["temperature_c", "Temperature", "°C"]];

function startServos() {
  const body = el("tbody");
  const none = el("p", { class: "empty", text: "No servo has been found yet." });
  servos.append(el("section", { class: "card" }, el("h2", { text: "Servos" }), none,
    el("table", { class: "figures" }, head("ID", ...REGISTERS.map(([, name, unit]) => (unit ? `${name}, ${unit}` : name)), ""), body)));
  on("servos", ({ servos: all }) => {
    none.hidden = all.length > 0;
    rows(body, all.length, () => el("tr", {}, el("th", { scope: "row" }), ...REGISTERS.map(() => el("td")), el("td")));
    all.forEach((servo, i) => {
      const cells = body.children[i].children;
      const reports = servo.position !== undefined && servo.position !== null;
      body.children[i].dataset.id = servo.id;
      body.children[i].classList.toggle("stale", !reports);
      put(cells[0], servo.id);
      REGISTERS.forEach(([name], n) => put(cells[n + 1], reports ? (name === "voltage_v" ? number(servo[name], 1) : words(servo[name])) : "–"));
      put(cells[REGISTERS.length + 1], reports ? "" : "does not report");
    });
  });
}

export function start() {
  startJoints();
  startServos();
  for (const panel of [joints, servos]) {
    const health = el("dl", { class: "facts" });
    panel.append(el("section", { class: "card" }, el("h2", { text: "Health" }), health));
    on("health", (it) => facts(health, healthRows(it)));
  }
}
