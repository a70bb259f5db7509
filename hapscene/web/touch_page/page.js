// The page of an exported scene: plays what the pointer touches (sound.js) on the drawn scene (view.js).
"use strict";
const PEN_N = 3, SAMPLE_PX = 2;  // force at full pen pressure, sampling of a stroke
take_scene(JSON.parse($("data").textContent));
opacity = () => pressed($("look")) ? 0 : OPACITY;

// --- sound

let audio = null, move = () => {}, level = 0;

async function load_sound(unpacked) {
  if (navigator.audioSession) navigator.audioSession.type = "playback";  // sounds on an iPhone that is muted, too
  audio = new AudioContext({ latencyHint: "interactive" });
  audio.onstatechange = show_sound;
  // Chromium loads no worklet from a Blob if the page is a file; without encryption, a server's page has no worklets
  const loaded = await audio.audioWorklet?.addModule(`data:text/javascript;charset=utf-8,${encodeURIComponent($("sound").textContent)}`)
    .then(() => true, () => false);
  await unpacked;
  const swatches = scene.swatches.map((swatch) => ({ ...swatch, table: array(swatch.table), tap: array(swatch.tap) }));
  if (loaded) {
    const node = new AudioWorkletNode(audio, "touch", { numberOfInputs: 0, outputChannelCount: [1], processorOptions: { swatches, seed: Date.now() } });
    node.port.onmessage = ({ data }) => show_level(data);
    node.connect(audio.destination);
    move = (movements) => node.port.postMessage(movements);
  } else {
    const player = new Player(swatches, audio.sampleRate, Date.now()), node = audio.createScriptProcessor(512, 0, 1);
    node.onaudioprocess = ({ outputBuffer }) => { player.fill(outputBuffer.getChannelData(0)); show_level(player.peak); };
    node.connect(audio.destination);
    move = (movements) => player.move(movements);
  }
  show_sound();
}
function sound_on() {
  if (audio?.state !== "running" && pressed($("mute"))) audio?.resume();
}
function show_sound() { $("start").hidden = audio?.state === "running" || !pressed($("mute")); }

function show_level(peak) {
  level = peak;
  $("level").firstChild.style.transform = `scaleX(${Math.min(1.4 * peak, 1)})`;
  if (stroke?.finger && stroke.swatch !== NO_SURFACE && peak > 0.02) navigator.vibrate?.(Math.round(5 + 25 * Math.min(2 * peak, 1)));
}

// --- strokes: the path between two events is sampled, so that borders and edges are met where they are

let stroke = null;  // {id, x, y, ms, place, swatch, finger}

const force_of = (event) => {
  if (event.pointerType === "pen" && event.pressure > 0) $("force").value = PEN_N * event.pressure;
  return +$("force").value;
};

function begin(event) {
  const x = event.offsetX, y = event.offsetY;
  stroke = { id: event.pointerId, x, y, ms: event.timeStamp, swatch: NO_SURFACE, finger: event.pointerType === "touch", ...surface_at(x, y) };
  move([{ swatch: stroke.swatch, force: force_of(event), speed: 0, s: 0 }]);
  if (stroke.finger && stroke.swatch !== NO_SURFACE) navigator.vibrate?.(20);
  show_contact(0);
}

