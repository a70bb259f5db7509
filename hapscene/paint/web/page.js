// The part of the page that viser has not: pointer and keys on the canvas, the tools over it, traces, spectrum and sound.
// Speaks JSON with the server (`hapscene/paint/live.py`); numbers come as little-endian float32, kind first.
import { typeNumbers } from "/hapscene-number.js";
import { newTrace } from "/hapscene-plot.js";

const TOOLS = [
  ["brush", "Brush", "1", "Shift-drag paints the swatch on the surface"],
  ["fill", "Fill", "2", "Shift-click fills a facet, a body or a material"],
  ["box", "Box", "3", "Shift-drag from corner to corner; what is inside is painted"],
  ["sphere", "Sphere", "4", "Shift-drag from the middle outward; what is inside is painted"],
  ["eraser", "Eraser", "5", "Shift-drag brings back what the body was made of"],
  ["pick", "Pick", "6", "Shift-click takes the swatch that is painted there"],
  ["touch", "Touch", "7", "Hold Shift and drag: a simulated hand strokes the surface"],
];
const HINT = [
  "Choose a swatch at the right; ▶ plays how it sounds.",
  "Hold <b>Shift</b> and drag on the surface to paint. Drag alone turns the view; the wheel zooms.",
  "Press <b>7</b> to touch: hold Shift and drag, feel and hear it. <b>Ctrl S</b> saves.",
];
const HOVER_MS = 40, AHEAD_S = 0.04, LATE_S = 0.1, HURRY = 0.08;
const make = (tag, attributes = {}, ...inside) => {
  const node = Object.assign(document.createElement(tag), attributes);
  node.append(...inside);
  return node;
};
let state = {}, held = null, lock = false, lastHover = 0, waiting = null;

// --- the server ---

const link = new Worker("/hapscene-sound.js");  // has the socket: what is heard must not wait for what is drawn
const send = (message) => link.postMessage({ text: JSON.stringify(message) });
link.onmessage = ({ data }) => {
  if (data.text !== undefined) hear(JSON.parse(data.text));
  else if (data.buffer) take(data.buffer, data.came);
  else if (data.open) greet();
  else say("The connection is lost; nothing is: it is tried again.", "error");
};
function greet() {
  send({ do: "listen", on: sound.on });
  send({ do: "look", dark: matchMedia("(prefers-color-scheme: dark)").matches });
}
function hear(message) {
  if (message.state) { state = message.state; show(); }
  if (message.say !== undefined) say(message.say, message.kind);
}
function take(buffer, came) {
  const kind = new Float32Array(buffer, 0, 1)[0];
  if (kind === 1) {
    const [, tick_s, n, block] = new Float32Array(buffer, 0, 4);
    const force = new Float32Array(buffer, 16, n), a = new Float32Array(buffer, 16 + 4 * n, n * block);
    trace.add(force, a, tick_s, block, came);
    if (sound.ear) sound.note(a);
    else sound.stream(a, block / tick_s, came);
  } else if (kind === 2) {
    const [, rate] = new Float32Array(buffer, 0, 2);
    const a = new Float32Array(buffer, 8);
    trace.show(a, rate);
    sound.once(a, rate);
  }
}

// --- pointer and keys: what the tool gets, the camera does not ---

