// Shows what the recording holds and lacks, as often as the server tells; sends one word, stop.

const $ = (id) => document.getElementById(id), svg = "http://www.w3.org/2000/svg";
const BOX = { left: 64, top: 12, right: 612, bottom: 386 }, SILENT_MS = 2000;
let socket = null, heard = 0, shown = "", ended = false, stopping = false, count = 0, cells = [];

function add(kind, attributes, text = "") {
  const made = document.createElementNS(svg, kind);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.textContent = text;
  $("plane").append(made);
  return made;
}

const spread = (k, n, from, to) => from + (to - from) * k / n;
const number = (value) => value >= 100 ? value.toFixed(0) : String(+value.toPrecision(2));

// --- the plane: force upward, speed to the right, both by logarithm

function build(state) { // its cells, once
  $("plane").replaceChildren();
  const rows = state.share.length, columns = state.share[0].length;
  cells = state.share.map((row, i) => row.map((_, j) => {
    const x = spread(j, columns, BOX.left, BOX.right), w = (BOX.right - BOX.left) / columns;
    const h = (BOX.bottom - BOX.top) / rows, y = BOX.bottom - (i + 1) * h;
    add("rect", { class: "cell", x, y, width: w, height: h });
    const fill = add("rect", { class: "fill part", x: x + 1, y: y + h, width: w - 2, height: 0 });
    const mid = [x + w / 2, y + h / 2];
    const tick = add("path", { class: "tick", d: `M${mid[0] - 12} ${mid[1]}l9 9 16 -18`, visibility: "hidden" });
    return { x, y, w, h, fill, tick };
  }));
  state.force_N?.forEach((f, i) =>
    add("text", { x: BOX.left - 8, y: spread(i, rows, BOX.bottom, BOX.top) + 6, "text-anchor": "end" }, number(f)));
  state.speed_m_s?.forEach((v, j) =>
    add("text", { x: spread(j, columns, BOX.left, BOX.right), y: BOX.bottom + 22, "text-anchor": "middle" }, number(1e3 * v)));
  if (state.force_N) add("text", { x: 16, y: 200, "text-anchor": "middle", transform: "rotate(-90 16 200)" }, "force [N]");
  if (state.speed_m_s) add("text", { x: 346, y: BOX.bottom + 46, "text-anchor": "middle" }, "speed [mm/s]");
  cells.aim = add("rect", { class: "aim", rx: 6, visibility: "hidden" });
  cells.hand = add("circle", { class: "hand", r: 11 });
}

function along(value, edges, from, to) { // by logarithm, held a little beyond the ends
  if (!edges) return (from + to) / 2;
  const low = edges[0], high = edges[edges.length - 1];
  const share = Math.log(Math.max(value, 1e-9) / low) / Math.log(high / low);
  return from + (to - from) * Math.min(Math.max(share, -0.02), 1.02);
}

function draw(state) {
  if (cells.length !== state.share.length) build(state);
  state.share.forEach((row, i) => row.forEach((share, j) => {
    const { x, y, w, h, fill, tick } = cells[i][j];
    fill.setAttribute("y", y + h - share * (h - 1));
    fill.setAttribute("height", Math.max(share * (h - 1) - 1, 0));
    fill.classList.toggle("part", share < 1);
    tick.setAttribute("visibility", share < 1 ? "hidden" : "visible");
    if (state.target?.[0] === i && state.target[1] === j)
      for (const [name, value] of Object.entries({ x: x + 3, y: y + 3, width: w - 6, height: h - 6 })) cells.aim.setAttribute(name, value);
  }));
  cells.aim.setAttribute("visibility", state.target && !state.ended ? "visible" : "hidden");
  const [force, speed, doing] = state.at;
  cells.hand.classList.toggle("air", doing === "air");
  cells.hand.setAttribute("cx", along(speed, state.speed_m_s, BOX.left, BOX.right));
  cells.hand.setAttribute("cy", along(force, state.force_N, BOX.bottom, BOX.top));
}

// --- words and numbers

function put(id, text) { if ($(id).textContent !== text) $(id).textContent = text; } // else it would be read out again

function tell(state) {
  const all = state.share.flat(), done = all.filter((share) => share >= 1).length;
  put("advice", state.ended ? `It has ended: ${state.enough ? "every cell is filled" : state.ended}.` : state.advice);
  put("wrong", state.warnings.join("; "));
  put("time", `${state.seconds.toFixed(1)} s`);
  const mean = all.reduce((sum, share) => sum + share, 0) / all.length;
  $("done").value = mean;
  put("share", `${Math.floor(100 * mean)} %`);
  const [rms, peak] = state.level;
  $("level").value = Math.min(Math.log10(1 + 9 * rms / 20), 1);
  put("rms", `${number(rms)} m/s², peak ${number(peak)}`);
  const said = `Force and speed: ${done} of ${all.length} cells are filled`;
  if ($("plane").getAttribute("aria-label") !== said) $("plane").setAttribute("aria-label", said);
  const rows = [];
  if (state.force_N) rows.unshift(["force", `${state.at[0].toFixed(2)} N`]);
  if (state.speed_m_s) rows.unshift(["speed", `${(1e3 * state.at[1]).toFixed(0)} mm/s`]);
  rows.push(...Object.entries(state.lost).map(([name, value]) => [name, String(value)]));
  if ($("numbers").children.length !== 2 * rows.length)
    $("numbers").replaceChildren(...rows.flatMap(() => [document.createElement("dt"), document.createElement("dd")]));
  rows.flat().forEach((text, k) => { const at = $("numbers").children[k]; if (at.textContent !== text) at.textContent = text; });
  const notes = [...state.limits, ...state.lacks.map((text) => `then: ${text}`)].join("\n");
  if (notes !== shown) {
    shown = notes;
    $("notes").replaceChildren(...notes.split("\n").filter(Boolean).map((text) => {
      const item = document.createElement("li");
      item.textContent = text;
      return item;
    }));
  }
}

function take(state) {
  heard = performance.now();
  count += 1;
  if (!state.share) { put("advice", state.advice); return; }
  draw(state);
  tell(state);
  ended = !!state.ended;
  $("stop").disabled = ended;
}

// --- the line

function connect() {
  socket = new WebSocket(new URL("socket", location.href.replace(/^http/, "ws")));
  socket.onopen = stop;
  socket.onmessage = (event) => take(JSON.parse(event.data));
  socket.onclose = lose;
}

function stop() { if (stopping && socket.readyState === 1) socket.send(JSON.stringify("stop")); } // a line that was lost hears it later

function lose() {
  heard = 0;
  if (ended) return;
  put("wrong", "not connected: the program has ended, or the network is gone");
  setTimeout(connect, 1000);
}

setInterval(() => { // a network that is gone closes nothing
  if (ended || !heard || performance.now() - heard < SILENT_MS || !cells.length) return;
  socket.onclose = socket.onmessage = null;
  socket.close();
  lose();
}, 500);

$("stop").addEventListener("click", () => { stopping = true; stop(); });
connect();
window.hapscene = { get count() { return count; } };
