// What stands above the page: that it is a simulation, of which controller, and how to go on. And what the browser
// keeps of it.

const WHICH = { pms5005: "PMS5005, six motors", "pioneer-arm": "Pioneer Arm", cm5: "CM-5 with six servos" };
const CHOICE = "virtual-board";

const alert = element("p", { id: "simulation-alert", role: "alert", hidden: "" });

function element(name, attributes, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

/** Which controller the person has chosen. */
export function personality() {
  const chosen = read(CHOICE);
  return chosen in WHICH ? chosen : "pms5005";
}

/** What this controller's flash held when it was kept last, or null. */
export function kept(which) {
  const text = read(`${CHOICE} ${which}`);
  try {
    return text && Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  } catch {
    return null;
  }
}

/** Keeps what a controller's flash holds. */
export function keep(which, flash) {
  let text = "";
  for (const byte of flash) text += String.fromCharCode(byte);
  if (!write(`${CHOICE} ${which}`, btoa(text))) {
    warn("This browser keeps nothing for a page from a file: what is saved is lost with the page");
  }
}

/** Says that something has gone wrong. */
export function warn(text) {
  alert.textContent = text;
  alert.hidden = false;
}

function read(key) {
  try {
    return localStorage.getItem(key);
  } catch {
    return null;
  }
}

function write(key, value) {
  try {
    localStorage.setItem(key, value);
    return true;
  } catch {
    return false;
  }
}

const select = element("select", { id: "simulation-which", "aria-label": "Which controller to simulate" });
for (const [which, name] of Object.entries(WHICH)) select.append(element("option", { value: which }, name));
select.value = personality();
select.addEventListener("change", () => {
  write(CHOICE, select.value);
  location.reload();
});
const how = element("details", {}, element("summary", {}, "With a real board"),
  "Build or download an image, flash it and connect the board, as the project's README says; then ", element("code", {}, "handwheel web"),
  " serves this page for it. Everything here works as it does there; only motors and sensors are computed. Read the board's guide before you connect a motor.");
document.body.prepend(element("section", { id: "simulation", "aria-label": "Simulation" },
  element("p", {}, element("strong", {}, "A simulation. "), "The board's own firmware runs in this page; nothing is attached, nothing moves. What it saves stays in this browser. "),
  select, how, alert));
