// Extends viser's page by pointer and key handling, the toolbar, plots and sound.
// Exchanges JSON with the server (socket.py). Binary messages are little-endian float32, with the kind of message first.
import { newCursor } from "/hapscene-cursor.js";
import { newGrain } from "/hapscene-grain.js";
import { newKeyList } from "/hapscene-keys.js";
import { showOutline } from "/hapscene-outline.js";
import { newTrace } from "/hapscene-plot.js";
import { limitSoftwareGl } from "/hapscene-software_gl.js";
import { newStamp } from "/hapscene-stamp.js";
import { JitterBuffer } from "/hapscene-audio_monitor.js";
import { fixPage, sheetHeight, showTips } from "/hapscene-viser.js";

const drawLess = limitSoftwareGl();  // before viser makes its canvas
const TOOLS = [
  ["brush", "Brush", "1", "Paint with the selected swatch: Shift + drag"],
  ["fill", "Fill", "2", "Fill a facet, a body or a material: Shift + click"],
  ["sphere", "Sphere", "3", "Paint inside a sphere: Shift + drag outward from the centre"],
  ["eraser", "Eraser", "4", "Restore the default swatch: Shift + drag"],
  ["pick", "Pick", "5", "Select the swatch under the pointer: Shift + click"],
  ["touch", "Touch", "6", "Stroke the surface with a simulated hand: Shift + drag"],
  ["lasso", "Lasso", "7", "Paint the visible surface inside an outline: Shift + drag"],
];
const VIEWS = ["front", "back", "left", "right", "top", "bottom", "perspective"];  // Shift 1 to 7
const LOST = "Connection lost. Your changes are kept. If the connection is not restored within some seconds, start hapscene paint again and open the address that it prints.";
const TOUCH_SCREEN = matchMedia("(pointer: coarse)").matches;  // has no Shift key
const HINT = TOUCH_SCREEN ? [
  "Tap a swatch; ▶ plays its sound.",
  "Tap <b>Draw</b>, then drag one finger over the surface to paint. Tap it again to rotate the view; pinch to zoom.",
  "Tap <b>Touch</b>, then drag with <b>Draw</b> on to touch the surface.",
] : [
  "Select a swatch on the right; ▶ plays its sound.",
  "Hold <b>Shift</b> and drag on the surface to paint. Drag to rotate the view, scroll to zoom.",
  "Press <b>6</b>, then hold Shift and drag to touch the surface. <b>Ctrl S</b> saves.",
];
const forFingers = (text) => TOUCH_SCREEN ? text.replace("Shift + drag", "Draw on, then drag").replace("Shift + click", "Draw on, then tap") : text;
const DARK = matchMedia("(prefers-color-scheme: dark)");
const themed = { get dark() { const kept = localStorage.getItem("hapscene-dark"); return kept === null ? DARK.matches : kept === "true"; } };
const BUSY = { undo: "Undoing", redo: "Redoing", save: "Saving the scene", down: "Working on the surface", up: "Painting", body: "Changing the bodies", library: "Reading the swatch" };
const BUSY_MS = 300, DRAWN_MS = 150, HOVER_MS = 40, DELAY_MAX_S = 0.1, HURRY = 0.08, GAPS_MAX = 3;
const POINTER = new Set(["hover", "down", "move", "up", "leave"]);
const stamp = newStamp();
const make = (tag, attributes = {}, ...inside) => {
  const node = Object.assign(document.createElement(tag), attributes);
  node.append(...inside);
  return node;
};
let state = {}, pressed = null, lock = false, lastHover = 0, waiting = null, over = null, lost = false;

// --- connection to the server ---

