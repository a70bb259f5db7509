// The part of the page that viser has not: pointer and keys on the canvas, the tools over it, traces, spectrum and sound.
// Speaks JSON with the server (`socket.py`); numbers come as little-endian float32, kind first.
import { newCursor } from "/hapscene-cursor.js";
import { newKeyList } from "/hapscene-keys.js";
import { showOutline } from "/hapscene-outline.js";
import { newTrace } from "/hapscene-plot.js";
import { Wait } from "/hapscene-ear.js";
import { mend, sheetHeight, tellTips } from "/hapscene-viser.js";

const TOOLS = [
  ["brush", "Brush", "1", "Shift-drag paints the swatch on the surface"],
  ["fill", "Fill", "2", "Shift-click fills a facet, a body or a material"],
  ["box", "Box", "3", "Shift-drag from corner to corner; what is inside is painted"],
  ["sphere", "Sphere", "4", "Shift-drag from the middle outward; what is inside is painted"],
  ["eraser", "Eraser", "5", "Shift-drag brings back what the body was made of"],
  ["pick", "Pick", "6", "Shift-click takes the swatch that is painted there"],
  ["lasso", "Lasso", "8", "Shift-drag around what is seen; all inside is painted"],
  ["polygon", "Polygon", "9", "Shift-click the corners; Enter paints what is seen inside"],
  ["touch", "Touch", "7", "Hold Shift and drag: a simulated hand strokes the surface"],
];
const VIEWS = ["front", "back", "left", "right", "top", "bottom", "perspective"];  // Shift 1 to 7
const LOST = "The connection to the painter is lost; nothing that you painted is. If it does not come back in some seconds, start the painter again in the terminal and open the address that it prints.";
const FINGERS = matchMedia("(pointer: coarse)").matches;  // and no Shift
const HINT = [
  "Choose a swatch at the right; ▶ plays how it sounds.",
  FINGERS ? "Tap <b>Lock Shift</b> and drag on the surface to paint; tap it again to turn the view." :
    "Hold <b>Shift</b> and drag on the surface to paint. Drag alone turns the view; the wheel zooms.",
  "Press <b>7</b> to touch: hold Shift and drag, feel and hear it. <b>Ctrl S</b> saves.",
];
const HOVER_MS = 40, LATE_S = 0.1, HURRY = 0.08, SLOW_COUNT = 3;
const make = (tag, attributes = {}, ...inside) => {
  const node = Object.assign(document.createElement(tag), attributes);
  node.append(...inside);
  return node;
};
let state = {}, held = null, lock = false, lastHover = 0, waiting = null, over = null, lost = false;

// --- the server ---

