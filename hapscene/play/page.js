// Sends pointer events to the server, and draws the touch that the server reports.

const pad = $("pad"), ink = pad.getContext("2d");
const SEND_MS = 4, REPEAT_MS = 100, SHOWN_S = 3;
let state = { used: [], depth_max_m: 0.003, tools: 1, swatches: [], effects: {}, resets: 0, bin_s: 0.003 };
let felt = [], socket = null, open = false;
const start = { depth: $("depth").value, volume: $("volume").value };

// --- view: view.js draws the scene, and its camera stays above the ground, so that each line of sight points downwards

Object.assign(camera, { yaw: 0, pitch: 1.1, lowest: 0.45, margin_px: 26 });
const HOME = { ...camera };
let drawn = false; // whether the scene is drawn; otherwise a frame around the pad is

async function load() {
  const reply = await fetch("scene.json");
  if (!reply.ok) return; // a pad without a scene
  const given = await reply.json();
  block = await unpack(given.data);
  take_scene(given);
  await load_pictures();
  set_up();
  drawn = true;
  listViews();
}

const seen = new ResizeObserver(() => { if (scene) { if (!touchedView) choose(); if (drawn) redraw(); } });
dark.addEventListener("change", () => { if (drawn) redraw(); });
canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
canvas.addEventListener("webglcontextrestored", () => { set_up(); redraw(); });

function sight(event, anywhere) { // line of sight through the pointer: eye and direction; null outside of the canvas
  const box = pad.getBoundingClientRect(), x = 2 * (event.clientX - box.left) / box.width - 1, y = 1 - 2 * (event.clientY - box.top) / box.height;
  if (!scene || (!anywhere && (Math.abs(x) > 1 || Math.abs(y) > 1))) return null;
  const { right, up, back, high, wide, eye } = lens();
  return [eye, add(add(right.map((a) => a * x * wide), up, y * high), back, -1)];
}

function project(p) { // position of a point of the scene in the canvas, and pixels per metre there [CSS pixels]
  const { right, up, back, high, wide, eye } = lens(), q = add(p, eye, -1), far = -dot(q, back), { clientWidth: w, clientHeight: h } = pad;
  return { x: w / 2 * (1 + dot(q, right) / far / wide), y: h / 2 * (1 - dot(q, up) / far / high), scale: h / 2 / far / high };
}

let touchedView = false; // whether the view was moved, which a new size of the page then keeps
const moveView = (act) => { if (drawn) { touchedView = true; act(); send({ active: true }); } };

function listViews() { // the scene and its bodies; a narrow page begins with one body
  $("view").replaceChildren(new Option("whole scene", ""), ...scene.bodies.map(({ name }, k) => new Option(name, k)));
  $("viewlabel").hidden = scene.bodies.length < 2;
  $("view").value = innerWidth < 600 && scene.bodies.length > 1 ? scene.main : "";
  choose();
}

function choose() {
  touchedView = false;
  const body = scene?.bodies?.[$("view").value], wide = body ? sizeOf(body) : scene.size;
  // a high page shows a wide scene along its height
  Object.assign(camera, HOME, pad.clientHeight > 1.2 * pad.clientWidth && wide[0] > 1.2 * wide[1] ? { yaw: Math.PI / 2 } : {});
  if (drawn) fit(body, true); else Object.assign(camera, { target: middle, distance: 3 * radius });
}

function sizeOf({ first, count }) { // of the box around a body [m]
  const position = array(scene.position), corners = array(scene.faces), low = [1, 1, 1], high = [0, 0, 0];
  for (let i = first; i < first + count; i++) for (let axis = 0; axis < 3; axis++) {
    const x = position[3 * corners[i] + axis] / 65535;
    low[axis] = Math.min(low[axis], x);
    high[axis] = Math.max(high[axis], x);
  }
  return high.map((x, axis) => (x - low[axis]) * scene.size[axis]);
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

const down = new Map(); // by pointer id: [eye, direction, depth relative to the maximum]
const stroking = new Set(); // pointer ids, also of those that are pressed beside the scene
const pointers = new Map(); // last event of each pressed pointer
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
  const at = sight(event);
  if (at === null) { release(event); return; }
  down.set(event.pointerId, [at[0], at[1], Math.min(Math.max(shareOf(event), 0), 1)]);
  soon(event.pointerId);
}

