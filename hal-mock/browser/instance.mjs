// One board of the module (src/lib.rs), for a page and for Node.

/** A board that was switched on. A panic of the board ends it: then whatever is called throws its text. */
export class Board {
  #exports;
  /** Why it has ended. */
  #ended = null;

  /** Switches one on. `what` as the module's `start` takes it, `flash` as `flash()` has told it, or null. */
  static async start(module, what, flash = null) {
    const board = new Board();
    board.#exports = (await WebAssembly.instantiate(module)).exports;
    if (flash !== null) board.#call("flash_in", flash);
    const wrong = board.#text("start", what);
    if (wrong !== null) throw new Error(wrong);
    return board;
  }

  /** Lets time pass, until so many microseconds after the start. */
  advance(untilUs) {
    this.#run(() => this.#exports.advance(untilUs));
  }

  /** Takes bytes of the host. */
  feed(bytes) {
    this.#call("feed", bytes);
  }

  /** How many bytes of the host have not arrived yet. */
  backlog() {
    return this.#run(() => this.#exports.backlog());
  }

  /** The next frame for the host, or null. */
  take() {
    return this.#bytes("take");
  }

  /** What the flash holds if it has changed since the last time, or null. */
  flash() {
    return this.#bytes("flash_out");
  }

  /** Answers an inspector's question. */
  ask(question) {
    return JSON.parse(this.#text("ask", JSON.stringify(question)));
  }

  /** A page is the host from now on. */
  openPage() {
    this.#run(() => this.#exports.open_page());
  }

  /** Takes a page's message, a text. */
  say(message) {
    this.#call("page_says", new TextEncoder().encode(message));
  }

  /** The next message for the page, or null. */
  hear() {
    return this.#text("page_hears");
  }

  #run(act) {
    if (this.#ended !== null) throw this.#ended;
    try {
      return act();
    } catch (error) {
      this.#ended = new Error(this.#got(this.#exports.panic_text()) ?? error.message, { cause: error });
      throw this.#ended;
    }
  }

  /** Calls with bytes. The memory may have moved: where it is is asked for last. */
  #call(name, bytes) {
    return this.#run(() => {
      const at = this.#exports.room(bytes.length);
      new Uint8Array(this.#exports.memory.buffer, at, bytes.length).set(bytes);
      return this.#exports[name](bytes.length);
    });
  }

  #bytes(name) {
    return this.#run(() => {
      const length = this.#exports[name]();
      if (length === 0) return null;
      const at = this.#exports.room(length);
      return new Uint8Array(this.#exports.memory.buffer, at, length).slice();
    });
  }

  #text(name, given = null) {
    if (given !== null) return this.#got(this.#call(name, new TextEncoder().encode(given)));
    return this.#got(this.#run(() => this.#exports[name]()));
  }

  #got(length) {
    if (length === 0) return null;
    const at = this.#exports.room(length);
    return new TextDecoder().decode(new Uint8Array(this.#exports.memory.buffer, at, length));
  }
}
