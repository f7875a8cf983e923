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
/** Bytes that may wait for the board, and how many a client gives at a time: then it is another's turn. */
const BACKLOG = 1024;
const PIECE = 256;
const HIGHEST_PORT = 65535;

function end(status, text) {
  console.error(`board: ${text}`);
  process.exit(status);
}

const [personality = "pms5005", ...rest] = process.argv.slice(2);
const [place = `127.0.0.1:${PORTS[personality]}`, ...more] = rest;
const [, host, port] = place.match(/^\[?([^\]]+)\]?:(\d+)$/) ?? [];
if (!Object.hasOwn(PORTS, personality) || !(Number(port) <= HIGHEST_PORT) || more.length > 0) {
  end(2, `usage: node board.mjs [${Object.keys(PORTS).join("|")}] [ADDRESS:PORT]`);
}

const module = await WebAssembly.compile(gunzipSync(Buffer.from(MODULE, "base64")));
const board = await Board.start(module, personality);
/** What each has sent that the board has not taken. */
const clients = new Map();

const server = createServer((client) => {
  clients.set(client, Buffer.alloc(0));
  client.setNoDelay(true);
  client.on("data", (bytes) => {
    client.pause();
    clients.set(client, bytes);
  });
  client.on("error", () => client.destroy());
});
server.on("error", (error) => end(1, `${place}: ${error.message}`));
server.listen(Number(port), host, () => {
  const { address, port } = server.address();
  console.log(`${personality} at your service:\n  TCP ${address}:${port}`);
});

/** A piece of each client's, as far as the line can follow. Who has gone is heard to the end. */
function feed() {
  for (const [client, bytes] of clients) {
    if (bytes.length > 0) {
      if (board.backlog() > BACKLOG) continue;
      board.feed(bytes.subarray(0, PIECE));
      clients.set(client, bytes.subarray(PIECE));
    } else if (client.destroyed) clients.delete(client);
    else if (client.isPaused()) client.resume();
  }
}

let start = performance.now();
let now = 0;
setInterval(() => {
  if (performance.now() - start - now > FARTHEST_BEHIND_MS) start = performance.now() - now;
  now = performance.now() - start;
  try {
    feed();
    board.advance(now * 1000);
    for (let frame = board.take(); frame !== null; frame = board.take()) {
      for (const client of clients.keys()) if (client.writableLength < ROOM) client.write(frame);
    }
  } catch (error) {
    end(1, error.message.replaceAll("\n", " "));
  }
}, 1);
