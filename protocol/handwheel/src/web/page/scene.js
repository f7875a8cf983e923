// A virtual PMS5005's world, drawn as it truly is: wheels, joints and servos as they stand, and the wall before the
// wheels. It is told five times a second; in between everything glides.

const SVG = "http://www.w3.org/2000/svg";
/** A wheel's counts a turn: 50 cm around, of 0.004 cm each. */
const WHEEL_COUNTS = 12500;
/** A potentiometer's counts and degrees from end to end, and where it points when it is in the middle: up. */
const POTENTIOMETER = [4096, 333.3];
/** A servo's microseconds in the middle, and for 90 degrees. */
const SERVO = [1500, 1000];
/** How far the drawing reaches ahead. */
const FARTHEST_CM = 200;
const [LEFT, WIDTH] = [70, 560];

function shape(tag, attributes, ...children) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

/** A dial with its name below: what turns it. */
function dial(parent, x, y, radius, name) {
  const hand = shape("line", { x1: 0, y1: 0, x2: 0, y2: -radius, class: "hand" });
  const label = shape("text", { y: radius + 13 });
  label.textContent = name;
  parent.append(shape("g", { transform: `translate(${x} ${y})` }, shape("circle", { r: radius }), hand, label));
  return (degrees, isOn) => {
    hand.style.transform = `rotate(${degrees}deg)`;
    hand.classList.toggle("on", isOn);
  };
}

/** An empty drawing, and what shows a state on it. */
export function scene() {
  const drawing = shape("svg", { viewBox: "0 0 640 212", class: "scene", role: "img", "aria-label": "The simulated world" });
  const wall = shape("rect", { x: 0, y: 4, width: 8, height: 44, class: "wall" });
  drawing.append(shape("rect", { x: 14, y: 12, width: 50, height: 28, rx: 6 }), shape("path", { d: "M64 26h6", class: "hand" }),
    shape("line", { x1: LEFT, y1: 52, x2: LEFT + WIDTH, y2: 52 }), wall);
  const motors = [0, 1, 2, 3, 4, 5].map((i) => dial(drawing, 55 + 106 * i, 92, i < 2 ? 28 : 22, `${i < 2 ? "wheel" : "joint"} ${i + 1}`));
  const servos = [0, 1, 2, 3, 4, 5].map((i) => dial(drawing, 55 + 106 * i, 174, 16, `servo ${i + 1}`));
  return { drawing, show: (state) => {
    const cm = state.wall_cm;
    wall.style.display = typeof cm === "number" ? "" : "none";
    wall.style.transform = `translate(${LEFT + (Math.min(cm ?? 0, FARTHEST_CM) / FARTHEST_CM) * WIDTH}px)`;
    state.motors.forEach(({ position, enabled }, i) => {
      const [counts, degrees] = i < 2 ? [WHEEL_COUNTS, 360] : POTENTIOMETER;
      motors[i]((i < 2 ? position / counts : position / counts - 0.5) * degrees, enabled);
    });
    state.servos.forEach(({ pulse_us, enabled }, i) => servos[i](enabled ? ((pulse_us - SERVO[0]) / SERVO[1]) * 90 : 0, enabled));
  } };
}
