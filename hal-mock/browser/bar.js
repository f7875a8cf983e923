// What stands above the page: that it is a simulation, of which controller, and how to go on. And what the browser
// keeps of it. Which controller it is stands in the page's address: `?cm5`.

const WHICH = { pms5005: "PMS5005, six motors", "pioneer-arm": "Pioneer Arm", cm5: "CM-5 with six servos" };
const KEPT = "virtual-board";

const alert = element("p", { id: "simulation-alert", role: "alert", hidden: "" });

function element(name, attributes, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

/** Which controller the person has chosen. */
export function personality() {
  const chosen = location.search.slice(1);
  return Object.hasOwn(WHICH, chosen) ? chosen : "pms5005";
}

/** What this controller's flash held when it was kept last, or null. */
export function kept(which) {
  try {
    const text = localStorage.getItem(`${KEPT} ${which}`);
    return text && Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  } catch {
    return null;
  }
}

/** Keeps what a controller's flash holds. */
export function keep(which, flash) {
  let text = "";
  for (const byte of flash) text += String.fromCharCode(byte);
  try {
    localStorage.setItem(`${KEPT} ${which}`, btoa(text));
  } catch {
    warn("This browser's storage is full or forbidden: what was saved just now lasts until the page is closed");
  }
}

/** Says that something has gone wrong. */
export function warn(text) {
  alert.textContent = text;
  alert.hidden = false;
}

const select = element("select", { id: "simulation-which", "aria-label": "Which controller to simulate" });
for (const [which, name] of Object.entries(WHICH)) select.append(element("option", { value: which }, name));
select.value = personality();
select.addEventListener("change", () => {
  location.search = select.value;
});
window.addEventListener("storage", ({ key }) => {
  if (key !== `${KEPT} ${personality()}`) return;
  warn("Another tab has saved this controller's settings: load this page anew to have them. A save here replaces them");
});
const how = element("details", {}, element("summary", {}, "With a real board"),
  "Build or download an image, flash it and connect the board, as the project's README says; then ",
  element("code", {}, "handwheel web"), " serves this page for it. Firmware and page are the same there; motors and sensors",
  " are computed here, and a page that hangs stops this board's time, where a real board would stop its motors. Read the",
  " board's guide before you connect a motor.");
const says = element("p", {}, element("strong", {}, "A simulation. "), "The board's own firmware runs in this page; nothing is",
  " attached, nothing moves. What it saves stays in this browser. ");
document.body.prepend(element("section", { id: "simulation", "aria-label": "Simulation" }, says, select, how, alert));
