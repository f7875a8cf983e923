// The LCD as a picture, and a picture for the LCD.
//
// 128 x 64 pixels in sixteen parts of 64 bytes: even parts are the left half, odd ones the right half, from the top,
// 8 rows a part. A byte is a column of 8 pixels, the least significant bit on top.

import { on, told } from "/link.js";
import { button, el, labelled, put, writer } from "/ui.js";
import { attempt, note } from "/strip.js";

const WIDTH = 128;
const HEIGHT = 64;
const PART = 64;
const DIGITS = 2 * (WIDTH * HEIGHT) / 8;
const OFF = [196, 214, 150];
const ON = [22, 34, 18];

const panel = document.getElementById("panel-io");
let canvas;
let about;
let send;
let threshold;
/** A picture's brightness, 0 to 255, before it is black and white. */
let picture = null;

/** Where a pixel is: its byte, its bit. */
function place(x, y) {
  const part = 2 * (y >> 3) + (x >= PART ? 1 : 0);
  return [part * PART + (x % PART), 1 << (y & 7)];
}

/** Draws what `isOn` says of each pixel. */
function paint(isOn) {
  const context = canvas.getContext("2d");
  const image = context.createImageData(WIDTH, HEIGHT);
  for (let y = 0; y < HEIGHT; y += 1) {
    for (let x = 0; x < WIDTH; x += 1) {
      image.data.set([...(isOn(x, y) ? ON : OFF), 255], 4 * (y * WIDTH + x));
    }
  }
  context.putImageData(image, 0, 0);
}

function bytes(hex) {
  if (typeof hex !== "string" || hex.length !== DIGITS) return null;
  return Uint8Array.from({ length: DIGITS / 2 }, (_, i) => parseInt(hex.slice(2 * i, 2 * i + 2), 16));
}

let drawn = null;

function show() {
  if (picture) return;
  const isVirtual = told("board")?.is_virtual;
  const hex = (isVirtual && told("world")?.state?.lcd) || told("outputs")?.lcd || null;
  put(about, hex ? (isVirtual ? "As the virtual board shows it" : "As a page here has sent it") : "No page here has sent a picture; the board does not tell what it shows");
  if (hex === drawn) return;
  drawn = hex;
  const image = bytes(hex);
  paint((x, y) => {
    const [at, bit] = place(x, y);
    return image ? image[at] & bit : false;
  });
}

async function read(input) {
  const [file] = input.files;
  picture = null;
  drawn = undefined;
  if (file) {
    try {
      picture = brightness(await createImageBitmap(file));
    } catch {
      note(`${file.name}: no picture that this browser can read`, "error");
    }
  }
  send.hidden = threshold.parentElement.hidden = !picture;
  preview();
}

/** Fits the picture in, on white. */
function brightness(bitmap) {
  const context = el("canvas", { width: WIDTH, height: HEIGHT }).getContext("2d");
  const scale = Math.min(WIDTH / bitmap.width, HEIGHT / bitmap.height);
  const [width, height] = [bitmap.width * scale, bitmap.height * scale];
  context.fillStyle = "white";
  context.fillRect(0, 0, WIDTH, HEIGHT);
  context.drawImage(bitmap, (WIDTH - width) / 2, (HEIGHT - height) / 2, width, height);
  const { data } = context.getImageData(0, 0, WIDTH, HEIGHT);
  return Uint8Array.from({ length: WIDTH * HEIGHT }, (_, i) => 0.3 * data[4 * i] + 0.59 * data[4 * i + 1] + 0.11 * data[4 * i + 2]);
}

const isDark = (x, y) => picture[y * WIDTH + x] < Number(threshold.value);

function preview() {
  if (!picture) {
    show();
    return;
  }
  paint(isDark);
  put(about, "Not sent yet");
}

async function sendPicture() {
  const image = new Uint8Array(DIGITS / 2);
  for (let y = 0; y < HEIGHT; y += 1) {
    for (let x = 0; x < WIDTH; x += 1) {
      const [at, bit] = place(x, y);
      if (isDark(x, y)) image[at] |= bit;
    }
  }
  const hex = [...image].map((byte) => byte.toString(16).padStart(2, "0")).join("");
  if ((await attempt("lcd", { image: hex }, "LCD")) === undefined) return;
  picture = null;
  send.hidden = threshold.parentElement.hidden = true;
  drawn = undefined;
  show();
}

export function start() {
  canvas = el("canvas", { id: "lcd", width: WIDTH, height: HEIGHT, role: "img", "aria-label": "The LCD" });
  about = el("p", { class: "dim" });
  const file = el("input", { id: "picture", type: "file", accept: "image/*" });
  file.addEventListener("change", () => read(file));
  threshold = el("input", { id: "threshold", type: "range", min: 1, max: 255, value: 128 });
  threshold.addEventListener("input", preview);
  send = writer(button("Send to the LCD", sendPicture, { id: "send-lcd", hidden: true }));
  const level = labelled("Dark below", threshold);
  level.hidden = true;
  panel.append(el("section", { class: "card" }, el("h2", { text: "LCD" }), canvas, about, labelled("A picture for it", file), level, send));
  for (const name of ["board", "outputs", "world"]) on(name, show);
  show();
}
