// A strip chart on a canvas: above, the set-point and the position or velocity; below, duty and current. Each
// has its own dash, so that it is told apart without its colour.

/** How each is drawn; `color` is a variable of the style. */
export const STYLES = {
  set_point: { color: "--set-point", dash: [6, 4], width: 1.5 },
  position: { color: "--value", dash: [], width: 2 },
  velocity: { color: "--value", dash: [], width: 2 },
  duty: { color: "--duty", dash: [], width: 1.25 },
  current: { color: "--current", dash: [2, 2], width: 1.5 },
};

const UNITS = { velocity: "counts/s", position: "counts" };
/** A scale shrinks when what it shows has been so small a part of it for so long. */
const SMALL = 0.4;
const SHRINK_MS = 1500;
/** Samples further apart are not joined. */
const GAP_MS = 500;
/** Below a pane, for the times. */
const FOOT = 13;

let colors = {};

function readColors() {
  const style = getComputedStyle(document.documentElement);
  colors = {};
  for (const name of ["--set-point", "--value", "--duty", "--current", "--line", "--dim", "--text", "--card", "--faint"]) {
    colors[name] = style.getPropertyValue(name).trim();
  }
}

/** A colour of the style, as a canvas takes it. */
export const color = (name) => colors[name];

/** Calls `again` when the colours have changed. */
export function onColors(again) {
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    readColors();
    again();
  });
}

readColors();
onColors(() => {});

/** A range that follows what it shows, and does not tremble. */
export class Scale {
  constructor(least) {
    this.least = least;
    this.low = 0;
    this.high = 0;
    this.smallSince = null;
  }

  fit(low, high, now) {
    if (!(low <= high)) return;
    const span = this.high - this.low;
    const isInside = low >= this.low && high <= this.high && span > 0;
    const isSmall = Math.max(high - low, this.least) < SMALL * span;
    if (!isSmall) this.smallSince = null;
    else this.smallSince ??= now;
    if (isInside && !(isSmall && now - this.smallSince > SHRINK_MS)) return;
    const pad = Math.max((high - low) * 0.12, (this.least - (high - low)) / 2, 0);
    const step = nice((high - low + 2 * pad) / 4);
    this.low = Math.floor((low - pad) / step) * step;
    this.high = Math.ceil((high + pad) / step) * step;
    this.smallSince = null;
  }
}

/** The next of 1, 2, 5, 10, ... */
export function nice(step) {
  const ten = 10 ** Math.floor(Math.log10(step));
  return [1, 2, 5, 10].find((factor) => factor * ten >= step * 0.999) * ten;
}

/** A scale's number. */
export const whole = (value) => (Math.round(value) || 0).toLocaleString("en").replace("-", "−");

/** Makes a canvas as sharp as the screen; its context is in CSS pixels. */
export function prepare(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const { clientWidth: width, clientHeight: height } = canvas;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  context.font = "10px system-ui, sans-serif";
  return { context, width, height };
}

/** Text that stays readable on lines. */
export function label(context, text, x, y, align = "left", name = "--dim") {
  context.textAlign = align;
  context.textBaseline = "middle";
  context.lineWidth = 3;
  context.lineJoin = "round";
  context.strokeStyle = colors["--card"];
  context.strokeText(text, x, y);
  context.fillStyle = colors[name];
  context.fillText(text, x, y);
}

export function rule(context, x0, y0, x1, y1, name = "--faint") {
  context.setLineDash([]);
  context.lineWidth = 1;
  context.strokeStyle = colors[name];
  context.beginPath();
  context.moveTo(Math.round(x0) + 0.5, Math.round(y0) + 0.5);
  context.lineTo(Math.round(x1) + 0.5, Math.round(y1) + 0.5);
  context.stroke();
}

export class StripChart {
  constructor(canvas) {
    this.canvas = canvas;
    this.value = new Scale(200); // noise is to look like noise
    this.amperes = new Scale(0.5);
  }

  /** Draws `span` milliseconds. `shown` is a set of quantities, `quantity` what the upper pane is of, `cursor` an x. */
  draw(samples, span, quantity, shown, cursor) {
    const { context, width, height } = prepare(this.canvas);
    if (!width || !height) return;
    const end = samples.last();
    const view = { context, samples, width, from: samples.from(end - span), x: (ms) => width - ((end - ms) / span) * width };
    const upper = shown.has("set_point") || shown.has(quantity);
    const lower = shown.has("duty") || shown.has("current");
    const inner = height - FOOT;
    const split = upper && lower ? Math.round(inner * 0.6) : upper ? inner : 0;
    this.grid(view, span, inner);
    if (upper) this.drawUpper(view, 2, split - 3, quantity, shown);
    if (lower) this.drawLower(view, split + 3, inner - 2, shown);
    if (upper && lower) rule(context, 0, split, width, split, "--line");
    if (cursor !== null && samples.count) this.drawCursor(view, cursor, end, span, inner, quantity, shown);
  }