const link = new Worker("/hapscene-sound.js");  // has the socket: what is heard must not wait for what is drawn
const send = (message) => link.postMessage({ text: JSON.stringify(message) });
link.onmessage = ({ data }) => {
  if (data.text !== undefined) hear(JSON.parse(data.text));
  else if (data.buffer) take(data.buffer, data.came);
  else if (data.open) greet();
  else { lost = true; say(LOST, "error", Infinity); }
};
function greet() {
  if (lost) say("Connected again.");
  lost = false;
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
  press(event);
  try { canvas().setPointerCapture(event.pointerId); } catch (_) { /* a pointer of a script */ }
}, true);
function press(event) {
  sound.wake();
  held = { id: event.pointerId, place: place(event) };
  send({ do: "down", ...held.place });
}
function draw(event) {
  held.place = place(event);
  if (waiting === null) waiting = requestAnimationFrame(flush);
}
function hover(event) {
  if (performance.now() - lastHover <= HOVER_MS) return;
  lastHover = performance.now();
  send({ do: "hover", ...place(event) });
}
window.addEventListener("pointermove", (event) => {
  over = onCanvas(event) ? event : null;
  if (held && event.pointerId === held.id) { mine(event); draw(event); }
  else if (!event.buttons && over) hover(event);
}, true);
function release(how, event) {
  if (waiting !== null) { cancelAnimationFrame(waiting); waiting = null; }
  send({ do: how, ...(event && place(event)) });
  held = null;
}
const lift = (event) => {
  if (!held || event.pointerId !== held.id) return;
  mine(event);
  release(event.type === "pointerup" ? "up" : "leave", event);
};
window.addEventListener("pointerup", lift, true);
window.addEventListener("pointercancel", lift, true);
window.addEventListener("blur", () => { if (held) release("leave"); });
const asked = () => document.querySelector(".mantine-Modal-content") !== null;  // a question stands, and comes first
window.addEventListener("keydown", (event) => {
  const typing = /^(INPUT|TEXTAREA|SELECT)$/.test(event.target.tagName || "") && event.target.type !== "range";
  const order = event.ctrlKey || event.metaKey;
  const key = event.key.toLowerCase();
  if (keyList.open) { if (key === "?") { mine(event); keyList.close(); } return; }
  if (order && key === "s") { mine(event); if (!asked()) { event.target.blur(); send({ do: "save" }); } }
  else if (key === "escape" && asked()) { mine(event); send({ do: "dismiss" }); }
  else if (typing) {
    const field = event.target;
    if (key === "enter" || key === "escape") setTimeout(() => field.blur(), 0);
  } else if (asked()) return;
  else if (event.altKey) return;
  else if (order && key === "z") { mine(event); send({ do: event.shiftKey ? "redo" : "undo" }); }
  else if (order && key === "y") { mine(event); send({ do: "redo" }); }
  else if (order) return;
  else if (cursor.take(event)) mine(event);
  else if (key === "escape" && state.outline && !held) { mine(event); send({ do: "leave" }); }
  else if (key === "escape") release("cancel");
  else if (event.shiftKey && /^Digit[1-7]$/.test(event.code)) { mine(event); look(VIEWS[event.code[5] - 1]); }
  else if (key === "home") { mine(event); look("perspective"); }
  else if (key === "f") { mine(event); look("", over); }
  else if (key === "k") { mine(event); cursor.node.focus(); }
  else if (key === "p") { mine(event); showPlots(plots.hidden); }
  else if (key === "[" || key === "]") { mine(event); send({ do: "size", factor: key === "[" ? 0.8 : 1.25 }); }
  else if (key === "i") { mine(event); send({ do: "sample", client: client() }); }
  else if (key === "enter" && state.outline) { mine(event); send({ do: "close" }); }
  else if (key === "l") { mine(event); setLock(!lock); }
  else if (key === "?") { mine(event); keyList.showModal(); }
  else if (key === "h") { mine(event); hint.hidden = !hint.hidden; }
  else { const tool = TOOLS.find((t) => t[2] === key); if (tool) { mine(event); send({ do: "tool", name: tool[0] }); } }
}, true);

document.body.addEventListener("keydown", (event) => {  // keys that move a slider turn no view
  if (event.target.closest("[role=slider], [role=tab], dialog")) event.stopPropagation();
});
function look(name, event) {  // at the body under the pointer, or at all; where there is none, or another view is asked for
  const box = canvas().getBoundingClientRect();
  send({ do: "view", name, ...place(event ?? { clientX: box.left - box.width, clientY: box.top }) });
}

// --- what is over the canvas ---

