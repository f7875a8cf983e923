// The link and the board's health in figures.

import { on, told } from "/link.js";
import { el, duration, facts, number, pairs, put, words } from "/ui.js";

const panel = document.getElementById("panel-link");

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
    facts(health, [
      ["up for", duration(it.uptime_ms ?? 0)], ["latency, worst", `${words(it.latency_us)} µs`], ["stack", words(it.stack)],
      ["control periods missed", words(it.missed)], ["faults", words(it.faults)],
      ["frames on this link", `${number(it.frames)} a second`], ["bytes on this link", `${number(it.bytes)} a second`],
    ]);
    for (const [list, of, empty] of [[counters, it.counters, "nothing counted"], [refusals, it.refusals, "nothing refused"]]) {
      const rows = pairs(of).map(([name, value]) => [String(name).replaceAll("_", " "), words(value)]);
      facts(list, rows.length ? rows : [[empty, ""]]);
      for (const row of list.children) row.classList.toggle("is-zero", row.lastChild.textContent === "0");
    }
    put(none, "");
  });
}
