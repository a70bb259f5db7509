// Synthesis of touch from a swatch: texture while sliding, a tap at contact. It is the effect `lpc_texture` of the package
// (hapscene/dsp/texture_voice.py), with the same tables, so that a page sounds as a device feels.
//
// The file runs in an audio worklet, in the page where a browser has no worklet, and in node for tests. Units are SI:
// force [N], speed [m/s], acceleration [m/s²].

const RATE_HZ = 10000, BLOCK = 10;  // sample rate of the acceleration, and samples per tick of 1 ms
const TICK_S = BLOCK / RATE_HZ;
const CUTOFF_HZ = 20;  // low-pass filter of force and speed, as in the package
const HOLD_S = 0.04;  // a pointer that reports nothing for so long stands still
const AHEAD_S = 0.05;  // movement that is played late by more than this is shortened
const FIXED = 10, ORDER = 2, WARP = 3, SINGLE = 7, PROCESSES = 9;  // header of a table: see plugins/effects/lpc_texture.py
const GRID = 33;  // nodes of a table along force and along speed
const BOUND_LOG = Math.LN10;  // largest extrapolation of the power, 10 dB

// Random numbers of the standard normal distribution: mulberry32 and the polar method of Marsaglia.
class Noise {
  constructor(seed) { this.state = seed | 0; this.spare = 0; }
  uniform() {
    this.state = (this.state + 0x6d2b79f5) | 0;
    let t = Math.imul(this.state ^ (this.state >>> 15), 1 | this.state);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
  }
  normal() {
    if (this.spare !== 0) { const x = this.spare; this.spare = 0; return x; }
    for (;;) {
      const x = 2 * this.uniform() - 1, y = 2 * this.uniform() - 1, r2 = x * x + y * y;
      if (r2 > 0 && r2 < 1) {
        const scale = Math.sqrt(-2 * Math.log(r2) / r2);
        this.spare = y * scale;
        return x * scale;
      }
    }
  }
}

// Normalised lattice filter, plain or frequency-warped (hapscene/dsp/lattice.py). Its output has the variance 1.
class Lattice {
  constructor(orderMax) {
    for (const name of ["k", "alpha", "c", "g", "s", "e", "beta"]) this[name] = new Float64Array(orderMax + 1);
    this.order = 0;
  }
  // Computes the coefficients from order, allpass coefficient and the reflection coefficients k[1 … order].
  settle(order, warp) {
    const { k, alpha, c, g } = this, mu2 = 1 - warp * warp;
    let share = 1, below = 0, shared = 0, beta = 0;
    alpha[0] = 1;
    for (let m = 1; m <= order; m++) {
      const r = 1 / (1 - k[m] * warp * alpha[m - 1]), cosine2 = (1 - k[m]) * (1 + k[m]);
      c[m] = Math.sqrt(cosine2) * r;
      g[m] = k[m] * r;
      alpha[m] = k[m] - cosine2 * warp * r * alpha[m - 1];
      const into = share * g[m], e = mu2 + warp * warp * beta;  // variance of the output: see `solve_loop`
      below += into * (2 * warp * shared + into * e);
      shared = -c[m] * warp * shared - c[m] * into * e;
      share *= c[m];
      beta = c[m] * c[m] * (mu2 + warp * warp * beta);
    }
    Object.assign(this, { order, warp, mu: Math.sqrt(mu2), scale: 1 / Math.sqrt(share * share + below) });
  }
  // Next sample for white noise of variance 1.
  next(f) {
    const { order, warp, mu, alpha, c, g, s, e, beta } = this;
    for (let m = 1; m <= order; m++) {
      e[m] = mu * s[m] - warp * beta[m - 1];
      beta[m] = c[m] * e[m];
    }
    for (let m = order; m > 0; m--) {
      f = c[m] * f - g[m] * e[m];
      s[m] = mu * (alpha[m - 1] * f + beta[m - 1]) + warp * s[m];
    }
    return this.scale * f;
  }
}

