// Client of hapscene's bridge in one file, for Node.js without packages. See docs/reference/bridge-protocol.md, version 1.
// In each step of your physics call frame, then take, as push.mjs does. A browser sends the same packets over --ws.
import dgram from "node:dgram";
import zlib from "node:zlib";

const [HELLO, WELCOME, FRAME, STATE, ORDER, ANSWER, BYE, REFUSED] = [1, 2, 3, 4, 5, 6, 7, 8];
const KINDS = ["", "began", "crossed", "ended"];

const table = Array.from({ length: 256 }, (_, n) => {
  for (let k = 0; k < 8; k++) n = n & 1 ? (n >>> 1) ^ 0xedb88320 : n >>> 1;
  return n >>> 0;
});

function crc(...parts) {
  if (zlib.crc32) return parts.reduce((before, part) => zlib.crc32(part, before), 0); // Node 22
  let c = 0xffffffff;
  for (const part of parts) for (const byte of part) c = (c >>> 8) ^ table[(c ^ byte) & 0xff];
  return (c ^ 0xffffffff) >>> 0;
}

export class Client {
  bodies = [];
  swatches = [];
  state = null; // tick, age_s, tool, proxy, normal, force, depth, slip, body, face, swatch, flags
  events = []; // since you last emptied the list
  lost = false; // the server was restarted, or has another client: open a new client
  #socket = dgram.createSocket("udp4");
  #key = 0n;
  #sequence = 0;
  #orders = 0;
  #eventCount = 0;
  #last = 0;
  #totals = {};
  #seen = {};
  #waiting = new Map();
  #patience_s = 10;

  static async open({ host = "127.0.0.1", port = 47700, up = "y", handed = "right", metres = 1, patience_s = 10 } = {}) {
    const client = new Client();
    client.#patience_s = patience_s;
    await new Promise((done) => client.#socket.connect(port, host, done));
    client.#socket.on("message", (data) => client.#receive(data));
    client.#socket.on("error", () => {}); // a packet was refused by the port
    const nonce = Math.floor(Math.random() * 2 ** 53);
    const answer = await client.#ask(HELLO, 1, { version: 1, nonce, up, handed, metres }).catch((error) => {
      client.#socket.close();
      throw error;
    });
    Object.assign(client, { bodies: answer.bodies, swatches: answer.swatches });
    for (const name of answer.bodies) [client.#totals[name], client.#seen[name]] = [Array(6).fill(0), Array(6).fill(0)];
    return client;
  }

  /** Send an order, executed once, and return its answer; throws an error that states the reason. */
  order(order, what = {}) {
    return this.#ask(ORDER, ++this.#orders, { order, ...what });
  }

