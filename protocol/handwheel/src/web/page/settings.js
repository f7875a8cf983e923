// All settings, by group, with a filter; below them what is done with all of them at once.

import { on } from "/link.js";
import { button, el, labelled, put } from "/ui.js";
import { attempt } from "/strip.js";
import { fill, HEAD } from "/field.js";
import * as files from "/files.js";

const panel = document.getElementById("panel-settings");
const groups = new Map();
let list;
let filter;
let onlyChanged;
let unsaved;
let count;

function hear({ settings, unsaved: isUnsaved }) {
  const byGroup = new Map();
  for (const setting of settings) {
    const name = setting.group ?? "";
    if (!byGroup.has(name)) byGroup.set(name, []);
    byGroup.get(name).push(setting);
  }
  if ([...byGroup.keys()].join("\n") !== [...groups.keys()].join("\n")) {
    groups.clear();
    for (const name of byGroup.keys()) groups.set(name, makeGroup(name));
    list.replaceChildren(...[...groups.values()].map(({ section }) => section));
  }
  for (const [name, its] of byGroup) fill(groups.get(name).body, groups.get(name).fields, its);
  put(unsaved, isUnsaved ? "● Not saved: lost when the board restarts" : "All is saved");
  unsaved.classList.toggle("is-unsaved", Boolean(isUnsaved));
  sift();
}

function makeGroup(name) {
  const body = el("tbody");
  const section = el("section", { "data-group": name }, el("h3", { text: name || "settings" }), el("table", { class: "settings" }, HEAD(), body));
  return { section, body, fields: new Map() };
}

/** Shows what has every word of the filter in its name or its group's. */
function sift() {
  const sought = filter.value.toLowerCase().split(/\s+/).filter(Boolean);
  const isChanged = onlyChanged.getAttribute("aria-pressed") === "true";
  let shown = 0;
  let all = 0;
  for (const [group, { section, fields }] of groups) {
    let any = false;
    for (const { name, row } of fields.values()) {
      const text = `${group} ${name}`.toLowerCase();
      const fits = sought.every((word) => text.includes(word)) && (!isChanged || row.classList.contains("changed"));
      row.hidden = !fits;
      any ||= fits;
      all += 1;
      shown += fits ? 1 : 0;
    }
    section.hidden = !any;
  }
  put(count, shown === all ? `${all} settings` : `${shown} of ${all} settings`);
}

export function start() {
  filter = el("input", { id: "filter", type: "search", autocomplete: "off", spellcheck: "false" });
  filter.addEventListener("input", sift);
  onlyChanged = button("Changed only", () => {
    onlyChanged.setAttribute("aria-pressed", String(onlyChanged.getAttribute("aria-pressed") !== "true"));
    sift();
  }, { id: "only-changed", "aria-pressed": "false" });
  count = el("span", { class: "dim" });
  unsaved = el("span", { id: "unsaved", role: "status" });
  list = el("div", { class: "groups" }, el("p", { class: "empty", text: "This board has told no settings." }));
  panel.append(
    el("div", { class: "line" }, labelled("Filter", filter), onlyChanged, count,
      button("Read anew", () => attempt("settings"), { id: "read-settings" }), unsaved),
    el("div", { class: "beside" }, el("div", { class: "card scrolls" }, list), files.make()));
  on("settings", hear);
}
