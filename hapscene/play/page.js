// Sends pointer events to the server, and draws the touch that the server reports.

const $ = (id) => document.getElementById(id);
const pad = $("pad"), ink = pad.getContext("2d"), dark = matchMedia("(prefers-color-scheme: dark)");
const SEND_MS = 4, REPEAT_MS = 100, SHOWN_S = 3;
let state = { size: [4, 3], bodies: [], used: [], width_m: 0.16, depth_max_m: 0.003, tools: 1, swatches: [], effects: {}, resets: 0, bin_s: 0.003 };
let felt = [], socket = null, open = false;
const start = { depth: $("depth").value, volume: $("volume").value };

// --- the picture, rotated if the page is high and the scene is wide

const picture = new Image();
picture.onload = () => { picture.ready = true; };
picture.onerror = () => { picture.ready = false; };
const load = () => { picture.ready = false; picture.src = dark.matches ? "dark.png" : "light.png"; };
dark.addEventListener("change", load);

const WHOLE = [0, 0, 1, 1];
let shown = WHOLE; // part of the picture that fills the canvas: u and v from, to

function place() { // position of the picture in the canvas [CSS pixels]
  const box = pad.getBoundingClientRect(), [pw, ph] = state.size, [u0, v0, u1, v1] = shown;
  const size = (w, h) => Math.min(box.width / w, box.height / h), [sw, sh] = [pw * (u1 - u0), ph * (v1 - v0)];
  const turned = size(sh, sw) > 1.2 * size(sw, sh), scale = turned ? size(sh, sw) : size(sw, sh);
  const [w, h] = (turned ? [ph, pw] : [pw, ph]).map((side) => side * scale);
  const [u, v] = [(u0 + u1) / 2, (v0 + v1) / 2], [x, y] = turned ? [1 - v, u] : [u, v];
  return { box, turned, w, h, x: box.width / 2 - x * w, y: box.height / 2 - y * h };
}

function toPicture(event, anywhere) { // u, v in the picture, 0 to 1; null outside of what is shown
  const at = place(), inBox = [event.clientX - at.box.left, event.clientY - at.box.top];
  const [x, y] = [(inBox[0] - at.x) / at.w, (inBox[1] - at.y) / at.h];
  const inside = x >= 0 && x <= 1 && y >= 0 && y <= 1 && inBox[0] >= 0 && inBox[0] <= at.box.width && inBox[1] >= 0 && inBox[1] <= at.box.height;
  if (!inside && !anywhere) return null;
  return at.turned ? [y, 1 - x] : [x, y];
}

const around = ([u0, v0, u1, v1], share) => [u0 - share * (u1 - u0), v0 - share * (v1 - v0), u1 + share * (u1 - u0), v1 + share * (v1 - v0)];

function zoom(event) { // about the pointer, at most to the whole picture
  const [u, v] = toPicture(event, true), by = 1.1 ** Math.sign(event.deltaY);
  const next = [u + (shown[0] - u) * by, v + (shown[1] - v) * by, u + (shown[2] - u) * by, v + (shown[3] - v) * by];
  if (next[2] - next[0] > 1 && next[3] - next[1] > 1) shown = WHOLE;
  else if (next[2] - next[0] > 0.02) shown = next;
}

function listViews() { // the scene and its bodies; a narrow page begins with the body in the middle
  const middle = ([, [u0, , u1]]) => Math.abs((u0 + u1) / 2 - 0.5);
  const nearest = state.bodies.reduce((best, body) => middle(body) < middle(best) ? body : best, state.bodies[0]);
  $("view").replaceChildren(new Option("whole scene", ""), ...state.bodies.map(([name], k) => new Option(name, k)));
  $("viewlabel").hidden = state.bodies.length < 2;
  $("view").value = innerWidth < 600 && state.bodies.length > 1 ? state.bodies.indexOf(nearest) : "";
  choose();
}

function choose() {
  const body = state.bodies[$("view").value];
  shown = $("view").value === "" || !body ? WHOLE : around(body[1], 0.06);
}
$("view").addEventListener("change", () => { lift(); choose(); $("view").blur(); });

function listMaterials() {
  $("legend").replaceChildren(...state.used.map((k) => {
    const item = document.createElement("li"), chip = document.createElement("i");
    chip.style.background = state.swatches[k][1];
    item.append(chip, state.swatches[k][0]);
    return item;
  }));
}

// --- pointers

const down = new Map(); // by pointer id: [u, v, depth relative to the maximum]
const pressed = new Set(); // pointer ids, also of those that are pressed beside the picture
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
  if (at === null) { release(event); return; }
  down.set(event.pointerId, [at[0], at[1], Math.min(Math.max(shareOf(event), 0), 1)]);
  soon(event.pointerId);
}

