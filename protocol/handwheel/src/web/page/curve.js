// A step's curve on a canvas: the value with its target above, the duty below if samples have one; the step before
// it stays, faint and dashed; what was predicted is dashed above it, in its own colour.

import { color, label, nice, prepare, rule, whole } from "/chart.js";

const FOOT = 16;
const LEFT = 52;

/** Draws `step`, and `before` if there was one of the same unit. */
export function draw(canvas, step, before) {
  const { context, width, height } = prepare(canvas);
  if (!step?.samples?.length || !width) return;
  const steps = [step, ...(before && before.unit === step.unit ? [before] : [])];
  const values = steps.flatMap((s) => [s.target, ...s.samples.map((sample) => sample[1])]);
  const lasts = Math.max(...steps.map((s) => s.samples.at(-1)[0]), 1);
  const unit = nice((Math.max(...values) - Math.min(...values) || 10) / 5);
  const low = Math.floor(Math.min(...values) / unit) * unit;
  const high = Math.ceil(Math.max(...values) / unit + 0.2) * unit;
  const bottom = height - FOOT;
  const hasDuty = step.samples[0].length > 2;
  const split = hasDuty ? bottom * 0.72 : bottom;
  const x = (ms) => LEFT + (ms / lasts) * (width - LEFT - 8);
  const y = (value) => split - 6 - ((value - low) / (high - low)) * (split - 12);
  const yDuty = (duty) => bottom - 4 - ((duty + 105) / 210) * (bottom - split - 8);

  for (let value = low; value <= high + unit / 2; value += unit) {
    rule(context, LEFT, y(value), width, y(value));
    label(context, whole(value), LEFT - 5, y(value), "right");
  }
  const ms = nice(lasts / 6);
  for (let time = 0; time <= lasts; time += ms) {
    rule(context, x(time), 0, x(time), bottom);
    label(context, `${time} ms`, Math.min(x(time), width - 20), bottom + FOOT / 2 + 1, time ? "center" : "left");
  }
  rule(context, LEFT, split, width, split, "--line");
  if (hasDuty) rule(context, LEFT, yDuty(0), width, yDuty(0), "--line");
  for (const duty of hasDuty ? [100, 0, -100] : []) label(context, `${String(duty).replace("-", "−")} %`, LEFT - 5, yDuty(duty), "right", "--duty");

  const plot = (samples, pick, name, dash, width) => {
    context.beginPath();
    for (const sample of samples) context.lineTo(x(sample[0]), pick(sample));
    context.setLineDash(dash);
    context.lineWidth = width;
    context.strokeStyle = color(name);
    context.stroke();
    context.setLineDash([]);
  };
  const target = (s, alpha) => {
    context.globalAlpha = alpha;
    plot([[0], [lasts]], () => y(s.target), "--set-point", [6, 4], 1.5);
    context.globalAlpha = 1;
  };
  if (steps[1] && !steps[1].color) {
    context.globalAlpha = 0.45;
    plot(steps[1].samples, (s) => y(s[1]), "--value", [3, 3], 1.5);
    if (hasDuty) plot(steps[1].samples, (s) => yDuty(s[2]), "--duty", [3, 3], 1);
    context.globalAlpha = 1;
    if (steps[1].target !== step.target) target(steps[1], 0.4);
  }
  target(step, 1);
  plot(step.samples, (s) => y(s[1]), "--value", [], 2);
  if (steps[1]?.color) plot(steps[1].samples, (s) => y(s[1]), steps[1].color, [4, 4], 1.5);
  if (hasDuty) plot(step.samples, (s) => yDuty(s[2]), "--duty", [], 1.25);
}