const link = new Worker("/hapscene-socket_worker.js");  // owns the socket, so that sound does not wait for drawing
const busy = new Map();  // timers of messages that the server has not handled yet
const send = (message) => {
  if (!POINTER.has(message.do)) stamp.clear();
  message = { client: client(), ...message };  // the server handles messages of a page once viser has numbered it
  if (BUSY[message.do]) {
    const n = Math.random();
    busy.set(n, setTimeout(() => say(`${BUSY[message.do]} …`, "busy", Infinity), BUSY_MS));
    message = { ...message, n };
  }
  link.postMessage({ text: JSON.stringify(message) });
};
function onDone(n) {
  clearTimeout(busy.get(n));
  busy.delete(n);
  if (!busy.size && !pressed) stamp.clearSoon();
  if (!busy.size && toast.className === "busy") say("");
}
link.onmessage = ({ data }) => {
  if (data.text !== undefined) onMessage(JSON.parse(data.text));
  else if (data.buffer) onSamples(data);
  else if (data.open) onOpen();
  else { lost = true; say(LOST, "error", Infinity); }
};
function onOpen() {
  if (lost) say("Connection restored.");
  lost = false;
  for (const n of [...busy.keys()]) onDone(n);
  introduced = -1;
  introduce();
}
let introduced = -1;  // number under which the server knows this page
function introduce() {  // when the socket is open and viser has numbered this page: the server answers with the state
  if (client() === introduced || client() < 0) return;
  introduced = client();
  history.replaceState(null, "", "/");  // hides the token from the address bar
  if (themed.dark) setTheme(); else send({ do: "hello" });
}
function onMessage(message) {
  if (message.state) { state = message.state; show(); }
  if (message.done !== undefined) onDone(message.done);
  if (message.say !== undefined) say(message.say, message.kind);
}
function onSamples({ buffer, received, played }) {
  const kind = new Float32Array(buffer, 0, 1)[0];
  if (kind === 1) {
    const [, tick_s, n, block] = new Float32Array(buffer, 0, 4);
    const force = new Float32Array(buffer, 24, n), a = new Float32Array(buffer, 24 + 4 * n, n * block);
    trace.add(force, a, tick_s, block);
    if (sound.monitor) sound.note(played);
    else sound.stream(played, block / tick_s, received);
  } else if (kind === 2) {
    const [, rate, start, gain] = new Float32Array(buffer, 0, 4);
    const a = new Float32Array(buffer, 16);
    trace.show(a, rate);
    sound.once(a.map((v, i) => (i < start ? v : gain * v)), rate);
  }
}

// --- pointer and keys: events for the tools are not passed on to viser's camera controls ---