  /** Send poses of bodies, {name, p, q: [x, y, z, w], v, w, jumps}, and the target of the hand (null: unchanged). */
  frame(aim = null, moved = []) {
    const out = Buffer.alloc(32 + 160 * moved.length);
    out.writeUInt8(aim ? 1 : 0, 0);
    out.writeUInt8(moved.length, 1);
    out.writeUInt32LE(this.#eventCount, 4);
    (aim ?? [0, 0, 0]).forEach((number, i) => out.writeDoubleLE(number, 8 + 8 * i));
    moved.forEach(({ name, p, q = [0, 0, 0, 1], v, w, jumps = false }, k) => {
      const at = 32 + 160 * k;
      out.writeUInt16LE(this.bodies.indexOf(name), at);
      out.writeUInt16LE((jumps ? 1 : 0) + (v ? 2 : 0), at + 2);
      const numbers = [...p, ...q, ...(v ?? [0, 0, 0]), ...(w ?? [0, 0, 0]), ...this.#seen[name]];
      numbers.forEach((number, i) => out.writeDoubleLE(number, at + 8 + 8 * i));
    });
    this.#send(FRAME, ++this.#sequence, out);
  }

  /** Return the increase of a body's total impulse since the last call: apply it in this step. */
  take(name) {
    const grown = this.#totals[name].map((total, i) => total - this.#seen[name][i]);
    this.#seen[name] = [...this.#totals[name]];
    return grown;
  }

  close() {
    this.#send(BYE, 0, Buffer.alloc(0), () => this.#socket.close());
  }

  #send(kind, sequence, payload, done = () => {}) {
    const head = Buffer.alloc(24);
    head.write("HSB1", 0, "latin1");
    head.writeUInt8(kind, 4);
    head.writeUInt16LE(24 + payload.length, 6);
    head.writeBigUInt64LE(this.#key, 8);
    head.writeUInt32LE(sequence, 16);
    head.writeUInt32LE(crc(head.subarray(0, 20), payload), 20);
    this.#socket.send(Buffer.concat([head, payload]), done);
  }

  #receive(data) {
    if (data.length < 24 || data.toString("latin1", 0, 4) !== "HSB1" || data.readUInt16LE(6) !== data.length) return;
    const payload = data.subarray(24);
    if (crc(data.subarray(0, 20), payload) !== data.readUInt32LE(20)) return;
    const [kind, key, sequence] = [data.readUInt8(4), data.readBigUInt64LE(8), data.readUInt32LE(16)];
    if (kind === STATE && key === this.#key) return this.#takeState(sequence, payload);
    const asked = kind === WELCOME ? HELLO : kind === ANSWER ? ORDER : kind === REFUSED ? HELLO : 0;
    if (!asked) return;
    if (kind === WELCOME && this.#key === 0n) this.#key = key;
    const answer = JSON.parse(payload.toString());
    if (kind === REFUSED && answer.error === "no such session") {
      this.lost = true;
      for (const settle of this.#waiting.values()) settle({ error: "the session is lost: open a new client" });
    } else this.#waiting.get(`${asked} ${sequence}`)?.(answer);
  }

  #takeState(sequence, data) {
    if (sequence <= this.#last) return; // overtaken
    this.#last = sequence;
    const doubles = (at, count) => Array.from({ length: count }, (_, i) => data.readDoubleLE(at + 8 * i));
    const state = { tick: Number(data.readBigUInt64LE(0)), age_s: data.readDoubleLE(8) };
    ["tool", "proxy", "normal", "force"].forEach((name, i) => (state[name] = doubles(16 + 24 * i, 3)));
    [state.depth, state.slip] = doubles(112, 2);
    ["body", "face", "swatch"].forEach((name, i) => (state[name] = data.readInt32LE(128 + 4 * i)));
    state.flags = data.readUInt32LE(140);
    let [number, at] = [data.readUInt32LE(144), 152];
    for (let k = data.readUInt16LE(150); k > 0; k--, at += 56)
      this.#totals[this.bodies[data.readUInt16LE(at)]] = doubles(at + 8, 6);
    for (let k = data.readUInt16LE(148); k > 0; k--, at += 24, number++) {
      if (number < this.#eventCount) continue;
      const [body, swatch] = [this.bodies[data.readUInt16LE(at + 10)], this.swatches[data.readUInt16LE(at + 12)]];
      const kind = KINDS[data.readUInt8(at + 8)];
      this.events.push({ tick: Number(data.readBigUInt64LE(at)), kind, body, swatch, speed: data.readDoubleLE(at + 16) });
      this.#eventCount = number + 1;
    }
    this.state = state;
  }

  async #ask(kind, sequence, what) {
    const payload = Buffer.from(JSON.stringify(what));
    const answer = await new Promise((done, fail) => {
      let [left, why] = [10 * this.#patience_s, "no answer: is `hapscene serve` running?"];
      const again = () => {
        if (left-- > 0) return this.#send(kind, sequence, payload);
        clearInterval(timer);
        fail(new Error(why));
      };
      const timer = setInterval(again, 100);
      this.#waiting.set(`${kind} ${sequence}`, (reply) => {
        if (reply.error === "another client is here") return (why = reply.error);
        clearInterval(timer);
        done(reply);
      });
      again();
    });
    this.#waiting.delete(`${kind} ${sequence}`);
    if (answer.error) throw new Error(answer.error);
    return answer;
  }
}
