// Plots of force and acceleration over the last seconds, and of the spectrum.
const TRACE_S = 3, SPECTRUM_COUNT = 2048;

export function newTrace(box) {
  const [forcePlot, accelerationPlot, spectrumPlot] = [0, 1, 2].map(() => box.appendChild(document.createElement("canvas")));
  return {
    force: new Float32Array(3000), a: new Float32Array(30000), rate: 10000, tick_s: 0.001, fresh: true,
    add(force, a, tick_s, block) {
      const count = Math.round(TRACE_S / tick_s);
      if (this.force.length !== count || this.a.length !== count * block) {
        this.force = new Float32Array(count); this.a = new Float32Array(count * block);
      }
      this.tick_s = tick_s; this.rate = block / tick_s;
      for (const [ring, more] of [[this.force, force], [this.a, a]]) {
        const n = Math.min(more.length, ring.length);
        ring.copyWithin(0, n);
        ring.set(more.subarray(more.length - n), ring.length - n);
      }
      this.fresh = true;
    },
    show(a, rate) {
      this.a = new Float32Array(Math.round(TRACE_S * rate)); this.rate = rate;
      const n = Math.min(a.length, this.a.length);
      this.a.set(a.subarray(a.length - n), this.a.length - n);
      this.force = new Float32Array(Math.round(TRACE_S / this.tick_s));
      this.fresh = true;
    },
    draw() {
      if (!this.fresh) return;
      this.fresh = false;
      plot(forcePlot, "Force [N]", "--force", this.force, niceTop(this.force, 1), 0, `−${TRACE_S} s`, "now");
      const top = niceTop(this.a, 1);
      plot(accelerationPlot, "Acceleration [m/s²]", "--acceleration", this.a, top, -top, `−${TRACE_S} s`, "now");
      const [level, end_Hz] = this.spectrum();
      plot(spectrumPlot, "Spectrum [dB re 1 mm/s²]", "--spectrum", level, 80, 0, "0 Hz", `${end_Hz} Hz`);
    },
    spectrum() {  // RMS of each bin over the last 0.2 s, Hann window
      const n = SPECTRUM_COUNT, re = new Float32Array(n), im = new Float32Array(n), start = this.a.length - n;
      for (let i = 0; i < n; i++) re[i] = (this.a[start + i] || 0) * (0.5 - 0.5 * Math.cos((2 * Math.PI * i) / n));
      fft(re, im);
      const end_Hz = Math.min(1000, this.rate / 2), bins = Math.floor((end_Hz / this.rate) * n), level = new Float32Array(bins);
      for (let k = 1; k < bins; k++) level[k] = 20 * Math.log10((Math.hypot(re[k], im[k]) * 4) / n / Math.SQRT2 / 1e-3 + 1e-9);
      level[0] = level[1];
      return [level, end_Hz];
    },
  };
}
function fft(re, im) {
  const n = re.length;
  for (let i = 1, j = 0; i < n; i++) {
    let bit = n >> 1;
    for (; j & bit; bit >>= 1) j ^= bit;
    j ^= bit;
    if (i < j) { [re[i], re[j]] = [re[j], re[i]]; [im[i], im[j]] = [im[j], im[i]]; }
  }
  for (let size = 2; size <= n; size *= 2) {
    for (let k = 0; k < size / 2; k++) {
      const c = Math.cos((2 * Math.PI * k) / size), s = -Math.sin((2 * Math.PI * k) / size);
      for (let i = k; i < n; i += size) {
        const j = i + size / 2, x = re[j] * c - im[j] * s, y = re[j] * s + im[j] * c;
        re[j] = re[i] - x; im[j] = im[i] - y; re[i] += x; im[i] += y;
      }
    }
  }
}
function niceTop(values, least) {
  let top = least;
  for (const v of values) if (Math.abs(v) > top) top = Math.abs(v);
  const power = 10 ** Math.floor(Math.log10(top));
  return [1, 2, 5, 10].map((m) => m * power).find((m) => m >= top * 0.999) || top;
}
function plot(node, title, colour, values, high, low, first, last) {
  const scale = window.devicePixelRatio || 1, w = Math.round(node.clientWidth * scale), h = Math.round(node.clientHeight * scale);
  if (!w || !h) return;
  if (node.width !== w || node.height !== h) { node.width = w; node.height = h; }
  const g = node.getContext("2d"), style = getComputedStyle(node), left = 34 * scale, top = 22 * scale, bottom = h - 15 * scale;
  g.clearRect(0, 0, w, h);
  g.font = `${11 * scale}px ${style.fontFamily}`;
  g.fillStyle = style.getPropertyValue("--ink");
  g.textAlign = "left";
  g.fillText(title, 0, 11 * scale, w);
  g.fillStyle = style.getPropertyValue("--dim");
  g.fillText(first, left, h - 2 * scale);
  g.textAlign = "right";
  g.fillText(last, w, h - 2 * scale);
  const y = (v) => bottom - ((Math.min(Math.max(v, low), high) - low) / (high - low)) * (bottom - top);
  g.strokeStyle = style.getPropertyValue("--line");
  g.lineWidth = scale;
  for (const v of [low, (low + high) / 2, high]) {
    g.fillText(String(+v.toPrecision(3)), left - 4 * scale, y(v) + 4 * scale);
    g.beginPath(); g.moveTo(left, y(v)); g.lineTo(w, y(v)); g.stroke();
  }
  g.strokeStyle = style.getPropertyValue(colour);
  g.lineWidth = 1.2 * scale;
  g.beginPath();
  const columns = Math.max(1, w - left), each = values.length / columns;
  for (let c = 0; c < columns; c++) {  // draws each column from minimum to maximum, so that no peak is lost
    let a = Infinity, b = -Infinity;
    for (let i = Math.floor(c * each); i < Math.max(Math.floor((c + 1) * each), Math.floor(c * each) + 1) && i < values.length; i++) { a = Math.min(a, values[i]); b = Math.max(b, values[i]); }
    if (a > b) continue;
    if (c === 0) g.moveTo(left, y(a)); else g.lineTo(left + c, y(a));
    if (b > a) g.lineTo(left + c, y(b));
  }
  g.stroke();
}