const canvas = () => document.querySelector("canvas[data-engine]") || document.querySelector("canvas");
const client = () => { const tag = document.getElementById("hs-client"); return tag ? Number(tag.dataset.id) : -1; };
function place(event) {
  const box = canvas().getBoundingClientRect();
  return { x: (event.clientX - box.left) / box.width, y: (event.clientY - box.top) / box.height, w: box.width, h: box.height };
}
const onCanvas = (event) => { const c = canvas(); return c && (event.target === c || c.parentElement.contains(event.target)); };
const consume = (event) => { event.stopImmediatePropagation(); event.preventDefault(); };
function flush() { waiting = null; if (pressed) { send({ do: "move", ...pressed.place }); stamp.add(pressed.place, state); } }
window.addEventListener("pointerdown", (event) => {
  if (event.button !== 0 || !onCanvas(event) || event.ctrlKey || event.metaKey) return;
  if (pressed && event.pointerId !== pressed.id) { consume(event); release("cancel"); return; }  // a second finger
  if (event.shiftKey === lock) {  // rotates the view, as viser does without Shift
    Object.defineProperty(event, "shiftKey", { value: false });
    return;
  }
  consume(event);
  if (document.activeElement && document.activeElement !== document.body) document.activeElement.blur();
  press(event);
  try { canvas().setPointerCapture(event.pointerId); } catch (_) { /* a synthetic event */ }
}, true);
function press(event) {
  sound.wake();
  pressed = { id: event.pointerId, place: place(event) };
  send({ do: "down", ...pressed.place });
  stamp.add(pressed.place, state, true);
}
function draw(event) {
  pressed.place = place(event);
  if (waiting === null) waiting = requestAnimationFrame(flush);
}
function hover(event) {
  if (performance.now() - lastHover <= HOVER_MS) return;
  lastHover = performance.now();
  send({ do: "hover", ...place(event) });
}
window.addEventListener("pointermove", (event) => {
  over = onCanvas(event) ? event : null;
  if (pressed && event.pointerId === pressed.id) { consume(event); draw(event); }
  else if (!event.buttons && over) hover(event);
}, true);
function release(how, event) {
  if (waiting !== null) { cancelAnimationFrame(waiting); waiting = null; }
  send({ do: how, ...(event && place(event)) });
  pressed = null;
}
const lift = (event) => {
  if (!pressed || event.pointerId !== pressed.id) return;
  consume(event);
  release(event.type === "pointerup" ? "up" : "leave", event);
};
window.addEventListener("pointerup", lift, true);
window.addEventListener("pointercancel", lift, true);
window.addEventListener("blur", () => { if (pressed) release("leave"); });
const dialogOpen = () => document.querySelector(".mantine-Modal-content") !== null;  // whether a dialog is open
window.addEventListener("keydown", (event) => {
  const typing = /^(INPUT|TEXTAREA|SELECT)$/.test(event.target.tagName || "") && event.target.type !== "range";
  const control = event.ctrlKey || event.metaKey;
  const key = event.key.toLowerCase();
  if (keyList.open) { if (key === "?") { consume(event); keyList.close(); } return; }
  if (control && key === "s") { consume(event); if (!dialogOpen()) { event.target.blur(); send({ do: "save" }); } }
  else if (key === "escape" && dialogOpen()) { consume(event); send({ do: "dismiss" }); }
  else if (typing) {
    const field = event.target;
    if (key === "enter" || key === "escape") setTimeout(() => field.blur(), 0);
  } else if (dialogOpen()) return;
  else if (event.altKey) return;
  else if (control && key === "z") { consume(event); send({ do: event.shiftKey ? "redo" : "undo" }); }
  else if (control && key === "y") { consume(event); send({ do: "redo" }); }
  else if (control) return;
  else if (cursor.take(event)) consume(event);

  else if (key === "escape") release("cancel");
  else if (event.shiftKey && /^Digit[1-7]$/.test(event.code)) { consume(event); look(VIEWS[event.code[5] - 1]); }
  else if (key === "home") { consume(event); look("perspective"); }
  else if (key === "f") { consume(event); look("", over); }
  else if (key === "k") { consume(event); cursor.node.focus(); }
  else if (key === "v") { consume(event); send({ do: "layers" }); }
  else if (key === "p") { consume(event); showPlots(plots.hidden); }
  else if (key === "[" || key === "]") { consume(event); send({ do: "size", factor: key === "[" ? 0.8 : 1.25 }); }

  else if (key === "l") { consume(event); setLock(!lock); }
  else if (key === "?") { consume(event); keyList.showModal(); }
  else if (key === "h") { consume(event); hint.hidden = !hint.hidden; }
  else { const tool = TOOLS.find((t) => t[2] === key); if (tool) { consume(event); send({ do: "tool", name: tool[0] }); } }
}, true);

document.body.addEventListener("keydown", (event) => {  // keys that move a slider must not move the camera
  if (event.target.closest("[role=slider], [role=tab], dialog")) event.stopPropagation();
});
function look(name, event) {  // a named view; without a name, frames the body under the pointer
  const box = canvas().getBoundingClientRect();
  send({ do: "view", name, ...place(event ?? { clientX: box.left - box.width, clientY: box.top }) });
}

// --- toolbar, instructions, status line and plots over the canvas ---

