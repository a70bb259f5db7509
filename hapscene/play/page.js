// Sends pointer events to the server, and draws the touch that the server reports.

const $ = (id) => document.getElementById(id);
const pad = $("pad"), ink = pad.getContext("2d"), dark = matchMedia("(prefers-color-scheme: dark)");
const SEND_MS = 4, REPEAT_MS = 100, SHOWN_S = 3;
let state = { size: [4, 3], width_m: 0.16, depth_max_m: 0.003, tools: 1, swatches: [], effects: {}, resets: 0, bin_s: 0.003 };
let felt = [], socket = null, open = false;
const start = { depth: $("depth").value, volume: $("volume").value };

// --- the picture, rotated if the page is high and the scene is wide

const picture = new Image();
picture.onload = () => { picture.ready = true; };
picture.onerror = () => { picture.ready = false; };
const load = () => { picture.ready = false; picture.src = dark.matches ? "dark.png" : "light.png"; };
dark.addEventListener("change", load);

function place() { // position of the picture in the canvas [CSS pixels]
  const box = pad.getBoundingClientRect(), [pw, ph] = state.size;
  const size = (w, h) => Math.min(box.width / w, box.height / h), turned = size(ph, pw) > 1.2 * size(pw, ph);
  const [w, h] = turned ? [ph, pw] : [pw, ph], scale = size(w, h);
  return { box, turned, w: w * scale, h: h * scale, x: (box.width - w * scale) / 2, y: (box.height - h * scale) / 2 };
}

function toPicture(event) { // u, v in the picture, 0 to 1; null outside
  const at = place(), x = (event.clientX - at.box.left - at.x) / at.w, y = (event.clientY - at.box.top - at.y) / at.h;
  if (!(x >= 0 && x <= 1 && y >= 0 && y <= 1)) return null;
  return at.turned ? [y, 1 - x] : [x, y];
}

// --- pointers

const down = new Map(); // by pointer id: [u, v, depth relative to the maximum]
const waiting = new Set();
let sentAt = 0, timer = 0;

const shareOf = (event) => event.pointerType === "pen" && event.pressure > 0
  ? event.pressure : $("depth").value * 1e-3 / state.depth_max_m;

const send = (message) => { if (open) socket.send(JSON.stringify(message)); };

function flush() {
  timer = 0;
  const points = [...waiting].filter((id) => down.has(id)).map((id) => [id, ...down.get(id)]);
  waiting.clear();
  sentAt = performance.now();
  if (points.length) send({ points });
}

function soon(id) {
  waiting.add(id);
  const left = sentAt + SEND_MS - performance.now();
  if (left <= 0) { clearTimeout(timer); flush(); } else if (!timer) timer = setTimeout(flush, left);
}

function take(event) {
  const at = toPicture(event);
  if (at === null) { up(event); return; }
  down.set(event.pointerId, [at[0], at[1], Math.min(Math.max(shareOf(event), 0), 1)]);
  soon(event.pointerId);
}

function up(event) {
  if (down.delete(event.pointerId)) send({ up: [event.pointerId] });
}

pad.addEventListener("pointerdown", (event) => {
  if (event.button !== 0) return;
  event.preventDefault();
  document.activeElement?.blur(); // so that Space does not press a button
  try { pad.setPointerCapture(event.pointerId); } catch { /* the pointer has been released */ }
  take(event);
});
const moved = (event) => { if (down.has(event.pointerId)) take(event); };
pad.addEventListener("pointermove", moved);
if ("onpointerrawupdate" in window) pad.addEventListener("pointerrawupdate", moved);
for (const kind of ["pointerup", "pointercancel", "lostpointercapture"]) pad.addEventListener(kind, up);
pad.addEventListener("contextmenu", (event) => event.preventDefault());
pad.addEventListener("wheel", (event) => {
  event.preventDefault();
  $("depth").value = +$("depth").value - Math.sign(event.deltaY) * 0.1;
  deepen();
  send({ active: true });
}, { passive: false });