const root = make("main", { id: "hs", ariaLabel: "Painter" });
const bar = make("div", { id: "hs-bar", role: "toolbar", ariaLabel: "Tools" });
const tipped = (node, tip) => { node.dataset.tip = tip; return node; };
const button = (text, key, tip, act, into = bar) => {
  const node = tipped(make("button", { type: "button", onclick: (event) => { act(); if (event.detail) node.blur(); } }, text), tip);
  if (key) node.append(make("kbd", {}, key));
  into.append(node);
  return node;
};
const gap = () => bar.append(make("span", { className: "gap" }));
const tools = new Map(TOOLS.map(([name, text, key, title]) => [name, button(text, key, title, () => send({ do: "tool", name }))]));
const ink = make("span", { id: "hs-ink" });
bar.append(ink);
gap();
const lockButton = button("Lock Shift", "L", "Plain drags use the tool, and Shift with a drag turns the view", () => setLock(!lock));
gap();
const undo = button("Undo", "Ctrl Z", "", () => send({ do: "undo" }));
const redo = button("Redo", "Ctrl Y", "", () => send({ do: "redo" }));
undo.dataset.brief = "↶";
redo.dataset.brief = "↷";
const save = button("Save", "Ctrl S", "", () => send({ do: "save" }));
const saved = make("output", { id: "hs-saved" });
bar.append(saved);
gap();
const viewButton = button("View", "", "Views from all sides: show or hide their buttons", () => showViews(views.hidden));
const keyList = newKeyList(make);
button("Keys", "?", "All keys: ?", () => keyList.showModal()).dataset.brief = "?";
const views = make("div", { id: "hs-views", role: "toolbar", ariaLabel: "Views" });
button("Home", "Home", "See all, as at first", () => look("perspective"), views);
button("Frame", "F", "The chosen body, or all, from here; the key F also frames the body under the pointer", () => look(""), views);
VIEWS.forEach((name, i) => button(name[0].toUpperCase() + name.slice(1), `⇧${i + 1}`, `See all: ${name}, Shift + ${i + 1}`, () => look(name), views));
const hint = make("div", { id: "hs-hint" });
HINT.forEach((line, i) => hint.append(make("p", { innerHTML: `<b>${i + 1}</b>${line.replace(/<b>/g, "<kbd>").replace(/<\/b>/g, "</kbd>")}` })));
hint.append(tipped(make("button", { type: "button", ariaLabel: "Hide the hint", onclick: () => { hint.hidden = true; } }, "×"), "Hide the hint; H shows it again"));
const toast = make("div", { id: "hs-say", role: "status" });
const monitor = make("div", { id: "hs-monitor" });
const line = make("div", { id: "hs-line" });
const word = make("output", {}, "…"), tip = make("span", { id: "hs-tip" });
const soundButton = tipped(make("button", { type: "button", onclick: () => sound.toggle() }), "Hear what the hand feels, its acceleration");
const volume = tipped(make("input", { type: "range", min: -30, max: 20, value: 0, oninput: () => sound.turn() }), "Loudness [dB]");
const level = make("span", {}, "");
const plots = make("div", { id: "hs-plots", hidden: true });
line.append(word, tip, soundButton, make("label", {}, "loudness", volume, level));
const plotButton = button("Plots", "P", "Force, acceleration and spectrum of what the hand feels", () => showPlots(plots.hidden), line);
const trace = newTrace(plots);
monitor.append(line, plots);
const cursor = newCursor({
  canvas, begin: press, move: (event) => (held ? draw(event) : hover(event)), end: (event) => { if (held) release("up", event); },
});
root.append(bar, make("div", { id: "hs-space" }, hint, views), toast, monitor, cursor.node);
const tellTip = tellTips(tip, () => state.hints ?? {});
const outline = showOutline(canvas, client);
let toastTimer = null;
function say(text, kind, for_ms = kind === "error" ? 9000 : 4000) {
  toast.textContent = text;
  toast.className = kind || "";
  clearTimeout(toastTimer);
  if (for_ms < Infinity) toastTimer = setTimeout(() => { toast.textContent = ""; }, for_ms);
}
const unfold = (node, from, open) => { node.hidden = !open; from.setAttribute("aria-expanded", String(open)); };
function showPlots(open) { unfold(plots, plotButton, open); trace.fresh = true; }
function showViews(open) { unfold(views, viewButton, open); }
function setLock(on) {
  lock = on;
  lockButton.setAttribute("aria-pressed", String(on));
  say(on ? "Plain drags use the tool now; Shift and drag turns the view." : "Hold Shift to use the tool; plain drags turn the view.");
}
function show() {
  for (const [name, node] of tools) node.setAttribute("aria-pressed", String(name === state.tool));
  ink.textContent = state.swatch || "";
  ink.dataset.tip = `The swatch that is painted with: ${state.swatch}`;
  ink.style.setProperty("--chip", state.colour || "transparent");
  undo.disabled = !state.undo;
  redo.disabled = !state.redo;
  undo.dataset.tip = state.undo ? `Undo: ${state.undo}` : "Nothing to undo";
  redo.dataset.tip = state.redo ? `Redo: ${state.redo}` : "Nothing to redo";
  save.classList.toggle("due", !!state.dirty);
  save.dataset.tip = state.dirty ? `Save ${state.title}` : `Everything is saved in ${state.title}`;
  saved.textContent = state.dirty ? "Not saved" : "Saved";
  if (state.undo && !show.undone) { show.undone = true; hint.hidden = true; }  // it has been understood
  document.title = `${state.dirty ? "• " : ""}${state.title} – hapscene paint`;
  word.textContent = state.word || "";
  outline(state.outline);
  const c = canvas();
  if (c) c.style.cursor = state.tool === "touch" ? "crosshair" : "";
}
function fit() {
  const c = canvas();
  if (!c) return;
  const sheet_px = sheetHeight(), box = c.getBoundingClientRect();
  const settled = box.bottom <= innerHeight - sheet_px + 1;
  if (!fit.told && settled && state.tool && box.width && client() >= 0) { fit.told = true; send({ do: "frame", client: client(), w: box.width, h: box.height }); }
  if (box.width !== fit.width) { fit.width = box.width; trace.fresh = true; }
  Object.assign(root.style, { left: `${box.left}px`, top: `${box.top}px`, width: `${box.width}px`, height: `${box.height}px` });
}

