// Small tools of the page's parts. What comes from a board is only ever set as text.
//
// A *writer* is a control that writes to the board: it is disabled while this page is not armed.

import { on, told } from "/link.js";

/** An element: its attributes (`text`, and `on...` handlers, are special) and its children. */
export function el(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === undefined || value === null || value === false) continue;
    if (name === "text") element.textContent = value;
    else if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
}

export const button = (text, onclick, attributes = {}) =>
  el("button", { type: "button", text, onclick, ...attributes });

/** Marks a control as one that writes. */
export function writer(element) {
  element.dataset.writes = "";
  element.disabled = !told("armed")?.you;
  return element;
}

on("armed", ({ you }) => {
  for (const element of document.querySelectorAll("[data-writes]")) element.disabled = !you;
});

/** Sets text only where it differs: most does not, fifty times a second. */
export function put(element, text) {
  text = String(text);
  if (element.textContent !== text) element.textContent = text;
}

/** `input` with its label and unit. */
export function labelled(text, input, unit) {
  return el("label", { class: "field" }, el("span", { text }), input, unit ? el("span", { class: "unit", text: unit }) : null);
}

/** A number for people: a true minus, no tail of digits. */
export function number(value, digits = 0) {
  if (value === null || value === undefined || !Number.isFinite(Number(value))) return "–";
  const text = Number(value).toFixed(digits);
  return (Number(text) === 0 ? text.replace("-", "") : text).replace("-", "−");
}

/** What an input holds, or null. */
export function entered(input) {
  const value = input.value.trim() === "" ? NaN : Number(input.value);
  return Number.isFinite(value) && input.checkValidity() ? value : null;
}

/** Whatever came, as words. */
export function words(value) {
  if (value === null || value === undefined) return "–";
  if (Array.isArray(value)) return value.map(words).join(", ");
  if (typeof value === "object") return Object.entries(value).map(([k, v]) => `${k} ${words(v)}`).join(", ");
  if (typeof value === "boolean") return value ? "yes" : "no";
  return String(value).replace(/^-(?=\d)/, "−");
}

/** Pairs of names and values, from a list of pairs or an object. */
export const pairs = (of) => (Array.isArray(of) ? of.map((p) => (Array.isArray(p) ? p : [p.name, p.value ?? p.count])) : Object.entries(of ?? {}));

/** `1 d 2 h`, `3 min 12 s`, `12.3 s`. */
export function duration(ms) {
  const seconds = Math.floor(ms / 1000);
  if (seconds < 60) return `${(ms / 1000).toFixed(1)} s`;
  if (seconds < 3600) return `${Math.floor(seconds / 60)} min ${seconds % 60} s`;
  if (seconds < 86400) return `${Math.floor(seconds / 3600)} h ${Math.floor(seconds / 60) % 60} min`;
  return `${Math.floor(seconds / 86400)} d ${Math.floor(seconds / 3600) % 24} h`;
}

/** Rows of a description list, made anew only when the names change. */
export function facts(list, rows) {
  if (list.childElementCount !== rows.length || rows.some(([name], i) => list.children[i].firstChild.textContent !== name)) {
    list.replaceChildren(...rows.map(([name]) => el("div", {}, el("dt", { text: name }), el("dd"))));
  }
  rows.forEach(([, value], i) => put(list.children[i].lastChild, value));
}

/** A button that asks once more before it does something. */
export function sure(text, again, act, attributes = {}) {
  let timer = 0;
  const calm = () => {
    clearTimeout(timer);
    timer = 0;
    it.textContent = text;
    it.classList.remove("asking");
  };
  const it = button(text, () => {
    if (timer) {
      calm();
      act();
      return;
    }
    it.textContent = again;
    it.classList.add("asking");
    timer = setTimeout(calm, 5000);
  }, attributes);
  it.addEventListener("blur", calm);
  return it;
}