const root = make("main", { id: "hs", ariaLabel: "3-D view" });
const bar = make("div", { id: "hs-bar", role: "toolbar", ariaLabel: "Tools" });
const tipped = (node, tip) => { node.dataset.tip = tip; return node; };
const button = (text, key, tip, act, into = bar) => {
  const node = tipped(make("button", { type: "button", onclick: (event) => { act(); if (event.detail) node.blur(); } }, text), tip);
  if (key) node.append(make("kbd", {}, key));
  into.append(node);
  return node;
};
const gap = () => bar.append(make("span", { className: "gap" }));
const tools = new Map(TOOLS.map(([name, text, key, title]) => [name, button(text, key, forFingers(title), () => send({ do: "tool", name }))]));
const ink = make("span", { id: "hs-ink" });
bar.append(ink);
gap();
const DRAWS = TOUCH_SCREEN ? ["Drag one finger to use the tool.", "Drag one finger to rotate the view."] :
  ["Drag to use the tool, Shift + drag to rotate the view.", "Shift + drag to use the tool, drag to rotate the view."];
const lockButton = button("Draw", "L", DRAWS[0], () => setLock(!lock));
gap();
const undo = button("Undo", "Ctrl Z", "", () => send({ do: "undo" }));
const redo = button("Redo", "Ctrl Y", "", () => send({ do: "redo" }));
undo.dataset.brief = "↶";
redo.dataset.brief = "↷";
const save = button("Save", "Ctrl S", "", () => send({ do: "save" }));
const saved = make("output", { id: "hs-saved" });
bar.append(saved);
gap();
const viewButton = button("View", "", "Show or hide the view buttons", () => showViews(views.hidden));
const keyList = newKeyList(make);
button("Keys", "?", "Show the keyboard shortcuts", () => keyList.showModal()).dataset.brief = "?";
const views = make("div", { id: "hs-views", role: "toolbar", ariaLabel: "Views" });
button("Home", "Home", "Reset the view", () => look("perspective"), views);
button("Frame", "F", "Frame the selected body or the scene; the key F also frames the body under the pointer", () => look(""), views);
VIEWS.forEach((name, i) => button(name[0].toUpperCase() + name.slice(1), `⇧${i + 1}`, `View from: ${name} (Shift + ${i + 1})`, () => look(name), views));
button("Dark", "", "Dark or light theme of this browser", () => { localStorage.setItem("hapscene-dark", String(!themed.dark)); setTheme(); }, views);
const setTheme = () => send({ do: "theme", dark: themed.dark });
const hint = make("div", { id: "hs-hint" });
HINT.forEach((line, i) => hint.append(make("p", { innerHTML: `<b>${i + 1}</b>${line.replace(/<b>/g, "<kbd>").replace(/<\/b>/g, "</kbd>")}` })));
hint.append(tipped(make("button", { type: "button", ariaLabel: "Hide the instructions", onclick: () => { hint.hidden = true; } }, "×"), "Hide the instructions (H)"));
const toast = make("div", { id: "hs-say", role: "status" });
const monitor = make("div", { id: "hs-monitor" });
const line = make("div", { id: "hs-line" });
const status = make("output", {}, "…"), tip = make("span", { id: "hs-tip" });
const soundButton = tipped(make("button", { type: "button", onclick: () => sound.toggle() }), "Play the acceleration of the handle as sound");
const volume = tipped(make("input", { type: "range", min: -30, max: 20, value: 0, oninput: () => sound.turn() }), "Volume [dB]");
const level = make("span", {}, "");
const plots = make("div", { id: "hs-plots", hidden: true });
line.append(status, tip, soundButton, make("label", {}, "volume", volume, level));
const plotButton = button("Plots", "P", "Force, acceleration and spectrum of the touch", () => showPlots(plots.hidden), line);
const trace = newTrace(plots);
monitor.append(line, plots);
const cursor = newCursor({
  canvas, begin: press, move: (event) => (pressed ? draw(event) : hover(event)), end: (event) => { if (pressed) release("up", event); },
});
root.append(bar, make("div", { id: "hs-space" }, hint, views), toast, monitor, cursor.node);
const updateTip = showTips(tip, () => state.hints ?? {});
const outline = showOutline(canvas);
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
  document.documentElement.dataset.draw = on ? "on" : "off";
  say(DRAWS[on ? 0 : 1]);
}
function show() {
  for (const [name, node] of tools) node.setAttribute("aria-pressed", String(name === state.tool));
  ink.textContent = state.swatch || "";
  ink.dataset.tip = `Selected swatch: ${state.swatch}`;
  ink.style.setProperty("--chip", state.colour || "transparent");
  undo.disabled = !state.undo;
  redo.disabled = !state.redo;
  undo.dataset.tip = state.undo ? `Undo: ${state.undo}` : "Nothing to undo";
  redo.dataset.tip = state.redo ? `Redo: ${state.redo}` : "Nothing to redo";
  save.classList.toggle("due", !!state.dirty);
  save.dataset.tip = state.dirty ? `Save ${state.title}` : `All changes are saved in ${state.title}`;
  saved.textContent = state.dirty ? "Unsaved" : "Saved";
  if (state.undo && !show.painted) { show.painted = true; hint.hidden = true; }  // after the first stroke
  document.title = `${state.dirty ? "• " : ""}${state.title} – hapscene paint`;
  status.textContent = state.status || "";
  outline(state.outline);
  const c = canvas();
  if (c) c.style.cursor = state.tool === "touch" ? "crosshair" : "";
}
function fit() {
  const c = canvas();
  if (!c) return;
  const sheet_px = sheetHeight(), box = c.getBoundingClientRect();
  const settled = box.bottom <= innerHeight - sheet_px + 1;
  if (!fit.sent && settled && state.tool && box.width && client() >= 0) { fit.sent = true; send({ do: "frame", w: box.width, h: box.height }); }
  if (box.width !== fit.width) { fit.width = box.width; trace.fresh = true; }
  Object.assign(root.style, { left: `${box.left}px`, top: `${box.top}px`, width: `${box.width}px`, height: `${box.height}px` });
}