function go_on(event, left, top) {
  const x = event.clientX - left, y = event.clientY - top, s = Math.min(Math.max((event.timeStamp - stroke.ms) / 1000, 0.0005), 0.05);
  const force = force_of(event), count = Math.max(Math.ceil(Math.hypot(x - stroke.x, y - stroke.y) / SAMPLE_PX), 1), movements = [];
  let travel = 0, before = stroke;
  for (let i = 1; i <= count; i++) {
    const part = i / count, here = surface_at(stroke.x + part * (x - stroke.x), stroke.y + part * (y - stroke.y));
    let step = 0;
    if (here.place && before.place) // an edge of a body in front of another is no distance to slide
      step = Math.min(Math.hypot(...add(here.place, before.place, -1)), 4 * SAMPLE_PX * here.pixel);
    const speed = scene.scale * step / (s / count), last = movements.at(-1);
    if (last?.swatch === here.swatch) Object.assign(last, { speed: (last.speed * last.s + speed * s / count) / (last.s + s / count), s: last.s + s / count });
    else movements.push({ swatch: here.swatch, force, speed, s: s / count });
    travel += scene.scale * step;
    before = here;
  }
  move(movements);
  Object.assign(stroke, { place: null }, before, { x, y, ms: event.timeStamp });
  show_contact(travel / s);
}

function end() {
  if (!stroke) return;
  stroke = null;
  move([{ swatch: NO_SURFACE, force: 0, speed: 0, s: 0 }]);
  show_contact(0);
}

let shown_speed = 0;
function show_contact(speed) {
  const now = scene.swatches[stroke?.swatch];
  shown_speed = speed && shown_speed + 0.3 * (speed - shown_speed);
  $("name").textContent = now ? now.name : stroke ? "beside the body" : "not touching";
  $("chip").style.background = now ? now.colour : "transparent";
  $("numbers").textContent = now ? `${(+$("force").value).toFixed(1)} N · ${Math.round(1000 * shown_speed)} mm/s` : "";
  show_force();
  $("ring").hidden = !stroke;
  if (stroke) {
    $("ring").style.transform = `translate(${stroke.x}px, ${stroke.y}px) scale(${1 + Math.min(level, 1)})`;
    $("ring").style.background = now ? now.colour : "transparent";
  }
}
function show_force() { $("newton").textContent = `${(+$("force").value).toFixed(1)} N`; }

// --- pointers: one strokes; the right button, two fingers or the button "Turn" turn, and zoom

const pointers = new Map();

canvas.addEventListener("pointerdown", (event) => {
  event.preventDefault();
  sound_on();
  canvas.setPointerCapture(event.pointerId);
  pointers.set(event.pointerId, event);
  const turns = event.button !== 0 || event.ctrlKey || event.altKey || event.shiftKey || pressed($("turn"));
  if (pointers.size === 1 && !turns) begin(event);
  else end();
});
canvas.addEventListener("pointermove", (event) => {
  const old = pointers.get(event.pointerId);
  if (!old) return;
  if (stroke?.id === event.pointerId) {
    const { left, top } = canvas.getBoundingClientRect(), all = event.getCoalescedEvents?.() ?? [];
    for (const one of all.length ? all : [event]) go_on(one, left, top);
  } else {
    const dx = (event.clientX - old.clientX) / pointers.size, dy = (event.clientY - old.clientY) / pointers.size;
    const other = [...pointers.values()].find((one) => one !== old);
    if (event.buttons & 4 || event.shiftKey) pan(dx, dy);
    else turn(dx, dy);
    if (other) zoom(Math.hypot(old.clientX - other.clientX, old.clientY - other.clientY) / Math.max(Math.hypot(event.clientX - other.clientX, event.clientY - other.clientY), 1));
  }
  pointers.set(event.pointerId, event);
});
for (const kind of ["pointerup", "pointercancel", "lostpointercapture"])
  canvas.addEventListener(kind, (event) => {
    pointers.delete(event.pointerId);
    if (stroke?.id === event.pointerId) end();
    if (kind === "pointerup") sound_on();
  });
canvas.addEventListener("contextmenu", (event) => event.preventDefault());
canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  zoom(Math.exp(0.0015 * Math.min(Math.max(event.deltaY, -200), 200)));
}, { passive: false });
canvas.addEventListener("keydown", (event) => {
  const act = { ArrowLeft: () => turn(-12, 0), ArrowRight: () => turn(12, 0), ArrowUp: () => turn(0, -12), ArrowDown: () => turn(0, 12), "+": () => zoom(0.9), "-": () => zoom(1.1) }[event.key];
  if (!act) return;
  event.preventDefault();
  act();
});
canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
canvas.addEventListener("webglcontextrestored", () => { set_up(); redraw(); });
document.addEventListener("visibilitychange", () => { if (document.hidden) end(); });