function deepen() {
  $("depthnum").value = `${(+$("depth").value).toFixed(1)} mm`;
  for (const [id, at] of down) if (id === mouse) { at[2] = $("depth").value * 1e-3 / state.depth_max_m; soon(id); }
}
let mouse = -1;
pad.addEventListener("pointerdown", (event) => { if (event.pointerType === "mouse") mouse = event.pointerId; });

function lift() { down.clear(); send({ lift: true }); }
setInterval(() => { for (const id of down.keys()) soon(id); }, REPEAT_MS);
document.addEventListener("visibilitychange", () => { if (document.hidden) lift(); });
addEventListener("pagehide", lift);

// --- keys and switches

addEventListener("keydown", (event) => {
  if (event.key === "Escape") lift();
  else if (event.key === " " && !["BUTTON", "INPUT"].includes(event.target.tagName)) {
    event.preventDefault();
    if (!event.repeat) send({ pause: !state.paused });
  }
});
for (const button of document.querySelectorAll("[data-effect]"))
  button.addEventListener("click", () => send({ switch: [button.dataset.effect, !state.effects[button.dataset.effect]] }));
$("pause").addEventListener("click", () => send({ pause: !state.paused }));
$("sound").addEventListener("click", () => send({ sound: [!state.sound, +$("volume").value] }));
$("volume").addEventListener("input", () => {
  $("volumenum").value = `${Math.round($("volume").value * 100)} %`;
  if (state.sound !== null) send({ sound: [state.sound, +$("volume").value] });
});
$("depth").addEventListener("input", () => { deepen(); send({ active: true }); });

// --- state and traces

const traces = { f: { least: 1, unit: "N" }, a: { least: 5, unit: "m/s²", both: true }, v: { least: 100, unit: "mm/s", factor: 1e3 } };
for (const trace of Object.values(traces)) trace.values = [];

function takeState(next) {
  const reset = next.resets !== state.resets && state.title !== undefined;
  state = next;
  document.title = $("title").textContent = state.title || "hapscene";
  for (const button of document.querySelectorAll("[data-effect]"))
    button.setAttribute("aria-pressed", state.effects[button.dataset.effect]);
  $("pause").setAttribute("aria-pressed", state.paused);
  $("pause").textContent = state.paused ? "resume" : "pause";
  $("sound").disabled = $("volume").disabled = state.sound === null;
  $("sound").setAttribute("aria-pressed", !!state.sound);
  $("sound").textContent = state.sound === null ? "sound not available" : state.sound ? "stop sound" : "start sound";
  say(state.said || (!state.ready ? "starting …" : state.paused ? "paused" : ""), !!state.said);
  if (reset) {
    for (const trace of Object.values(traces)) trace.values.length = 0;
    down.clear();
    for (const id of ["depth", "volume"]) { $(id).value = start[id]; }
    deepen();
    $("volumenum").value = `${Math.round($("volume").value * 100)} %`;
  }
}

function takeFelt(next) {
  felt = next.felt;
  for (const [name, trace] of Object.entries(traces)) {
    for (const value of next[name]) trace.values.push(value * (trace.factor || 1));
    trace.values.splice(0, Math.max(trace.values.length - SHOWN_S / state.bin_s, 0));
  }
}

function say(text, wrong) {
  if ($("said").textContent !== text) $("said").textContent = text; // otherwise a screen reader would repeat it
  $("said").classList.toggle("wrong", !!wrong);
}

const SILENT_MS = 2000; // time without messages after which the connection counts as lost; the server sends at 30 Hz

let received = 0; // time of the last trace message [ms]; 0 if it does not exist

function connect() {
  socket = new WebSocket(new URL("socket", location.href.replace(/^http/, "ws")));
  socket.onopen = () => { open = true; say(""); };
  socket.onmessage = (event) => {
    const message = JSON.parse(event.data);
    if ("felt" in message) { received = performance.now(); takeFelt(message); }
    else if ("size" in message) takeState(message);
    else { received = 0; say(message.said, true); }
  };
  socket.onclose = lose;
}

function lose() {
  if (open) say("Connection lost: the program has ended, or the network is down", true);
  open = false; received = 0; felt = []; down.clear();
  setTimeout(connect, 1000);
}

