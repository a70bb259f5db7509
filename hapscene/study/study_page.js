// Shows what the server asks, has it played, times the answer. It knows nothing of what is compared.

const $ = (id) => document.getElementById(id);
const SCREENS = ["begin", "trial", "break", "end"];
let state = {}, socket = null, open = false;
let shown = ""; // the trial whose buttons stand there
let endedAt = 0; // when what was played last has ended [ms]

const send = (message) => { if (open) socket.send(JSON.stringify(message)); };
const ready = () => state.screen === "trial" && state.heard.length === state.intervals.length && !state.playing;

function play(first, end) {
  if (!open || state.screen !== "trial" || state.playing) return;
  state.playing = true;
  draw();
  send({ play: [state.number, first, end] });
}

function answer(choice) {
  if (!open || !ready() || !endedAt) return;
  send({ answer: [state.number, choice, (performance.now() - endedAt) / 1e3] });
  endedAt = 0;
}

const go = () => send({ go: true });
for (const id of ["go", "rested"]) $(id).addEventListener("click", go);
$("play").addEventListener("click", () => play(0, state.intervals.length));

addEventListener("keydown", (event) => {
  if (event.repeat || event.ctrlKey || event.metaKey || event.altKey || state.screen !== "trial") return;
  if (event.key === " ") {
    event.preventDefault(); // no button is pressed by it, nor the page scrolled
    play(0, state.intervals.length);
    return;
  }
  const choice = keys().indexOf(event.key.toUpperCase());
  if (choice >= 0) answer(choice);
});
addEventListener("keyup", (event) => { if (event.key === " " && state.screen === "trial") event.preventDefault(); });

function keys() { // which key gives which choice
  return state.choices.map((choice, k) => state.kind === "pair" ? `${k + 1}` : choice.length === 1 ? choice : "");
}

// --- what is shown

function take(next) {
  const before = state;
  state = next;
  if (state.screen !== "trial" || before.number !== state.number) endedAt = 0;
  else if (before.playing && !state.playing) endedAt = performance.now();
  if (ready() && !endedAt) endedAt = performance.now(); // the page is new, or the connection was gone
  draw();
  if (state.screen !== before.screen) $(state.screen).querySelector("button.main")?.focus();
}

function draw() {
  document.title = $("title").textContent = state.title;
  $("said").hidden = !state.said;
  $("said").textContent = state.said;
  for (const screen of SCREENS) $(screen).hidden = screen !== state.screen;
  $("progress").hidden = state.screen === "begin";
  $("bar").max = state.total;
  $("bar").value = state.done;
  $("count").textContent = `${state.done} of ${state.total}`;
  const told = state.screen === "break" || state.screen === "trial" && !state.playing && !state.heard.length;
  $("status").textContent = told ? state.feedback : ""; // of the practice before
  if (state.screen === "begin") drawBegin();
  if (state.screen === "trial") drawTrial();
}

function drawBegin() {
  for (const id of ["consent", "instructions"]) $(id).textContent = state[id];
  const again = state.done ? `Welcome back: ${state.done} of ${state.total} are answered. ` : "";
  const practice = state.practices ? `It begins with ${state.practices} for practice.` : "";
  $("practices").textContent = again + practice;
  $("go").textContent = state.consent ? "I agree: begin" : state.done ? "Go on" : "Begin";
}

function drawTrial() {
  const trial = `${state.number} of ${state.title}`;
  if (shown !== trial) {
    shown = trial;
    $("question").textContent = state.question;
    $("practice").hidden = !state.practice;
    const single = state.intervals.length === 1;
    $("intervals").hidden = single;
    $("intervals").replaceChildren(...state.intervals.map((label, k) => button(label, () => play(k, k + 1), `Play ${label} alone`)));
    $("choices").replaceChildren(...state.choices.map((choice, k) => button(choice, () => answer(k))));
    $("choices").classList.toggle("many", state.choices.length > 4);
    const [low, high] = $("ends").children;
    $("ends").hidden = state.ends.length !== 2;
    [low.textContent, high.textContent] = state.ends.length === 2 ? [`${state.choices[0]}: ${state.ends[0]}`, `${state.choices.at(-1)}: ${state.ends[1]}`] : ["", ""];
  }
  const all = ready(), any = state.heard.length > 0;
  $("play").disabled = state.playing;
  $("play").firstElementChild.textContent = state.playing ? (state.felt ? "feel it now …" : "listen …") : any ? "Play again" : "Play";
  [...$("intervals").children].forEach((one, k) => {
    one.disabled = state.playing || !all;
    one.classList.toggle("playing", state.playing && state.plays === k);
    one.classList.toggle("heard", state.heard.includes(k));
  });
  for (const one of $("choices").children) one.disabled = !all;
  const said = keys().filter(Boolean), pressed = said.length > 2 ? `${said[0]} to ${said.at(-1)}` : said.join(" or ");
  $("hint").textContent = all && pressed ? `Answer by a button, or by the keys ${pressed}.` : "";
}

function button(text, press, told) {
  const made = document.createElement("button");
  made.type = "button";
  made.textContent = text;
  if (told) made.setAttribute("aria-label", told);
  made.addEventListener("click", press);
  return made;
}

// --- the connection

function connect() {
  socket = new WebSocket(new URL("socket", location.href.replace(/^http/, "ws")));
  socket.onopen = () => { open = true; };
  socket.onmessage = (event) => {
    const message = JSON.parse(event.data);
    if ("plays" in message) { state.plays = message.plays; state.playing = true; draw(); } else take(message);
  };
  socket.onclose = () => {
    open = false;
    if (state.screen === "end") return;
    $("said").hidden = false;
    $("said").textContent = "Not connected: please call whoever leads the study. Your answers so far are kept.";
    setTimeout(connect, 1000);
  };
}

connect();
window.study = { get state() { return state; } };
