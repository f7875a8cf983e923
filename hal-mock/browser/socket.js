// In place of handwheel's socket.js: the way to a board in the page itself.
//
// The board's time passes while the page is in view, and stands while it is hidden, so that nothing runs unseen.
// What the board saves is kept in the browser. A board that panics is gone, as one that was unplugged, and
// `link.js` opens another.

import { Board } from "instance.mjs";
import * as bar from "bar.js";

const TICK_MS = 5;
/** A page that was busy for longer goes on from there. */
const FARTHEST_BEHIND_MS = 100;

/** What the page takes for a WebSocket. */
export function open() {
  const socket = { readyState: WebSocket.CONNECTING };
  run(socket).catch((error) => {
    bar.warn(`The simulation has panicked and starts anew, without what was not saved: ${error.message}`);
    socket.readyState = WebSocket.CLOSED;
    socket.onclose?.();
  });
  return socket;
}

async function run(socket) {
  const which = bar.personality();
  const board = await Board.start(await globalThis.virtualBoard, which, bar.kept(which));
  board.openPage();
  socket.send = (text) => {
    try {
      board.say(text);
    } catch {
      // Told below: whatever is called next throws it.
    }
  };
  socket.readyState = WebSocket.OPEN;
  socket.onopen?.();

  let now = 0;
  let last = performance.now();
  await new Promise((_, reject) => {
    const timer = setInterval(() => {
      try {
        const passed = performance.now() - last;
        last += passed;
        if (document.hidden) return;
        now += Math.min(passed, FARTHEST_BEHIND_MS);
        board.advance(now * 1000);
        for (let data = board.hear(); data !== null; data = board.hear()) socket.onmessage?.({ data });
        const flash = board.flash();
        if (flash !== null) bar.keep(which, flash);
      } catch (error) {
        clearInterval(timer);
        reject(error);
      }
    }, TICK_MS);
  });
}
