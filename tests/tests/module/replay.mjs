// Plays a script to the module (hal-mock/browser), for main.rs: JSON on standard input
// `{"module": FILE, "what": TEXT, "until": MS, "pieces": [[MS, HEX], ...]}`, the frames it answers with on
// standard output, one `MS HEX` a line, by the millisecond in which they have arrived.

import { readFileSync } from "node:fs";
import { Board } from "../../../hal-mock/browser/instance.mjs";

const { module, what, until, pieces } = JSON.parse(readFileSync(0, "utf8"));
const board = await Board.start(await WebAssembly.compile(readFileSync(module)), what);
const lines = [];
for (let ms = 0; ms <= until; ms += 1) {
  board.advance(ms * 1000);
  while (pieces.length > 0 && pieces[0][0] === ms) board.feed(Buffer.from(pieces.shift()[1], "hex"));
  for (let frame = board.take(); frame !== null; frame = board.take()) {
    lines.push(`${ms} ${Buffer.from(frame).toString("hex")}\n`);
  }
}
process.stdout.write(lines.join(""));