function release(event) {
  if (down.delete(event.pointerId)) send({ up: [event.pointerId] });
}

function up(event) {
  pressed.delete(event.pointerId);
  release(event);
}

pad.addEventListener("pointerdown", (event) => {
  if (event.button !== 0) return;
  event.preventDefault();
  document.activeElement?.blur(); // so that Space does not press a button
  try { pad.setPointerCapture(event.pointerId); } catch { /* the pointer has been released */ }
  pressed.add(event.pointerId);
  take(event);
});
const moved = (event) => { if (pressed.has(event.pointerId)) take(event); };
pad.addEventListener("pointermove", moved);
if ("onpointerrawupdate" in window) pad.addEventListener("pointerrawupdate", moved);
for (const kind of ["pointerup", "pointercancel", "lostpointercapture"]) pad.addEventListener(kind, up);
pad.addEventListener("contextmenu", (event) => event.preventDefault());
pad.addEventListener("wheel", (event) => {
  event.preventDefault();
  if (event.ctrlKey) { zoom(event); return; }
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

function lift() { down.clear(); pressed.clear(); send({ lift: true }); }
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

setInterval(() => {
  if (!state.ready) $("busy").lastElementChild.textContent = `Starting for ${Math.round(performance.now() / 1e3)} s. ` +
    "The first start compiles for about 20 s, longer on a busy computer; later starts take 3 s.";
}, 200);

const traces = { f: { least: 1, unit: "N" }, a: { least: 5, unit: "m/s²", both: true }, v: { least: 100, unit: "mm/s", factor: 1e3 } };
for (const trace of Object.values(traces)) trace.values = [];

function takeState(next) {
  const first = state.title === undefined, reset = next.resets !== state.resets && !first;
  state = next;
  if (first) { listViews(); listMaterials(); }
  document.title = $("title").textContent = state.title || "hapscene";
  for (const button of document.querySelectorAll("[data-effect]"))
    button.setAttribute("aria-pressed", state.effects[button.dataset.effect]);
  $("pause").setAttribute("aria-pressed", state.paused);
  $("pause").textContent = state.paused ? "resume" : "pause";
  $("sound").disabled = $("volume").disabled = state.sound === null;
  $("sound").setAttribute("aria-pressed", !!state.sound);
  $("sound").textContent = state.sound === null ? "sound not available" : state.sound ? "stop sound" : "start sound";
  say(state.said || (state.paused ? "paused" : ""), !!state.said);
  $("busy").hidden = state.ready;
  if (reset) {
    listViews();
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
  open = false; received = 0; felt = []; down.clear(); pressed.clear();
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
  const long = 10 ** Math.floor(Math.log10(state.width_m * 0.4 * Math.min(1, shown[2] - shown[0]))), px = long / state.width_m * w;
  ink.fillStyle = colour("--dim");
  ink.fillRect(12, at.box.height - 14, px, 2);
  ink.font = "12px system-ui, sans-serif";
  ink.fillText(long < 1 ? `${Math.round(long * 1e3)} mm` : `${long} m`, 12, at.box.height - 20);
}

function drawTrace(name, trace) {
  const [pen, w, h] = fitted($(name)), values = trace.values, most = values.reduce((m, x) => Math.max(m, Math.abs(x)), 0);
  const top = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000].map((x) => x * trace.least / 5).find((x) => x >= most) || most;
  const zero = trace.both ? h / 2 : h - 3, scale = (zero - 3) / top, step = w * state.bin_s / SHOWN_S;
  pen.strokeStyle = colour("--line"); pen.beginPath(); pen.moveTo(0, zero); pen.lineTo(w, zero);
  pen.moveTo(0, 3); pen.lineTo(w, 3); pen.stroke();
  pen.fillStyle = colour("--dim"); pen.font = "11px system-ui, sans-serif"; // the end of the axis, beside its line
  pen.fillText(`${top} ${trace.unit}`, 3, 14);
  pen.strokeStyle = colour(`--${name}`); pen.lineWidth = 1.5; pen.beginPath();
  values.forEach((x, k) => pen.lineTo(w - (values.length - k) * step, zero - x * scale));
  pen.stroke();
  const recent = Math.max(0, ...values.slice(-Math.ceil(0.1 / state.bin_s)).map(Math.abs));
  $(`${name}num`).value = `${recent.toPrecision(recent < 100 ? 2 : 3)} ${trace.unit}`;
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