// --- sound: buffers one after the other, at the channel's own rate ---

const sound = {
  on: true, context: null, gain: null, ear: null, next: 0, gaps: 0, heard: 0, peak: 0, full: 20, slow: [], quiet_ms: 0, wait: new Wait(),
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
  toggle() { this.on = !this.on; this.wake(); this.turn(); this.label(); },
  label() { soundButton.textContent = this.on ? "Sound: on" : "Sound: off"; soundButton.setAttribute("aria-pressed", String(this.on)); },
  async hear() {
    await this.context.audioWorklet.addModule("/hapscene-ear.js");
    const { port1, port2 } = new MessageChannel();
    this.ear = new AudioWorkletNode(this.context, "hapscene-sound", { numberOfInputs: 0 });
    this.ear.port.onmessage = ({ data }) => this.told(data);
    this.ear.port.postMessage({ wire: port1 }, [port1]);
    link.postMessage({ ear: port2 }, [port2]);
    this.ear.connect(this.gain);
  },
  told({ gaps }) {
    const now_ms = performance.now();
    for (; this.gaps < gaps; this.gaps++) this.slow.push(now_ms);
    this.slow = this.slow.filter((at_ms) => now_ms - at_ms < 60e3);
    if (this.slow.length < SLOW_COUNT || now_ms < this.quiet_ms) return;
    this.quiet_ms = now_ms + 60e3;
    say(`This computer is too busy for sound without gaps: ${this.slow.length} in the last minute. Close what else runs on it.`);
  },
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
    const now = this.context.currentTime, late_s = now - this.next, dry = late_s > 0 && late_s < 5 * LATE_S;
    if (late_s >= 5 * LATE_S) this.wait.begin();
    this.wait.note(-late_s, a.length / rate);
    const { ahead_s } = this.wait;
    if (late_s > 0) { this.next = now + ahead_s; this.wait.begin(); }  // at first, and where it ran dry
    const over_s = this.next - now - ahead_s;  // what came at once after a pause waits: hurry, or it stays late for good
    this.told({ count, lead_s: this.next - now, gaps: this.gaps + dry });
    if (over_s > LATE_S) return;
    const speed = 1 + HURRY * Math.min(Math.max(over_s / ahead_s, -1), 1);
    this.play(a, rate, this.next, speed);
    this.next += a.length / rate / speed;
  },
  once(a, rate) { this.wake(); if (!this.on) say("The sound is off: switch it on below."); if (this.on && this.context) this.play(a, rate, this.context.currentTime + 0.02); },
};

// --- go ---

function askFirst() {  // or what is typed goes into a field behind the question
  const field = document.activeElement;
  if (asked() && field.matches("input, textarea") && !field.closest(".mantine-Modal-content")) field.blur();
}

window.addEventListener("pointerdown", () => sound.wake());
function start() {
  document.body.append(root, keyList);
  hint.hidden = innerWidth < 760;
  showViews(innerWidth >= 1200 && innerHeight >= 640);
  showPlots(false);
  sound.label();
  sound.turn();
  fit();
  const home = location.href.split(/[?#]/)[0].replace(/\/*$/, "/");
  link.postMessage({ url: `${home.replace(/^http/, "ws")}hapscene` });
  localStorage.setItem("hapscene", new URL(home).pathname);  // for a reload and other tabs: see server.py
  const hide = setInterval(() => {  // the token, once viser has taken its own address from it
    if (client() < 0) return;
    clearInterval(hide);
    history.replaceState(null, "", "/");
  }, 100);
  new ResizeObserver(fit).observe(document.body);
  let due = false;
  new MutationObserver(() => {
    askFirst();
    if (!due) requestAnimationFrame(() => { due = false; mend(say); fit(); tellTip(); });
    due = true;
  }).observe(document.body, { childList: true, subtree: true });
  new MutationObserver(() => { trace.fresh = true; }).observe(document.documentElement, { attributes: true });
  setInterval(fit, 300);
  (function frame() { trace.draw(); requestAnimationFrame(frame); })();
}
start();
window.hapscene = { get state() { return state; }, sound, trace, client, send };
