// What goes over the socket to the server: what is asked with its answer, what is told to whoever listens, and a new
// connection every second while there is none. The server's `web` module has the interface.
//
// Besides what the server tells, `socket` tells `{open}`, and `stopping` that this page asks for a stop. A connection that is lost disarms: the server
// has stopped what this page drove, and a new connection begins disarmed.

import { open } from "/socket.js";

const RETRY_MS = 1000;

const listeners = new Map();
const last = new Map();
const waiting = new Map();
let socket = null;
let number = 0;

/** Calls `listener` with what is told under this name, and at once with the last that was. */
export function on(tell, listener) {
  if (!listeners.has(tell)) listeners.set(tell, []);
  listeners.get(tell).push(listener);
  if (last.has(tell)) listener(last.get(tell));
}

/** The last that was told under this name. */
export const told = (tell) => last.get(tell);

/** Sends without waiting for an answer. False if there is no connection. */
export function say(what, values = {}) {
  if (socket?.readyState !== WebSocket.OPEN) return false;
  socket.send(JSON.stringify({ do: what, ...values }));
  return true;
}

/** Sends, and returns the answer's `ok`; throws what the answer says is wrong. */
export function ask(what, values = {}) {
  return new Promise((resolve, reject) => {
    const id = ++number;
    if (!say(what, { id, ...values })) {
      reject(new Error("there is no connection to handwheel: it was not sent"));
      return;
    }
    waiting.set(id, { resolve, reject });
  });
}

/** Opens the connection, and keeps on trying. */
export function connect() {
  socket = open();
  socket.onopen = () => tell("socket", { open: true });
  socket.onmessage = ({ data }) => hear(data);
  socket.onclose = () => {
    tell("socket", { open: false });
    tell("armed", { by: null, you: false });
    for (const { reject } of waiting.values()) {
      reject(new Error("the connection to handwheel was lost before the answer came"));
    }
    waiting.clear();
    setTimeout(connect, RETRY_MS);
  };
}

/** Tells the listeners. */
export function tell(name, value) {
  last.set(name, value);
  for (const listener of listeners.get(name) ?? []) {
    try {
      listener(value);
    } catch (error) {
      console.error(name, error); // one listener's mistake keeps nothing from the others
    }
  }
}

function hear(text) {
  let message;
  try {
    message = JSON.parse(text);
  } catch {
    console.error("not JSON:", text);
    return;
  }
  if (message.tell !== undefined) {
    tell(message.tell, message);
    return;
  }
  const asked = waiting.get(message.id);
  waiting.delete(message.id);
  if (message.error !== undefined) asked?.reject(new Error(message.error));
  else asked?.resolve(message.ok);
}
