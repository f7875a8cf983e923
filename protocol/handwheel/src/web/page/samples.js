// The last minute of a motor, in rings: what a strip chart draws.

/** A minute at 50 a second, and a little more. */
const CAPACITY = 3200;

export const QUANTITIES = ["set_point", "position", "velocity", "duty", "current"];

export class Samples {
  constructor() {
    this.begin = 0;
    this.count = 0;
    this.ms = new Float64Array(CAPACITY);
    this.mode = new Array(CAPACITY).fill("off");
    for (const name of QUANTITIES) this[name] = new Float64Array(CAPACITY);
  }

  /** Adds what a motor did at this time of the board's clock. An earlier time is another life of the board. */
  push(ms, motor) {
    if (this.count && ms < this.last()) this.count = 0;
    const at = (this.begin + this.count) % CAPACITY;
    this.ms[at] = ms;
    this.mode[at] = motor.mode;
    for (const name of QUANTITIES) this[name][at] = motor[name] ?? NaN;
    if (this.count < CAPACITY) this.count += 1;
    else this.begin = (this.begin + 1) % CAPACITY;
  }

  /** Where the nth oldest is. */
  at(n) {
    return (this.begin + n) % CAPACITY;
  }

  /** The newest time. */
  last() {
    return this.count ? this.ms[this.at(this.count - 1)] : 0;
  }

  /** The first whose time is not before this one. */
  from(ms) {
    let low = 0;
    let high = this.count;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.ms[this.at(middle)] < ms) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  /** As it is now, for a chart that is paused. */
  copy() {
    const copy = new Samples();
    copy.begin = this.begin;
    copy.count = this.count;
    copy.mode = [...this.mode];
    for (const name of ["ms", ...QUANTITIES]) copy[name].set(this[name]);
    return copy;
  }
}
