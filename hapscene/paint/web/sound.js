// What must not wait for the page's drawing: our socket, in a worker, and what is heard, in an audio worklet.
"use strict";
const AHEAD_S = 0.035;  // what waits to be heard: a message comes every 15 ms, and is asked for every 13 ms
const SLACK_S = 0.015, HURRY = 0.08;  // where more waits than that beyond, it is played up to 8 % faster until it is back
const KEPT_S = 0.5;  // the most that waits; of what comes at once after a pause, the rest is left out
const FADE = 0.99;  // a sample where it runs dry: no click

// In the worker: passes on to the page what the server says; accelerations go straight to the ear besides.
function listen() {
  let socket = null, ear = null, count = 0;
  function connect(url) {
    socket = new WebSocket(url);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => postMessage({ open: true });
    socket.onclose = () => { postMessage({ open: false }); setTimeout(connect, 1000, url); };
    socket.onmessage = ({ data }) => {
      if (typeof data === "string") { postMessage({ text: data }); return; }
      const came = { count: ++count, at_ms: performance.timeOrigin + performance.now() };
      if (ear && new Float32Array(data, 0, 1)[0] === 1) {
        const [, tick_s, n, block] = new Float32Array(data, 0, 4);
        ear.postMessage({ a: new Float32Array(data, 16 + 4 * n, n * block), rate: block / tick_s, count });
      }
      postMessage({ buffer: data, came }, [data]);
    };
  }
  onmessage = ({ data }) => {
    if (data.url) connect(data.url);
    else if (data.ear) ear = data.ear;
    else if (socket && socket.readyState === 1) socket.send(data.text);
  };
}

// In the worklet: plays samples as they come. Tells the page, of each message, how long it waits, and what gaps there were.
function play() {
  class Player extends AudioWorkletProcessor {
    constructor() {
      super();
      this.ring = new Float32Array(0);
      this.rate = 1;
      this.read = this.write = 0;  // samples since ever; `read` is between two of them
      this.playing = false;
      this.dry_s = -Infinity;
      this.gaps = 0;
      this.last = 0;
      this.port.onmessage = ({ data }) => { data.wire.onmessage = (event) => this.take(event.data); };
    }
    take({ a, rate, count }) {
      if (rate !== this.rate) Object.assign(this, { rate, ring: new Float32Array(Math.ceil(KEPT_S * rate)), read: 0, write: 0, playing: false });
      if (!this.playing && this.read === this.write && currentTime - this.dry_s < KEPT_S) this.gaps++;
      this.port.postMessage({ count, lead_s: this.lead(), gaps: this.gaps });
      const room = Math.floor(this.ring.length - (this.write - this.read));
      for (const v of a.subarray(0, room)) this.ring[this.write++ % this.ring.length] = v;
    }
    lead() { return Math.max((this.write - this.read) / this.rate, this.playing ? 0 : AHEAD_S); }
    process(_, [[out]]) {
      const waits_s = (this.write - this.read) / this.rate;
      this.playing ||= waits_s >= AHEAD_S;
      const hurry = HURRY * Math.min(Math.max((waits_s - AHEAD_S - SLACK_S) / AHEAD_S, 0), 1);
      const step = (this.rate / sampleRate) * (1 + hurry), { ring } = this;
      for (let i = 0; i < out.length; i++) {
        if (this.playing && this.read + 1 >= this.write) {
          this.playing = false;
          this.read = this.write;
          this.dry_s = currentTime;
        }
        if (this.playing) {
          const k = Math.floor(this.read), part = this.read - k;
          this.last = (1 - part) * ring[k % ring.length] + part * ring[(k + 1) % ring.length];
          this.read += step;
        } else this.last *= FADE;
        out[i] = this.last;
      }
      return true;
    }
  }
  registerProcessor("hapscene-sound", Player);
}

typeof registerProcessor === "undefined" ? listen() : play();