function release(event) {
  if (down.delete(event.pointerId)) send({ up: [event.pointerId] });
}

function up(event) {
  stroking.delete(event.pointerId);
  pointers.delete(event.pointerId);
  release(event);
}

pad.addEventListener("pointerdown", (event) => { // one pointer strokes; the right button, Shift or two fingers turn
  event.preventDefault();
  document.activeElement?.blur(); // so that Space does not press a button
  try { pad.setPointerCapture(event.pointerId); } catch { /* the pointer has been released */ }
  pointers.set(event.pointerId, event);
  if (pointers.size > 1) lift();
  else if (event.button === 0 && !event.shiftKey) { stroking.add(event.pointerId); take(event); }
});

function moved(event) {
  const old = pointers.get(event.pointerId);
  if (!old) return;
  if (stroking.has(event.pointerId)) take(event);
  else if (event.type === "pointermove") {
    const dx = (event.clientX - old.clientX) / pointers.size, dy = (event.clientY - old.clientY) / pointers.size;
    const other = [...pointers.values()].find((one) => one !== old), far = (one) => Math.hypot(one.clientX - other.clientX, one.clientY - other.clientY);
    moveView(() => { if (event.buttons & 4) pan(dx, dy); else turn(dx, dy); if (other) zoom(far(old) / Math.max(far(event), 1)); });
  } else return;
  pointers.set(event.pointerId, event);
}
pad.addEventListener("pointermove", moved);
if ("onpointerrawupdate" in window) pad.addEventListener("pointerrawupdate", moved);
for (const kind of ["pointerup", "pointercancel", "lostpointercapture"]) pad.addEventListener(kind, up);
pad.addEventListener("contextmenu", (event) => event.preventDefault());
pad.addEventListener("wheel", (event) => { // during a stroke, it sets the depth
  event.preventDefault();
  if (event.ctrlKey || !down.size) {
    moveView(() => zoom(Math.exp(0.0015 * Math.min(Math.max(event.deltaY, -200), 200))));
    for (const id of down.keys()) take(pointers.get(id)); // the pointer stays, the view moves
    return;
  }
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

function lift() { down.clear(); stroking.clear(); send({ lift: true }); }
setInterval(() => { for (const id of down.keys()) soon(id); }, REPEAT_MS);
document.addEventListener("visibilitychange", () => { if (document.hidden) lift(); });
addEventListener("pagehide", lift);

// --- keys and switches

addEventListener("keydown", (event) => {
  const view = { ArrowLeft: () => turn(-12, 0), ArrowRight: () => turn(12, 0), ArrowUp: () => turn(0, -12), ArrowDown: () => turn(0, 12), "+": () => zoom(0.9), "-": () => zoom(1.1) }[event.key];
  if (view && !["INPUT", "SELECT"].includes(event.target.tagName)) { event.preventDefault(); moveView(view); }
  else if (event.key === "Escape") lift();
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
  if (first) {
    listMaterials();
    if (!drawn) { take_scene({ low: state.low, size: state.size }); choose(); }
    seen.observe(canvas);
  }
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
    if (drawn) listViews();
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
  open = false; received = 0; felt = []; down.clear(); stroking.clear();
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
  const [, w, h] = fitted(pad);
  if (!scene) return;
  if (!drawn) {
    const [x, y, z] = scene.low, [a, b] = scene.size, corners = [[x, y, z], [x + a, y, z], [x + a, y + b, z], [x, y + b, z]].map(project);
    ink.strokeStyle = colour("--line"); ink.setLineDash([6, 6]); ink.beginPath();
    for (const corner of corners) ink.lineTo(corner.x, corner.y);
    ink.closePath(); ink.stroke(); ink.setLineDash([]);
  }
  for (const [place, newtons] of felt) drawStylus(place, newtons);
  const each = project(camera.target).scale, long = 10 ** Math.floor(Math.log10(0.4 * w / each)); // scale in the middle
  ink.fillStyle = colour("--dim");
  ink.fillRect(12, h - 14, long * each, 2);
  ink.font = "12px system-ui, sans-serif";
  ink.fillText(long < 1 ? `${Math.round(long * 1e3)} mm` : `${long} m`, 12, h - 20);
}

const STYLUS_PX = 150; // length of the stylus

function drawStylus(place, newtons) { // a pointer has no orientation: the stylus leans to the right, towards the hand
  const tip = project(place), { right } = lens(), top = [0.35, 0.25, 0.9].reduce((p, part, i) => add(p, [right, cross(right, [0, 0, 1]), [0, 0, 1]][i], part * STYLUS_PX / tip.scale), place);
  const end = project(top), [dx, dy] = [end.x - tip.x, end.y - tip.y], size = Math.hypot(dx, dy) || 1, [nx, ny] = [-dy / size, dx / size];
  const at = (along, aside) => [tip.x + along * dx + aside * nx, tip.y + along * dy + aside * ny];
  const shape = (points, fill) => {
    ink.beginPath();
    for (const [along, aside] of points) ink.lineTo(...at(along, aside));
    ink.closePath(); ink.fillStyle = fill; ink.fill();
  };
  const radius = 5 + 8 * Math.sqrt(Math.min(newtons, 4)), wide = 6;
  for (const [style, width] of [["rgba(0,0,0,.6)", 3.5], ["#ffffff", 2]]) { // ring: the force
    ink.beginPath(); ink.arc(tip.x, tip.y, radius, 0, 7); ink.strokeStyle = style; ink.lineWidth = width; ink.stroke();
  }
  const barrel = ink.createLinearGradient(...at(0, -wide), ...at(0, wide));
  for (const [part, tone] of [[0, "#2b3440"], [0.35, "#93a1b3"], [1, "#1b222b"]]) barrel.addColorStop(part, tone);
  shape([[0.12, -wide - 1], [0, -1.5], [0, 1.5], [0.12, wide + 1], [1, wide + 1], [1, -wide - 1]], "rgba(255,255,255,.75)");
  shape([[0.13, -wide], [0.13, wide], [1, wide], [1, -wide]], barrel);
  shape([[0, -0.8], [0, 0.8], [0.13, wide], [0.13, -wide]], "#d9dee5");
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
  const last = felt[felt.length - 1], swatch = last && state.swatches[last[3]];
  $("swatch").value = swatch ? swatch[0] : last ? "surface" : "no contact";
  $("chip").style.setProperty("--chip", swatch ? swatch[1] : "transparent");
  $("numbers").value = last ? `${last[1].toFixed(1)} N, ${last[2].toFixed(1)} mm` : "";
  const recent = traces.a.values.slice(-Math.ceil(0.1 / state.bin_s));
  const rms = Math.sqrt(recent.reduce((sum, x) => sum + x * x, 0) / (recent.length || 1));
  $("level").firstElementChild.style.transform = `scaleX(${Math.min(Math.log10(1 + 9 * rms / 20), 1)})`;
  requestAnimationFrame(draw);
}

if (matchMedia("(pointer: coarse)").matches) $("hint").textContent = "One finger strokes, two fingers turn and zoom.";
load();
deepen();
$("volumenum").value = `${Math.round($("volume").value * 100)} %`;
connect();
draw();
window.hapscene = { get state() { return state; }, get felt() { return felt; }, down, traces, camera, project, get drawn() { return drawn; } };
