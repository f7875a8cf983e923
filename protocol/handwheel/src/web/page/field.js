// One setting: its value to edit, with its unit, range and default. Enter, or leaving the input, sets it at
// once; Escape takes back what was typed; a value that is refused goes back to what is in force.

import { el, entered, number, put, writer } from "/ui.js";
import { attempt, note } from "/strip.js";

/** A row of a table. */
export class Field {
  constructor(setting) {
    this.name = setting.name;
    this.setting = setting;
    this.input = writer(el("input", {
      type: "number", step: 1, min: setting.low, max: setting.high, "aria-label": `${setting.name}${setting.unit ? `, ${setting.unit}` : ""}`,
    }));
    this.input.addEventListener("change", () => this.set());
    this.input.addEventListener("keydown", (event) => {
      if (event.key === "Escape") this.restore();
    });
    this.isDefault = el("button", {
      type: "button", class: "default", title: "sets the default", "aria-label": `${setting.name}: set the default, ${setting.default}`,
      onclick: () => this.send(this.setting.default), text: number(setting.default),
    });
    writer(this.isDefault);
    this.mark = el("td", { class: "mark" });
    this.row = el("tr", { "data-setting": setting.name },
      el("th", { scope: "row", text: setting.name }), el("td", {}, this.input), el("td", { class: "unit", text: setting.unit ?? "" }),
      el("td", { class: "range", text: `${number(setting.low)} to ${number(setting.high)}` }), el("td", {}, this.isDefault), this.mark);
    this.update(setting);
  }

  /** What is in force. What is being typed stays. */
  update(setting) {
    const isTyping = document.activeElement === this.input && this.input.value !== String(this.setting.value);
    this.setting = setting;
    if (!isTyping) this.restore();
    const isChanged = setting.value !== setting.default;
    this.row.classList.toggle("changed", isChanged);
    put(this.mark, isChanged ? "● changed" : "");
  }

  restore() {
    if (this.input.value !== String(this.setting.value)) this.input.value = this.setting.value;
  }

  set() {
    const value = entered(this.input);
    const { name, low, high } = this.setting;
    if (value === null || !Number.isInteger(value)) {
      note(`${name}: a whole number from ${number(low)} to ${number(high)} is wanted`, "error");
      this.restore();
    } else if (value !== this.setting.value) this.send(value);
  }

  async send(value) {
    const isSet = (await attempt("set", { values: { [this.name]: value } }, `set ${this.name}`)) !== undefined;
    if (!isSet) this.restore();
    this.row.classList.toggle("just-set", isSet);
    setTimeout(() => this.row.classList.remove("just-set"), 600);
  }
}

export const HEAD = () => el("thead", {}, el("tr", {},
  ...["Setting", "Value", "Unit", "Range", "Default", ""].map((text) => el("th", { scope: "col", text }))));

/** Rows for these settings in a table's body; those that are there are kept. */
export function fill(body, fields, settings) {
  const names = settings.map(({ name }) => name);
  if (names.join("\n") !== [...fields.keys()].join("\n")) {
    fields.clear();
    for (const setting of settings) fields.set(setting.name, new Field(setting));
    body.replaceChildren(...[...fields.values()].map(({ row }) => row));
  } else for (const setting of settings) fields.get(setting.name).update(setting);
}