setInterval(() => { // a network failure does not close the socket
  if (!received || performance.now() - received < SILENT_MS) return;
  socket.onclose = socket.onmessage = null;
  socket.close();
  lose();
}, 500);

// --- drawing, once a frame

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

function fitted(canvas) { // matches the canvas to the screen pixels; returns context and size [CSS pixels]
  const { clientWidth: w, clientHeight: h } = canvas, ratio = devicePixelRatio || 1, pen = canvas.getContext("2d");
  const [W, H] = [Math.round(w * ratio), Math.round(h * ratio)];
  if (canvas.width !== W || canvas.height !== H) { canvas.width = W; canvas.height = H; }
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, w, h);
  return [pen, w, h];
}

function drawPad() {
  fitted(pad);
  const at = place();
  ink.save();
  ink.translate(at.x, at.y);
  if (at.turned) { ink.translate(at.w, 0); ink.rotate(Math.PI / 2); }
  const [w, h] = at.turned ? [at.h, at.w] : [at.w, at.h];
  if (picture.ready) ink.drawImage(picture, 0, 0, w, h);
  else { ink.strokeStyle = colour("--line"); ink.setLineDash([6, 6]); ink.strokeRect(1, 1, w - 2, h - 2); ink.setLineDash([]); }
  for (const [u, v, newtons] of felt) {
    const radius = 9 + 14 * Math.sqrt(Math.min(newtons, 4));
    for (const [style, width] of [["rgba(0,0,0,.75)", 5], ["#ffffff", 2.5]]) {
      ink.beginPath(); ink.arc(u * w, v * h, radius, 0, 7); ink.strokeStyle = style; ink.lineWidth = width; ink.stroke();
    }
  }
  ink.restore();
  const long = 10 ** Math.floor(Math.log10(state.width_m * 0.4)), px = long / state.width_m * w;
  ink.fillStyle = colour("--dim");
  ink.fillRect(12, at.box.height - 14, px, 2);
  ink.font = "12px system-ui, sans-serif";
  ink.fillText(long < 1 ? `${Math.round(long * 1e3)} mm` : `${long} m`, 12, at.box.height - 20);
}

function drawTrace(name, trace) {
  const [pen, w, h] = fitted($(name)), values = trace.values, most = values.reduce((m, x) => Math.max(m, Math.abs(x)), 0);
  const top = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000].map((x) => x * trace.least / 5).find((x) => x >= most) || most;
  const zero = trace.both ? h / 2 : h - 3, scale = (zero - 3) / top, step = w * state.bin_s / SHOWN_S;
  pen.strokeStyle = colour("--line"); pen.beginPath(); pen.moveTo(0, zero); pen.lineTo(w, zero); pen.stroke();
  pen.strokeStyle = colour(`--${name}`); pen.lineWidth = 1.5; pen.beginPath();
  values.forEach((x, k) => pen.lineTo(w - (values.length - k) * step, zero - x * scale));
  pen.stroke();
  $(`${name}num`).value = `${top} ${trace.unit}`;
}

function draw() {
  drawPad();
  for (const [name, trace] of Object.entries(traces)) drawTrace(name, trace);
  const last = felt[felt.length - 1], swatch = last && state.swatches[last[4]];
  $("swatch").value = swatch ? swatch[0] : last ? "surface" : "no contact";
  $("chip").style.setProperty("--chip", swatch ? swatch[1] : "transparent");
  $("numbers").value = last ? `${last[2].toFixed(1)} N, ${last[3].toFixed(1)} mm` : "";
  const recent = traces.a.values.slice(-Math.ceil(0.1 / state.bin_s));
  const rms = Math.sqrt(recent.reduce((sum, x) => sum + x * x, 0) / (recent.length || 1));
  $("level").firstElementChild.style.transform = `scaleX(${Math.min(Math.log10(1 + 9 * rms / 20), 1)})`;
  requestAnimationFrame(draw);
}

load();
deepen();
$("volumenum").value = `${Math.round($("volume").value * 100)} %`;
connect();
draw();
window.hapscene = { get state() { return state; }, get felt() { return felt; }, down, traces, place };