  grid({ context, width }, span, bottom) {
    for (let part = 1; part < 5; part += 1) {
      const x = (part / 5) * width;
      rule(context, x, 0, x, bottom);
      label(context, `−${((span / 1000) * (5 - part)) / 5} s`, x, bottom + FOOT / 2 + 1, "center");
    }
    rule(context, 0, bottom, width, bottom, "--line");
    label(context, "now", width - 2, bottom + FOOT / 2 + 1, "right");
  }

  drawUpper(view, top, bottom, quantity, shown) {
    const { context, width, samples } = view;
    let low = Infinity;
    let high = -Infinity;
    const isOfSetPoint = (at) => samples.mode[at] === quantity;
    for (let n = view.from; n < samples.count; n += 1) {
      const at = samples.at(n);
      const values = [shown.has(quantity) ? samples[quantity][at] : NaN, shown.has("set_point") && isOfSetPoint(at) ? samples.set_point[at] : NaN];
      for (const value of values) {
        if (value < low) low = value;
        if (value > high) high = value;
      }
    }
    if (quantity === "velocity" && low <= high) {
      low = Math.min(low, 0);
      high = Math.max(high, 0);
    }
    this.value.fit(low, high, performance.now());
    const scale = this.value;
    if (!(scale.high > scale.low)) return;
    const y = (value) => bottom - ((value - scale.low) / (scale.high - scale.low)) * (bottom - top);
    const step = nice((scale.high - scale.low) / Math.max(2, (bottom - top) / 22));
    for (let value = Math.ceil(scale.low / step) * step; value <= scale.high + step / 100; value += step) {
      rule(context, 0, y(value), width, y(value), Math.abs(value) < step / 100 ? "--line" : "--faint");
    }
    if (shown.has(quantity)) this.line(view, quantity, y);
    if (shown.has("set_point")) this.line(view, "set_point", y, isOfSetPoint);
    for (let value = Math.ceil(scale.low / step) * step; value <= scale.high + step / 100; value += step) {
      if (y(value) > top + 4 && y(value) < bottom - 4) label(context, whole(value), 3, y(value));
    }
  }

  drawLower(view, top, bottom, shown) {
    const { context, width, samples } = view;
    if (shown.has("duty")) {
      const y = (value) => bottom - ((value + 105) / 210) * (bottom - top);
      rule(context, 0, y(0), width, y(0), "--line");
      this.line(view, "duty", y);
      if (shown.has("set_point")) this.line(view, "set_point", y, (at) => samples.mode[at] === "PWM");
      label(context, "100 %", 3, y(100) + 5, "left", "--duty");
      label(context, "−100", 3, y(-100) - 4, "left", "--duty");
    }
    if (shown.has("current")) {
      let high = 0;
      for (let n = view.from; n < samples.count; n += 1) high = Math.max(high, samples.current[samples.at(n)] || 0);
      this.amperes.fit(0, high, performance.now());
      const most = this.amperes.high || 1;
      const y = (value) => bottom - (value / most) * (bottom - top - 2);
      this.line(view, "current", y);
      label(context, `${Number(most.toPrecision(2))} A`, width - 3, y(most) + 6, "right", "--current");
      label(context, "0 A", width - 3, y(0) - 5, "right", "--current");
    }
  }

  /** One quantity. Of many samples in a column of pixels, the highest and the lowest. */
  line({ context, samples, from, x }, name, y, isPart = () => true) {
    const style = STYLES[name];
    const values = samples[name];
    context.beginPath();
    let column = NaN;
    let low = 0;
    let high = 0;
    let before = -Infinity;
    for (let n = Math.max(0, from - 1); n < samples.count; n += 1) {
      const at = samples.at(n);
      const value = values[at];
      const ms = samples.ms[at];
      if (!(isPart(at) && value === value)) {
        before = -Infinity;
        continue;
      }
      const px = x(ms);
      const here = Math.floor(px);
      if (ms - before > GAP_MS) context.moveTo(px, y(value));
      else if (here !== column || value > high || value < low) context.lineTo(px, y(value));
      if (here !== column) [column, low, high] = [here, value, value];
      else [low, high] = [Math.min(low, value), Math.max(high, value)];
      before = ms;
    }
    context.setLineDash(style.dash);
    context.lineWidth = style.width;
    context.lineJoin = "round";
    context.strokeStyle = colors[style.color];
    context.stroke();
    context.setLineDash([]);
  }

  drawCursor({ context, samples, width }, x, end, span, bottom, quantity, shown) {
    const at = samples.at(Math.min(samples.from(end - ((width - x) / width) * span), samples.count - 1));
    rule(context, x, 0, x, bottom, "--dim");
    const side = x > width / 2 ? -5 : 5;
    const parts = [
      ["set_point", samples.mode[at] === quantity ? `${whole(samples.set_point[at])} ${UNITS[quantity]}` : "–"],
      [quantity, `${whole(samples[quantity][at])} ${UNITS[quantity]}`],
      ["duty", `${samples.duty[at].toFixed(1)} %`],
      ["current", `${samples.current[at].toFixed(2)} A`],
    ].filter(([name]) => shown.has(name));
    parts.forEach(([name, value], i) => {
      label(context, `${name.replace("_", "-")} ${value}`.replace(" -", " −"), x + side, 8 + i * 12, side < 0 ? "right" : "left", STYLES[name].color);
    });
  }
}
