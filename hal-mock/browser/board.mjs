// The virtual board on TCP, by Node alone (18 or later), on any system:
//     node board.mjs [pms5005|pioneer-arm|cm5|cm5-pass-through] [ADDRESS:PORT]
// Host programs of the original connect there; port 0 takes a free one. Settings that are saved last as long as
// it runs. Several clients may connect, and hear the same; what two of them send at once may mix, which the
// program `virtual-board` keeps apart. Exit code 1 when it cannot listen, 2 for a wrong command line.

import { createServer } from "node:net";
import { gunzipSync } from "node:zlib";
import { Board } from "./instance.mjs";
import { MODULE } from "./module.mjs";

/** Personalities, and where their hosts look for them. */
const PORTS = { pms5005: 5005, "pioneer-arm": 8101, cm5: 5006, "cm5-pass-through": 5006 };
/** A board that is this far behind (a machine that slept) does not catch up. */
const FARTHEST_BEHIND_MS = 1000;
/** Bytes that may wait for a client to read them. What finds no room is left out, in whole frames. */
const ROOM = 1 << 16;

function end(status, text) {
  console.error(`board: ${text}`);
  process.exit(status);
}

const [personality = "pms5005", place = `127.0.0.1:${PORTS[personality]}`, ...more] = process.argv.slice(2);
const [, host, port] = place.match(/^(.+):(\d+)$/) ?? [];
if (!(personality in PORTS) || port === undefined || more.length > 0) {
  end(2, `usage: node board.mjs [${Object.keys(PORTS).join("|")}] [ADDRESS:PORT]`);
}

const module = await WebAssembly.compile(gunzipSync(Buffer.from(MODULE, "base64")));
const board = await Board.start(module, personality);
const clients = new Set();

const server = createServer((client) => {
  clients.add(client);
  client.setNoDelay(true);
  client.on("data", (bytes) => board.feed(bytes));
  client.on("error", () => client.destroy());
  client.on("close", () => clients.delete(client));
});
server.on("error", (error) => end(1, `${place}: ${error.message}`));
server.listen(Number(port), host, () => {
  const { address, port } = server.address();
  console.log(`${personality} at your service:\n  TCP ${address}:${port}`);
});

let start = performance.now();
let now = 0;
setInterval(() => {
  if (performance.now() - start - now > FARTHEST_BEHIND_MS) start = performance.now() - now;
  now = performance.now() - start;
  board.advance(now * 1000);
  for (let frame = board.take(); frame !== null; frame = board.take()) {
    for (const client of clients) if (client.writableLength < ROOM) client.write(frame);
  }
}, 1);
