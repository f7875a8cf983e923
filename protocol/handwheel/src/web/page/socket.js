// The way to the server, and the only file that knows it. Of what is opened `link.js` uses no more than `onopen`,
// `onmessage` with its `data`, `onclose`, `readyState` and `send`: another file in place of this one can do without
// a server.

/** A WebSocket to the server that the page is from, with the token of the page's address if that has one. */
export function open() {
  const url = new URL("/socket", location);
  url.protocol = location.protocol === "https:" ? "wss:" : "ws:";
  const token = new URLSearchParams(location.search).get("token");
  if (token !== null) url.searchParams.set("token", token);
  return new WebSocket(url);
}
