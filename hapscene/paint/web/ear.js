// What is heard, in an audio worklet: it must not wait for what the page draws.
//
// What comes waits before it is heard, so that what comes later than the rest is still in time. How long is measured:
// all but the worst second of the last sixty must have been in time. What is too late even so is bridged.
const FIRST_S = 0.03, MOST_S = 0.5;  // how far what waits is taken to fall before it is known, and at most
const MARGIN_S = 0.01;  // waits besides
const SECONDS = 60;  // how long a fall counts
const SLACK_S = 0.015, HURRY = 0.08;  // further off than that from what shall wait, it is played up to 8 % faster or slower
const KEPT_S = 1;  // the most that waits; of what comes at once after a pause, the rest is left out
const BRIDGE_S = 0.02, FADE_S = 0.03, JOIN_S = 0.005;  // a gap is filled with the last 20 ms, there and back, which fade

// How long what comes shall wait, by how far what waits has fallen: the server, the net and the ear may all be late.
export class Wait {
  constructor() {
    this.falls_s = new Float32Array(SECONDS).fill(FIRST_S);  // the largest of each second
    this.heard_s = 0;
    this.ahead_s = FIRST_S + MARGIN_S;
    this.begin();
  }
  begin() { this.top_s = -Infinity; }
  // A message has come: what waited before it, less than nothing where it is too late, and how much it holds.
  note(before_s, length_s) {
    const second = Math.floor(this.heard_s);
    this.heard_s += length_s;
    for (let s = second + 1; s <= Math.floor(this.heard_s); s++) this.falls_s[s % SECONDS] = 0;
    const at = Math.floor(this.heard_s) % SECONDS;
    this.falls_s[at] = Math.max(this.falls_s[at], Math.min(this.top_s - before_s, MOST_S));
    this.top_s = Math.max(before_s + length_s, this.top_s - length_s * HURRY);
    this.ahead_s = this.falls_s.toSorted().at(-2) + MARGIN_S;
  }
}

// Plays samples as they come. Tells the page, of each message, how long it waits, and what gaps there were.
function play() {
  class Player extends AudioWorkletProcessor {
    constructor() {
      super();
      this.ring = new Float32Array(1);
      this.rate = 1;
      this.read = this.write = 0;  // samples since ever; `read` is between two of them
      this.wait = new Wait();
      this.level_s = this.wait.ahead_s;  // what waited when the last message had come
      this.playing = false;
      this.dry_s = -Infinity;
      this.gaps = 0;
      this.join = 0;  // how much of what is heard is new, 0 to 1; the rest bridges
      this.bridge = 0;  // samples since it ran dry
      this.loud = 0;  // of the bridge
      this.port.onmessage = ({ data }) => { data.wire.onmessage = (event) => this.take(event.data); };
    }
    waits() { return (this.write - this.read) / this.rate; }
    take({ a, rate, count }) {
      if (rate !== this.rate) Object.assign(this, { rate, ring: new Float32Array(Math.ceil(KEPT_S * rate)), read: 0, write: 0, playing: false, join: 0, loud: 0 });
      const dry_s = this.playing ? 0 : currentTime - this.dry_s;
      if (dry_s > KEPT_S) this.wait.begin();
      else if (!this.playing && this.read === this.write) this.gaps++;
      this.wait.note(this.waits() - Math.min(dry_s, KEPT_S), a.length / rate);
      this.port.postMessage({ count, lead_s: Math.max(this.waits(), this.playing ? 0 : this.wait.ahead_s), gaps: this.gaps });
      const room = Math.floor(this.ring.length - (this.write - this.read));
      for (const v of a.subarray(0, room)) this.ring[this.write++ % this.ring.length] = v;
      this.level_s = this.waits();
    }
    at(place) {
      const { ring } = this, k = Math.floor(place), part = place - k;
      return (1 - part) * ring[k % ring.length] + part * ring[(k + 1) % ring.length];
    }
    process(_, [[out]]) {
      const waits_s = this.waits(), { rate } = this, { ahead_s } = this.wait;
      if (!this.playing && waits_s >= ahead_s) {
        this.playing = true;
        this.wait.begin();
      }
      const over_s = Math.max(waits_s - ahead_s - SLACK_S, 0) - Math.max(ahead_s - SLACK_S - this.level_s, 0);
      const each = rate / sampleRate, step = each * (1 + HURRY * Math.min(Math.max(over_s / ahead_s, -1), 1));
      const span = BRIDGE_S * rate, fade = Math.exp(-1 / (FADE_S * sampleRate));
      for (let i = 0; i < out.length; i++) {
        if (this.playing && this.read + 1 >= this.write) {
          Object.assign(this, { playing: false, dry_s: currentTime, loud: 1, bridge: 0, join: 0, end: this.write - 1, read: this.write });
        }
        let heard = 0;
        if (this.loud > 1e-4) {  // there and back again over what was last
          const away = this.bridge % (2 * span);
          heard = (1 - this.join) * this.loud * this.at(Math.max(this.end - Math.min(away, 2 * span - away), 0));
          this.bridge += each;
          this.loud *= fade;
        }
        if (this.playing) {
          this.join = Math.min(this.join + 1 / (JOIN_S * sampleRate), 1);
          heard += this.join * this.at(this.read);
          this.read += step;
        }
        out[i] = heard;
      }
      return true;
    }
  }
  registerProcessor("hapscene-sound", Player);
}

if (typeof registerProcessor !== "undefined") play();
