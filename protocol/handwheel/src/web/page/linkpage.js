// The link and the board's health in figures.

import { on, told } from "/link.js";
import { el, duration, facts, number, pairs, words } from "/ui.js";

const panel = document.getElementById("panel-link");

/** The board's health, for a list of facts. What it does not tell is left out. */
export const healthRows = (it) => [
  ["up for", it.uptime_ms, (ms) => duration(ms)], ["latency, worst", it.latency_us, (us) => `${words(us)} µs`], ["stack used", it.stack, (bytes) => (bytes ? `${number(bytes)} bytes` : "unknown")],
  ["control periods missed", it.missed, words], ["faults", it.faults, words],
  ["frames on this link", it.frames, (n) => `${number(n)} a second`], ["bytes on this link", it.bytes, (n) => `${number(n)} a second`],
].filter(([, value]) => value !== undefined && value !== null).map(([name, value, show]) => [name, show(value)]);

export function start() {
  const board = el("dl", { class: "facts", id: "board-facts" });
  const health = el("dl", { class: "facts", id: "health" });
  const counters = el("dl", { class: "facts", id: "counters" });
  const refusals = el("dl", { class: "facts", id: "refusals" });
  const none = el("p", { class: "dim", text: "The board has told no figures." });
  panel.append(
    el("section", { class: "card" }, el("h2", { text: "Board" }), board),
    el("section", { class: "card" }, el("h2", { text: "Health" }), health, none),
    el("section", { class: "card" }, el("h2", { text: "Counters of its link" }), counters),
    el("section", { class: "card" }, el("h2", { text: "What it has refused" }), refusals));

  const showBoard = () => {
    const it = told("board");
    if (!it) return;
    facts(board, [
      ["title", words(it.title)], ["kind", words(it.kind)], ["link", words(it.link)],
      ["connected", it.connected ? "yes" : `no: ${words(it.why)}`],
      ["firmware", it.firmware ?? "older than ours: it tells none"],
      ["extension", words(it.extension)], ["started", words(it.start)], ["its settings", words(it.origin)],
      ["motor state", words(it.has_state)], ["virtual", words(it.is_virtual)],
      ["this page", words(told("page")?.name)],
    ]);
  };
  on("board", showBoard);
  on("page", showBoard);
  on("health", (it) => {
    none.hidden = true;
    facts(health, healthRows(it));
    for (const [list, of, empty] of [[counters, it.counters, "nothing counted"], [refusals, it.refusals, "nothing refused"]]) {
      const rows = pairs(of).map(([name, value]) => [String(name).replaceAll("_", " "), words(value)]);
      facts(list, rows.length ? rows : [[empty, ""]]);
      for (const row of list.children) row.classList.toggle("is-zero", row.lastChild.textContent === "0");
    }
  });
}