const canvas = () => document.querySelector("canvas[data-engine]") || document.querySelector("canvas");
const client = () => { const tag = document.getElementById("hs-client"); return tag ? Number(tag.dataset.id) : -1; };
function place(event) {
  const box = canvas().getBoundingClientRect();
  return { x: (event.clientX - box.left) / box.width, y: (event.clientY - box.top) / box.height, w: box.width, h: box.height, client: client() };
}
const onCanvas = (event) => { const c = canvas(); return c && (event.target === c || c.parentElement.contains(event.target)); };
const mine = (event) => { event.stopImmediatePropagation(); event.preventDefault(); };
function flush() { waiting = null; if (held) { send({ do: "move", ...held.place }); } }
window.addEventListener("pointerdown", (event) => {
  if (event.button !== 0 || !onCanvas(event) || event.ctrlKey || event.metaKey) return;
  if (event.shiftKey === lock) {  // turns the view, as viser does without Shift
    Object.defineProperty(event, "shiftKey", { value: false });
    return;
  }
  mine(event);
  if (document.activeElement && document.activeElement !== document.body) document.activeElement.blur();
  sound.wake();
  held = { id: event.pointerId, place: place(event) };
  try { canvas().setPointerCapture(event.pointerId); } catch (_) { /* a pointer of a script */ }
  send({ do: "down", ...held.place });
}, true);
window.addEventListener("pointermove", (event) => {
  if (held && event.pointerId === held.id) {
    mine(event);
    held.place = place(event);
    if (waiting === null) waiting = requestAnimationFrame(flush);
  } else if (!event.buttons && onCanvas(event) && performance.now() - lastHover > HOVER_MS) {
    lastHover = performance.now();
    send({ do: "hover", ...place(event) });
  }
}, true);
const lift = (event) => {
  if (!held || event.pointerId !== held.id) return;
  mine(event);
  if (waiting !== null) { cancelAnimationFrame(waiting); waiting = null; }
  send({ do: event.type === "pointerup" ? "up" : "leave", ...place(event) });
  held = null;
};
window.addEventListener("pointerup", lift, true);
window.addEventListener("pointercancel", lift, true);
window.addEventListener("blur", () => { if (held) { send({ do: "leave" }); held = null; } });
const asked = () => document.querySelector(".mantine-Modal-content") !== null;  // a question stands, and comes first
window.addEventListener("keydown", (event) => {
  const typing = /^(INPUT|TEXTAREA|SELECT)$/.test(event.target.tagName || "") && event.target.type !== "range";
  const order = event.ctrlKey || event.metaKey;
  const key = event.key.toLowerCase();
  if (order && key === "s") { mine(event); if (!asked()) { event.target.blur(); send({ do: "save" }); } }
  else if (typing) {
    const field = event.target;
    if (key === "enter" || key === "escape") setTimeout(() => field.blur(), 0);
  } else if (asked()) return;
  else if (event.altKey) return;
  else if (order && key === "z") { mine(event); send({ do: event.shiftKey ? "redo" : "undo" }); }
  else if (order && key === "y") { mine(event); send({ do: "redo" }); }
  else if (order) return;
  else if (key === "[" || key === "]") { mine(event); send({ do: "size", factor: key === "[" ? 0.8 : 1.25 }); }
  else if (key === "l") { mine(event); setLock(!lock); }
  else if (key === "?" || key === "h") { mine(event); hint.hidden = !hint.hidden; }
  else { const tool = TOOLS.find((t) => t[2] === key); if (tool) { mine(event); send({ do: "tool", name: tool[0] }); } }
}, true);

// --- what is over the canvas ---