// --- sound ---

const sound = {
  on: true, context: null, gain: null, monitor: null, next: 0, gaps: 0, played: 0, peak: 0, full: 20, gapTimes: [], quiet_ms: 0, jitter: new JitterBuffer(),
  wake() {
    if (!this.on || this.context) { if (this.on && this.context.state === "suspended") this.context.resume(); return; }
    const Context = window.AudioContext || window.webkitAudioContext;
    if (!Context) return;
    this.context = new Context({ sampleRate: 10000, latencyHint: "interactive" });
    this.gain = this.context.createGain();
    const press = this.context.createDynamicsCompressor();
    this.gain.connect(press).connect(this.context.destination);
    if (this.context.audioWorklet) this.startMonitor();  // browsers have none for plain HTTP from another computer
    this.turn();
  },
  turn() {
    level.textContent = `${volume.value > 0 ? "+" : ""}${volume.value} dB`;
    if (this.gain) this.gain.gain.value = (this.on ? 1 : 0) * (10 ** (volume.value / 20) / this.full);
  },
  toggle() { this.on = !this.on; this.wake(); this.turn(); this.label(); },
  label() { soundButton.textContent = this.on ? "Sound: on" : "Sound: off"; soundButton.setAttribute("aria-pressed", String(this.on)); },
  async startMonitor() {
    await this.context.audioWorklet.addModule("/hapscene-audio_monitor.js");
    const { port1, port2 } = new MessageChannel();
    this.monitor = new AudioWorkletNode(this.context, "hapscene-audio-monitor", { numberOfInputs: 0 });
    this.monitor.port.onmessage = ({ data }) => this.countGaps(data);
    this.monitor.port.postMessage({ wire: port1 }, [port1]);
    link.postMessage({ monitor: port2 }, [port2]);
    this.monitor.connect(this.gain);
  },
  countGaps({ gaps }) {
    const now_ms = performance.now();
    for (; this.gaps < gaps; this.gaps++) this.gapTimes.push(now_ms);
    this.gapTimes = this.gapTimes.filter((at_ms) => now_ms - at_ms < 60e3);
    if (this.gapTimes.length < GAPS_MAX || now_ms < this.quiet_ms) return;
    this.quiet_ms = now_ms + 60e3;
    say(`Sound had ${this.gapTimes.length} gaps in the last minute, because this computer is too busy. Close other programs.`);
  },
  note(a) {
    this.played += a.length;
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
    const now = this.context.currentTime, late_s = now - this.next, dry = late_s > 0 && late_s < 5 * DELAY_MAX_S;
    if (late_s >= 5 * DELAY_MAX_S) this.jitter.begin();
    this.jitter.note(-late_s, a.length / rate);
    const { target_s } = this.jitter;
    if (late_s > 0) { this.next = now + target_s; this.jitter.begin(); }  // at the start, and after an underrun
    const over_s = this.next - now - target_s;  // after a pause, the backlog is played faster to restore the latency
    this.countGaps({ count, gaps: this.gaps + dry });
    if (over_s > DELAY_MAX_S) return;
    const speed = 1 + HURRY * Math.min(Math.max(over_s / target_s, -1), 1);
    this.play(a, rate, this.next, speed);
    this.next += a.length / rate / speed;
  },
  once(a, rate) { this.wake(); if (!this.on) say("Sound is off. Turn it on in the status line."); if (this.on && this.context) this.play(a, rate, this.context.currentTime + 0.02); },
};