// --- panel

function toggle(button, then) {
  button.addEventListener("click", () => { press(button, !pressed(button)); then(pressed(button)); });
}

// Plays a stroke over a swatch, with the set force: speed rises to 0.15 m/s and falls.
let sampling = 0;
function sample(swatch) {
  clearInterval(sampling);
  let ms = 0;
  sampling = setInterval(() => {
    ms += 20;
    const speed = 0.15 * Math.sin(Math.PI * Math.min(Math.max(ms - 200, 0) / 1000, 1));
    if (ms < 1200) move([{ swatch, force: +$("force").value, speed, s: 0.02 }]);
    else { clearInterval(sampling); move([{ swatch: NO_SURFACE, force: 0, speed: 0, s: 0 }]); }
  }, 20);
}

function element(parent, tag, text, of = {}) {
  const made = Object.assign(document.createElement(tag), of);
  made.textContent = text;
  return parent.appendChild(made);
}

function show_panel() {
  scene.swatches.forEach((swatch, i) => {
    const button = element(element($("legend"), "li", ""), "button", "", { title: `Play a stroke over ${swatch.name}` });
    element(button, "i", "").style.background = swatch.colour;
    element(button, "bdi", swatch.name);
    element(button, "b", "▶").setAttribute("aria-hidden", "true");
    element(button, "small", swatch.words);
    const mark = (index) => () => { marked = index; redraw(); };
    button.addEventListener("click", () => { sound_on(); sample(i); });
    for (const kind of ["pointerenter", "focus"]) button.addEventListener(kind, mark(i));
    for (const kind of ["pointerleave", "blur", "pointercancel"]) button.addEventListener(kind, mark(-1));
  });
  const several = scene.bodies.length > 1;
  const show = (body, quick = false) => {
    if (!body) Object.assign(camera, START);
    fit(body, quick);
    $("task").textContent = (body ?? scene.bodies[scene.main]).task;
    for (const button of $("bodies").children) press(button, several && button.body === body);
  };
  for (const body of [null, ...(several ? scene.bodies : [])]) {
    const button = element($("bodies"), "button", body?.name ?? (several ? "All" : "Reset view"));
    button.body = body;
    button.addEventListener("click", () => show(body));
  }
  toggle($("turn"), (on) => { canvas.style.cursor = on ? "grab" : ""; });
  toggle($("mute"), (on) => { if (on) audio?.resume(); else audio?.suspend(); show_sound(); });
  toggle($("look"), redraw);
  $("look").hidden = !scene.look;
  $("start").addEventListener("click", sound_on);
  $("force").addEventListener("input", show_force);
  $("hint").textContent = matchMedia("(pointer: coarse)").matches ? "One finger strokes, two fingers turn and zoom" : "Drag: stroke · right button: turn · wheel: zoom";
  show_force();
  show_contact(0);
  show(narrow.matches ? scene.bodies[scene.main] : null, true);
}

async function main() {
  if (!gl || typeof DecompressionStream === "undefined") {
    $("hint").textContent = "This browser is too old for the page: it has no WebGL 2 or no DecompressionStream.";
    return;
  }
  const unpacked = unpack(scene.data).then((data) => { block = data; }), sound = load_sound(unpacked);
  await load_pictures();
  await unpacked;
  set_up();
  show_panel();
  new ResizeObserver(redraw).observe(canvas);
  dark.addEventListener("change", redraw);
  await Promise.all([sound, new Promise((shown) => requestAnimationFrame(() => requestAnimationFrame(shown)))]);
  document.documentElement.dataset.ready = performance.now();
}
main();