const root = make("div", { id: "hs" });
const bar = make("div", { id: "hs-bar" });
const button = (text, key, title, act) => {
  const node = make("button", { type: "button", title, onclick: () => { act(); node.blur(); } }, text);
  if (key) node.append(make("kbd", {}, key));
  bar.append(node);
  return node;
};
const gap = () => bar.append(make("span", { className: "gap" }));
const tools = new Map(TOOLS.map(([name, text, key, title]) => [name, button(text, key, title, () => send({ do: "tool", name }))]));
const ink = make("span", { id: "hs-ink", title: "The swatch that is painted with" });
bar.append(ink);
gap();
const lockButton = button("Lock Shift", "L", "Plain drags use the tool, and Shift with a drag turns the view", () => setLock(!lock));
gap();
const undo = button("Undo", "Ctrl Z", "", () => send({ do: "undo" }));
const redo = button("Redo", "Ctrl Y", "", () => send({ do: "redo" }));
const save = button("Save", "Ctrl S", "", () => send({ do: "save" }));
button("?", "", "Show or hide the hint (H)", () => { hint.hidden = !hint.hidden; });
const hint = make("div", { id: "hs-hint" });
HINT.forEach((line, i) => hint.append(make("p", { innerHTML: `<b>${i + 1}</b>${line.replace(/<b>/g, "<kbd>").replace(/<\/b>/g, "</kbd>")}` })));
hint.append(make("button", { type: "button", title: "Hide", onclick: () => { hint.hidden = true; } }, "×"));
const toast = make("div", { id: "hs-say", role: "status" });
const monitor = make("div", { id: "hs-monitor" });
const line = make("div", { id: "hs-line" });
const word = make("output", {}, "…");
const soundButton = make("button", { type: "button", title: "Hear the acceleration", onclick: () => sound.toggle() });
const volume = make("input", { type: "range", min: -30, max: 20, value: 0, title: "Loudness [dB]", oninput: () => sound.turn() });
const level = make("span", {}, "");
line.append(word, soundButton, make("label", {}, "loudness", volume, level));
const plots = make("div", { id: "hs-plots" });
const trace = newTrace(plots);
monitor.append(line, plots);
root.append(bar, hint, make("div", { id: "hs-space" }), toast, monitor);
let toastTimer = null;
function say(text, kind) {
  toast.textContent = text;
  toast.className = kind || "";
  clearTimeout(toastTimer);
  toastTimer = setTimeout(() => { toast.textContent = ""; }, kind === "error" ? 9000 : 4000);
}
function setLock(on) {
  lock = on;
  lockButton.setAttribute("aria-pressed", String(on));
  say(on ? "Plain drags use the tool now; Shift and drag turns the view." : "Hold Shift to use the tool; plain drags turn the view.");
}
function show() {
  for (const [name, node] of tools) node.setAttribute("aria-pressed", String(name === state.tool));
  ink.textContent = state.swatch || "";
  ink.style.setProperty("--chip", state.colour || "transparent");
  undo.disabled = !state.undo;
  redo.disabled = !state.redo;
  undo.title = state.undo ? `Undo: ${state.undo}` : "Nothing to undo";
  redo.title = state.redo ? `Redo: ${state.redo}` : "Nothing to redo";
  save.classList.toggle("due", !!state.dirty);
  save.title = state.dirty ? `Not saved yet: ${state.title}` : "Everything is saved";
  document.title = `${state.dirty ? "• " : ""}${state.title} – hapscene paint`;
  word.textContent = state.word || "";
  const c = canvas();
  if (c) c.style.cursor = state.tool === "touch" ? "crosshair" : "";
}
function fit() {
  const c = canvas();
  if (!c) return;
  const box = c.getBoundingClientRect();
  if (!fit.told && state.tool && box.width && client() >= 0) { fit.told = true; send({ do: "frame", client: client(), w: box.width, h: box.height }); }
  if (box.width !== fit.width) { fit.width = box.width; trace.fresh = true; }
  Object.assign(root.style, { left: `${box.left}px`, top: `${box.top}px`, width: `${box.width}px`, height: `${box.height}px` });
}

// --- sound: buffers one after the other, at the channel's own rate ---

