// Unpacks what .ci/page has packed: scripts and the board's module, one behind the other, compressed, as base 85.
// Then the page's own beginning goes on.
(async () => {
  const ALPHABET = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz!#$%&()*+-;,=>?@^_`{|}~";
  const digits = new Map([...ALPHABET].map((letter, digit) => [letter, digit]));
  const { textContent: text, dataset } = document.getElementById("packed");
  const words = new DataView(new ArrayBuffer((text.length / 5) * 4));
  for (let i = 0; i < text.length / 5; i++) {
    let word = 0;
    for (let k = 0; k < 5; k++) word = word * 85 + digits.get(text[5 * i + k]);
    words.setUint32(4 * i, word);
  }
  // What fills the last word is none of it.
  const stream = new Blob([words.buffer.slice(0, Number(dataset.bytes))]).stream().pipeThrough(new DecompressionStream("gzip"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  let at = bytes.indexOf(10);
  const contents = JSON.parse(new TextDecoder().decode(bytes.subarray(0, at++)));
  const imports = {};
  for (const [name, length] of contents) {
    const part = bytes.subarray(at, (at += length));
    if (name === "board.wasm") globalThis.virtualBoard = WebAssembly.compile(part);
    else imports[name] = URL.createObjectURL(new Blob([part], { type: "text/javascript" }));
  }
  const map = document.createElement("script");
  map.type = "importmap";
  map.textContent = JSON.stringify({ imports });
  document.head.append(map);
  await import("main.js");
})().catch((error) => {
  document.getElementById("link").textContent = `This browser cannot run the simulation: ${error.message}. Chrome 89, Firefox 113 and Safari 16.4 can`;
});
