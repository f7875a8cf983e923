// The page's beginning: its tabs, the bar, and the parts.
//
//  link.js      asks, and is told     ui.js       small tools        strip.js   faults, reasons, notes
//  guard.js     arming and stopping   samples.js  the last minute    chart.js   a strip chart
//  motors.js    six cards             tune.js     gains and steps    curve.js   a step's curve
//  settings.js  all settings          field.js    one setting        files.js   save, backup, restore, diff
//  sensors.js   what is measured      outputs.js  servos, GPIO       lcd.js     the LCD's picture
//  linkpage.js  link and health       world.js    a virtual board's  others.js  an arm, a CM-5
//  scene.js     that world, drawn     selftune.js  checking, tuning   socket.js   the way to the server

import { connect, on, told } from "/link.js";
import { el, number, put } from "/ui.js";
import * as guard from "/guard.js";
import * as strip from "/strip.js";
import * as motors from "/motors.js";
import * as tune from "/tune.js";
import * as settings from "/settings.js";
import * as sensors from "/sensors.js";
import * as outputs from "/outputs.js";
import * as lcd from "/lcd.js";
import * as linkpage from "/linkpage.js";
import * as world from "/world.js";
import * as others from "/others.js";

/** Name, title, and for which boards. */
const TABS = [
  ["motors", "Motors", (board) => board.kind === "pms5005"],
  ["tune", "Tune", (board) => board.kind === "pms5005"],
  ["joints", "Joints", (board) => board.kind === "pioneer-arm"],
  ["servos", "Servos", (board) => board.kind === "cm5"],
  ["settings", "Settings", (board) => board.kind !== "cm5"],
  ["io", "Sensors and outputs", (board) => board.kind === "pms5005"],
  ["link", "Link and health", () => true],
  ["world", "World", (board) => board.is_virtual],
];

const bar = document.getElementById("tabs");
const tabs = new Map();

function makeTabs() {
  for (const [name, text] of TABS) {
    const tab = el("button", {
      type: "button", role: "tab", id: `tab-${name}`, "data-tab": name, "aria-controls": `panel-${name}`, text, onclick: () => choose(name),
    });
    tabs.set(name, tab);
    bar.append(tab);
  }
  bar.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (!step) return;
    const there = [...tabs.values()].filter((tab) => !tab.hidden);
    const next = there[(there.indexOf(document.activeElement) + step + there.length) % there.length];
    next.focus();
    choose(next.dataset.tab);
  });
}

function choose(name) {
  for (const [other, tab] of tabs) {
    const isIt = other === name;
    tab.setAttribute("aria-selected", String(isIt));
    tab.tabIndex = isIt ? 0 : -1;
    document.getElementById(`panel-${other}`).hidden = !isIt;
  }
  document.getElementById("chart-tools").hidden = name !== "motors";
  if (told("board") && location.hash !== `#/${name}`) history.replaceState(null, "", `#/${name}`);
}

function showBoard(board) {
  const fits = TABS.filter(([, , isFor]) => isFor(board)).map(([name]) => name);
  for (const [name, tab] of tabs) tab.hidden = !fits.includes(name);
  const wanted = location.hash.replace("#/", "");
  choose(fits.includes(wanted) ? wanted : fits[0]);
  const title = (board.title || board.kind || "handwheel") + (board.is_virtual ? ", simulated" : "");
  put(document.getElementById("title"), title);
  document.title = `${title} – handwheel`;
  showLink();
}

function showLink() {
  const board = told("board");
  const page = told("page");
  const isOpen = Boolean(told("socket")?.open);
  document.body.dataset.online = isOpen && board?.connected ? "yes" : "no";
  const link = board?.link ? `${board.link}` : "";
  let text = "No connection to handwheel: trying again";
  if (isOpen) text = board ? (board.connected ? `Connected: ${link}` : `Not connected: ${link}`) : "Connected to handwheel";
  if (isOpen && page) text += ` · ${page.name}`;
  put(document.getElementById("link"), text);
}

const NAMES = ["board", "motors", "servos"];

makeTabs();
for (const part of [strip, guard, motors, tune, settings, sensors, outputs, lcd, linkpage, world, others]) part.start();
choose("link");
on("board", showBoard);
on("socket", showLink);
on("page", showLink);
on("state", ({ battery_v: volts }) => {
  put(document.getElementById("batteries"), `Battery ${(volts ?? []).map((v, i) => `${NAMES[i]} ${number(v, 1)} V`).join(" · ")}`);
});
connect();