// --- start ---

function blurBehindDialog() {  // otherwise text would be typed into a field behind the dialog
  const field = document.activeElement;
  if (dialogOpen() && field.matches("input, textarea") && !field.closest(".mantine-Modal-content")) field.blur();
}

window.addEventListener("pointerdown", () => sound.wake());
function whenDrawn(act) {  // when all that was requested so far is on the screen
  const gl = canvas().getContext("webgl2"), fence = gl?.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
  const look = () => (fence && gl.getSyncParameter(fence, gl.SYNC_STATUS) !== gl.SIGNALED ? setTimeout(look, 20) : act());
  gl?.flush();
  look();
}
function start() {
  document.body.append(root, keyList);
  hint.hidden = innerWidth < 760;
  if (hint.hidden && TOUCH_SCREEN) say("Tap Draw to paint with one finger. Without it, one finger rotates the view.", "", 12000);
  showViews(innerWidth >= 1200 && innerHeight >= 640);
  showPlots(false);
  sound.label();
  sound.turn();
  fit();
  const home = location.href.split(/[?#]/)[0].replace(/\/*$/, "/");
  link.postMessage({ url: `${home.replace(/^http/, "ws")}hapscene` });
  localStorage.setItem("hapscene", new URL(home).pathname);  // for a reload and other tabs: see server.py
  new ResizeObserver(fit).observe(document.body);
  let due = false;
  new MutationObserver(() => {
    introduce();
    blurBehindDialog();
    if (!due) requestAnimationFrame(() => { due = false; fixPage(say); fit(); updateTip(); });
    due = true;
  }).observe(document.body, { childList: true, subtree: true });
  new MutationObserver(() => { trace.fresh = true; }).observe(document.documentElement, { attributes: true });
  setInterval(fit, 300);
  const grain = newGrain();
  let shown = false;
  (function frame() {
    drawLess();
    const drawn = grain(state.grain, stamp.uniforms);
    trace.draw();
    if (drawn && state.tool && !shown) { shown = true; setTimeout(whenDrawn, DRAWN_MS, () => send({ do: "shown" })); }
    requestAnimationFrame(frame);
  })();
}
start();
window.hapscene = { get state() { return state; }, sound, trace, client, send, stamp };