const sound = {
  on: true, context: null, gain: null, ear: null, next: 0, gaps: 0, heard: 0, peak: 0, full: 20,
  wake() {
    if (!this.on || this.context) { if (this.on && this.context.state === "suspended") this.context.resume(); return; }
    const Context = window.AudioContext || window.webkitAudioContext;
    if (!Context) return;
    this.context = new Context({ sampleRate: 10000, latencyHint: "interactive" });
    this.gain = this.context.createGain();
    const press = this.context.createDynamicsCompressor();
    this.gain.connect(press).connect(this.context.destination);
    if (this.context.audioWorklet) this.hear();  // by http from another machine there is none
    this.turn();
  },
  turn() {
    level.textContent = `${volume.value > 0 ? "+" : ""}${volume.value} dB`;
    if (this.gain) this.gain.gain.value = (this.on ? 1 : 0) * (10 ** (volume.value / 20) / this.full);
  },
  toggle() { this.on = !this.on; this.wake(); this.turn(); this.label(); send({ do: "listen", on: this.on }); },
  label() { soundButton.textContent = this.on ? "Sound: on" : "Sound: off"; soundButton.setAttribute("aria-pressed", String(this.on)); },
  async hear() {
    await this.context.audioWorklet.addModule("/hapscene-sound.js");
    const { port1, port2 } = new MessageChannel();
    this.ear = new AudioWorkletNode(this.context, "hapscene-sound", { numberOfInputs: 0 });
    this.ear.port.onmessage = ({ data }) => this.told(data);
    this.ear.port.postMessage({ wire: port1 }, [port1]);
    link.postMessage({ ear: port2 }, [port2]);
    this.ear.connect(this.gain);
  },
  told({ gaps }) { this.gaps = gaps; },
  note(a) {
    this.heard += a.length;
    for (const v of a) if (Math.abs(v) > this.peak) this.peak = Math.abs(v);
  },
  play(a, rate, at, speed = 1) {
    const buffer = this.context.createBuffer(1, a.length, rate);
    buffer.copyToChannel(a, 0);
    const source = this.context.createBufferSource();
    source.buffer = buffer;
    source.playbackRate.value = speed;
    source.connect(this.gain);
    source.start(at);
    this.note(a);
  },
  stream(a, rate, { count }) {
    if (!this.on || !this.context || this.context.state !== "running" || !a.length) return;
    const now = this.context.currentTime;
    if (this.next < now && now < this.next + 5 * LATE_S) this.gaps++;
    if (this.next < now) this.next = now + AHEAD_S;  // at first, and where it ran dry
    const over_s = this.next - now - AHEAD_S;  // what came at once after a pause waits: hurry, or it stays late for good
    this.told({ count, lead_s: this.next - now, gaps: this.gaps });
    if (over_s > LATE_S) return;
    const speed = 1 + HURRY * Math.min(Math.max(over_s / AHEAD_S, 0), 1);
    this.play(a, rate, this.next, speed);
    this.next += a.length / rate / speed;
  },
  once(a, rate) { this.wake(); if (!this.on) say("The sound is off: switch it on below."); if (this.on && this.context) this.play(a, rate, this.context.currentTime + 0.02); },
};

// --- go ---

function hushViser() {  // its notice of software GL lies on the picture; the page is made for that
  for (const note of document.querySelectorAll(".mantine-Notification-root"))
    if (note.textContent.startsWith("Software WebGL")) note.style.display = "none";
}
function askFirst() {  // or what is typed goes into a field behind the question
  const field = document.activeElement;
  if (asked() && field.matches("input, textarea") && !field.closest(".mantine-Modal-content")) field.blur();
}

window.addEventListener("pointerdown", () => sound.wake());
typeNumbers({ send, say, client });
function start() {
  document.body.append(root);
  sound.label();
  sound.turn();
  fit();
  const home = location.href.split(/[?#]/)[0].replace(/\/*$/, "/");
  link.postMessage({ url: `${home.replace(/^http/, "ws")}hapscene` });
  localStorage.setItem("hapscene", new URL(home).pathname);  // for a reload and other tabs: see secure_server.py
  const hide = setInterval(() => {  // the token, once viser has taken its own address from it
    if (client() < 0) return;
    clearInterval(hide);
    history.replaceState(null, "", "/");
  }, 100);
  new ResizeObserver(fit).observe(document.body);
  new MutationObserver(() => { hushViser(); askFirst(); }).observe(document.body, { childList: true, subtree: true });
  new MutationObserver(() => { trace.fresh = true; }).observe(document.documentElement, { attributes: true });
  setInterval(fit, 300);
  (function frame() { trace.draw(); requestAnimationFrame(frame); })();
}
start();
window.hapscene = { get state() { return state; }, sound, trace, client, send };