// Power of the texture of a swatch at a force and a speed, interpolated in its table; writes the filter to `k`.
function choose(table, force, speed, k) {
  const row = Math.min(Math.max(force / table[0], 0), 1) * (GRID - 1), column = Math.min(Math.max(speed / table[1], 0), 1) * (GRID - 1);
  const i = Math.min(Math.floor(row), GRID - 2), j = Math.min(Math.floor(column), GRID - 2), u = row - i, v = column - j;
  const order = table[ORDER], first = FIXED + 3 * table[PROCESSES], size = table[SINGLE] ? 1 : 1 + order;
  const at = (table[SINGLE] ? first + order : first) + (i * GRID + j) * size, down = at + GRID * size;
  const mean = (n) => (1 - u) * ((1 - v) * table[at + n] + v * table[at + size + n]) + u * ((1 - v) * table[down + n] + v * table[down + size + n]);
  for (let m = 1; m <= order; m++) k[m] = table[SINGLE] ? table[first + m - 1] : mean(m);
  const log = table[4] * Math.log(Math.max(force / table[0], 1)) + table[5] * Math.log(Math.max(speed / table[1], 1));
  return mean(0) * Math.exp(Math.min(Math.max(log, -BOUND_LOG), BOUND_LOG));
}

// The vibration of one tool that touches one surface at a time.
class Voice {
  // swatches: [{table, gain, depth, norm, tap, listen, knock}]; see hapscene/exchange/html_page.py.
  constructor(swatches, seed = 1) {
    this.swatches = swatches;
    this.noise = new Noise(seed);
    this.lattice = new Lattice(Math.max(1, ...swatches.map(({ table }) => (table.length ? table[ORDER] : 0))));
    this.processes = new Float64Array(8).map(() => this.noise.normal());
    this.swatch = -1;  // in contact; −1 without
    this.level = this.listen = 0;  // at the end of the last tick
    this.force = this.speed = 0;  // filtered
    this.taps = [];  // [{wave, at, gain}]
  }
  // Renders one tick: adds BLOCK samples to out[start …]. `swatch` is −1 without contact.
  tick(out, start, { swatch, force, speed }) {
    const began = this.swatch < 0 && swatch >= 0, now = this.swatches[swatch];
    const share = 1 - Math.exp(-2 * Math.PI * CUTOFF_HZ * TICK_S);
    this.force = began ? force : this.force + share * (force - this.force);
    this.speed = began ? speed : this.speed + share * (speed - this.speed);
    if (began && now.tap.length) this.taps.push({ wave: now.tap, at: 0, gain: now.knock });
    this.swatch = swatch;
    let level = 0;
    if (now?.table.length) {
      const power = choose(now.table, this.force, this.speed, this.lattice.k);
      if (this.settled !== now.table || !now.table[SINGLE]) this.lattice.settle(now.table[ORDER], now.table[WARP]);
      this.settled = now.table;
      level = now.gain * Math.sqrt(power) * this.modulation(now, began) * now.listen;
    }
    if (level > 0 || this.level > 0) {
      const step = (level - this.level) / BLOCK;
      for (let i = 0; i < BLOCK; i++) out[start + i] += (this.level + (i + 1) * step) * this.lattice.next(this.noise.normal());
    }
    this.level = level;
    for (const tap of this.taps) for (let i = 0; i < BLOCK && tap.at < tap.wave.length; i++) out[start + i] += tap.gain * tap.wave[tap.at++];
    this.taps = this.taps.filter((tap) => tap.at < tap.wave.length);
  }
  // Gain of the amplitude modulation: see hapscene/dsp/texture_voice.py.
  modulation({ table, depth, norm }) {
    let log = 0, variance = 0;
    for (let i = 0; i < table[PROCESSES]; i++) {
      const [spread, perSecond, perMetre] = table.subarray(FIXED + 3 * i);
      const rho = Math.exp(-TICK_S * (perSecond + this.speed * perMetre));
      this.processes[i] = rho * this.processes[i] + Math.sqrt((1 - rho) * (1 + rho)) * this.noise.normal();
      log += depth * spread * this.processes[i];
      variance += (depth * spread) ** 2;
    }
    const far = Math.min(2.5 * Math.sqrt(variance), 2);
    return Math.exp(Math.min(Math.max(log, -far), far) - norm);
  }
}

