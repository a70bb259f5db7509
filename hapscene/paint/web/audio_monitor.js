// Audio monitor: plays the acceleration stream in an audio worklet, so that sound does not wait for drawing.
//
// An adaptive jitter buffer delays the samples so that late messages still arrive in time. Its target length follows the
// measured jitter: it is twice the largest drop of the buffer level in the last sixty seconds. With the largest drop
// alone, each drop that exceeds the sixty before it would be a gap: about five in five minutes for any jitter. If the
// buffer runs empty, the gap is concealed.
const FIRST_S = 0.03, MOST_S = 0.5;  // jitter assumed before it is measured, and largest buffer
const SAFETY = 2, MARGIN_S = 0.01;  // length of the buffer: largest drop by this factor, plus this margin
const SECONDS = 60;  // length of the jitter statistics
const SLACK_S = 0.015, HURRY = 0.08;  // deviation from the target length that is tolerated; beyond, speed changes by up to 8 %
const BUFFER_S = 1;  // capacity of the buffer; samples that do not fit are dropped
const BRIDGE_S = 0.02, FADE_S = 0.03, JOIN_S = 0.005;  // a gap is concealed by the last 20 ms, played back and forth, fading

// Target length of the jitter buffer, from the drops of the buffer level between messages.
export class JitterBuffer {
  constructor() {
    this.drops_s = new Float32Array(SECONDS).fill(FIRST_S);  // largest drop in each second
    this.played_s = 0;
    this.target_s = SAFETY * FIRST_S + MARGIN_S;
    this.begin();
  }
  begin() { this.top_s = -Infinity; }
  // Records a message: the buffer level before it (negative if it is too late), and its length.
  note(before_s, length_s) {
    const second = Math.floor(this.played_s);
    this.played_s += length_s;
    for (let s = second + 1; s <= Math.floor(this.played_s); s++) this.drops_s[s % SECONDS] = 0;
    const at = Math.floor(this.played_s) % SECONDS;
    this.drops_s[at] = Math.max(this.drops_s[at], Math.min(this.top_s - before_s, MOST_S));
    this.top_s = Math.max(before_s + length_s, this.top_s - length_s * HURRY);
    this.target_s = Math.min(SAFETY * Math.max(...this.drops_s), MOST_S) + MARGIN_S;
  }
}

// Plays samples from the buffer. Reports the latency and the number of gaps for each message.
function play() {
  class Player extends AudioWorkletProcessor {
    constructor() {
      super();
      this.ring = new Float32Array(1);
      this.rate = 1;
      this.read = this.write = 0;  // sample positions since the start; `read` is fractional
      this.jitter = new JitterBuffer();
      this.level_s = this.jitter.target_s;  // buffer level after the last message
      this.playing = false;
      this.dry_s = -Infinity;  // time at which the buffer ran empty
      this.gaps = 0;
      this.full = false;  // whether samples of the last message did not fit
      this.join = 0;  // weight of new samples, 0 to 1, against the concealment
      this.bridge = 0;  // samples since the buffer ran empty
      this.loud = 0;  // gain of the concealment
      this.port.onmessage = ({ data }) => { data.wire.onmessage = (event) => this.take(event.data); };
    }
    buffered() { return (this.write - this.read) / this.rate; }
    take({ a, rate, count }) {
      if (rate !== this.rate) Object.assign(this, { rate, ring: new Float32Array(Math.ceil(BUFFER_S * rate)), read: 0, write: 0, playing: false, join: 0, loud: 0 });
      const dry_s = this.playing ? 0 : currentTime - this.dry_s, empty = !this.playing && this.read === this.write;
      const room = Math.floor(this.ring.length - (this.write - this.read)), full = a.length > room;
      if (dry_s > BUFFER_S && !full) this.jitter.begin();  // a pause; after a delay, the message would be as long
      else if (empty || (full && !this.full)) this.gaps++;
      this.full = full;
      this.jitter.note(this.buffered() - Math.min(dry_s, BUFFER_S), a.length / rate);
      this.port.postMessage({ count, lead_s: Math.max(this.buffered(), this.playing ? 0 : this.jitter.target_s), gaps: this.gaps });
      for (const v of a.subarray(0, room)) this.ring[this.write++ % this.ring.length] = v;
      this.level_s = this.buffered();
    }
    at(place) {
      const { ring } = this, k = Math.floor(place), part = place - k;
      return (1 - part) * ring[k % ring.length] + part * ring[(k + 1) % ring.length];
    }
    process(_, [[out]]) {
      const buffered_s = this.buffered(), { rate } = this, { target_s } = this.jitter;
      if (!this.playing && buffered_s >= target_s) {
        this.playing = true;
        this.jitter.begin();
      }
      const over_s = Math.max(buffered_s - target_s - SLACK_S, 0) - Math.max(target_s - SLACK_S - this.level_s, 0);
      const each = rate / sampleRate, step = each * (1 + HURRY * Math.min(Math.max(over_s / target_s, -1), 1));
      const span = BRIDGE_S * rate, fade = Math.exp(-1 / (FADE_S * sampleRate));
      for (let i = 0; i < out.length; i++) {
        if (this.playing && this.read + 1 >= this.write) {
          Object.assign(this, { playing: false, dry_s: currentTime, loud: 1, bridge: 0, join: 0, end: this.write - 1, read: this.write });
        }
        let sample = 0;
        if (this.loud > 1e-4) {  // back and forth over the last samples
          const away = this.bridge % (2 * span);
          sample = (1 - this.join) * this.loud * this.at(Math.max(this.end - Math.min(away, 2 * span - away), 0));
          this.bridge += each;
          this.loud *= fade;
        }
        if (this.playing) {
          this.join = Math.min(this.join + 1 / (JOIN_S * sampleRate), 1);
          sample += this.join * this.at(this.read);
          this.read += step;
        }
        out[i] = sample;
      }
      return true;
    }
  }
  registerProcessor("hapscene-audio-monitor", Player);
}

if (typeof registerProcessor !== "undefined") play();