// Band-limited interpolation: a windowed sinc (Blackman), with a row of weights for each position between two samples.
const TAPS = 16, PHASES = 256;
const SINC = new Float32Array(TAPS * PHASES);
for (let p = 0; p < PHASES; p++) {
  let sum = 0;
  const row = SINC.subarray(p * TAPS, (p + 1) * TAPS);
  for (let n = 0; n < TAPS; n++) {
    const x = n - (TAPS / 2 - 1) - p / PHASES, w = Math.PI * x / (TAPS / 2);
    row[n] = (x === 0 ? 1 : Math.sin(Math.PI * x) / (Math.PI * x)) * (0.42 + 0.5 * Math.cos(w) + 0.08 * Math.cos(2 * w));
    sum += row[n];
  }
  for (let n = 0; n < TAPS; n++) row[n] /= sum;
}

// Plays the movement of a pointer at the sample rate of the loudspeaker.
class Player {
  constructor(swatches, rate, seed) {
    this.voice = new Voice(swatches, seed);
    this.queue = [];  // movements that follow: {swatch, force, speed, s} with the duration s [s]
    this.now = { swatch: -1, force: 0, speed: 0, s: 0 };
    this.idle = 0;  // time without a movement [s]
    this.step = RATE_HZ / rate;  // samples of the voice per sample of the loudspeaker
    this.block = new Float64Array(BLOCK);
    this.used = BLOCK;  // samples of the block that have been played
    this.past = new Float64Array(TAPS);  // last samples of the voice
    this.part = 0;  // position between two samples of the voice
    this.peak = 0;
  }
  move(movements) { this.queue.push(...movements); }
  // Renders the next tick.
  tick() {
    const late = this.queue.reduce((sum, { s }) => sum + s, 0) > AHEAD_S;
    let left = late ? 2 * TICK_S : TICK_S;
    while (this.queue.length && left > 0) {
      const next = this.queue[0], used = Math.min(left, next.s), began = this.now.swatch < 0 && next.swatch >= 0;
      this.now = { ...next };
      next.s -= used;
      left -= used;
      this.idle = 0;
      if (next.s <= 1e-9) this.queue.shift();
      if (began || next.swatch < 0) break;  // each contact lasts a tick, so that it is not missed
    }
    if (!this.queue.length && (this.idle += TICK_S) > HOLD_S) this.now.speed = 0;
    this.block.fill(0);
    this.voice.tick(this.block, 0, this.now);
    this.used = 0;
  }
  // Fills `out` by band-limited interpolation, softly limited to ±1.
  fill(out) {
    const { past, step } = this;
    for (let i = 0; i < out.length; i++) {
      for (this.part += step; this.part >= 1; this.part--) {
        if (this.used === BLOCK) this.tick();
        past.copyWithin(0, 1);
        past[TAPS - 1] = this.block[this.used++];
      }
      const row = Math.floor(this.part * PHASES) * TAPS;
      let x = 0;
      for (let n = 0; n < TAPS; n++) x += SINC[row + n] * past[n];
      const size = Math.abs(x), most = size > 0.7 ? 0.7 + 0.3 * Math.tanh((size - 0.7) / 0.3) : size;
      this.peak = Math.max(this.peak * 0.9997, most);
      out[i] = x < 0 ? -most : most;
    }
  }
}

if (typeof registerProcessor !== "undefined")
  registerProcessor("touch", class extends AudioWorkletProcessor {
    constructor({ processorOptions }) {
      super();
      this.player = new Player(processorOptions.swatches, sampleRate, processorOptions.seed);
      this.port.onmessage = ({ data }) => this.player.move(data);
      this.reported = 0;
    }
    process(_, [[out]]) {
      this.player.fill(out);
      if (currentTime - this.reported > 0.03) {
        this.reported = currentTime;
        this.port.postMessage(this.player.peak);
      }
      return true;
    }
  });
