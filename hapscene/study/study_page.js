// The page of a study session: shows the trial, requests playback, measures the response time. It does not receive
// which stimuli are compared.

const $ = (id) => document.getElementById(id);
const SCREENS = ["begin", "trial", "end"];
let state = {}, socket = null, open = false;
let shown = ""; // the trial whose buttons are on the page
let endedAt = 0; // end of the last playback [ms]

const send = (message) => { if (open) socket.send(JSON.stringify(message)); };
const ready = () => state.screen === "trial" && state.played.length === state.intervals.length && !state.playing;

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

$("begin-button").addEventListener("click", () => send({ continue: true }));
$("play").addEventListener("click", () => play(0, state.intervals.length));

addEventListener("keydown", (event) => {
  if (event.repeat || event.ctrlKey || event.metaKey || event.altKey || state.screen !== "trial") return;
  if (event.key === " ") {
    event.preventDefault(); // it neither presses a button nor scrolls the page
    play(0, state.intervals.length);
    return;
  }
  const choice = keys().indexOf(event.key.toUpperCase());
  if (choice >= 0) answer(choice);
});
addEventListener("keyup", (event) => { if (event.key === " " && state.screen === "trial") event.preventDefault(); });

function keys() { // the key of each choice
  return state.choices.map((choice, k) => state.kind === "pair" ? `${k + 1}` : choice.length === 1 ? choice : "");
}

// --- display

function update(next) {
  const before = state;
  state = next;
  if (state.screen !== "trial" || before.number !== state.number) endedAt = 0;
  else if (before.playing && !state.playing) endedAt = performance.now();
  if (ready() && !endedAt) endedAt = performance.now(); // the page was reloaded, or the connection was interrupted
  draw();
  if (state.screen !== before.screen) $(state.screen).querySelector("button.main")?.focus();
}

function draw() {
  document.title = $("title").textContent = state.title;
  $("error").hidden = !state.error;
  $("error").textContent = state.error;
  for (const screen of SCREENS) $(screen).hidden = screen !== state.screen;
  $("progress").hidden = state.screen === "begin";
  $("bar").max = state.total;
  $("bar").value = state.done;
  $("count").textContent = `${state.done} of ${state.total}`;
  $("status").textContent = "";
  if (state.screen === "begin") drawBegin();
  if (state.screen === "trial") drawTrial();
}

function drawBegin() {
  for (const id of ["consent", "instructions"]) $(id).textContent = state[id];
  $("again").textContent = state.done ? `Welcome back. You have answered ${state.done} of ${state.total} questions.` : "";
  $("begin-button").textContent = state.consent ? "I agree; begin" : state.done ? "Continue" : "Begin";
}

function drawTrial() {
  const trial = `${state.number} of ${state.title}`;
  if (shown !== trial) {
    shown = trial;
    $("question").textContent = state.question;
    const single = state.intervals.length === 1;
    $("intervals").hidden = single;
    $("intervals").replaceChildren(...state.intervals.map((label, k) => button(label, () => play(k, k + 1), `Play ${label} alone`)));
    $("choices").replaceChildren(...state.choices.map((choice, k) => button(choice, () => answer(k))));
    $("choices").classList.toggle("many", state.choices.length > 4);
    const [low, high] = $("ends").children;
    $("ends").hidden = state.ends.length !== 2;
    [low.textContent, high.textContent] = state.ends.length === 2 ? [`${state.choices[0]}: ${state.ends[0]}`, `${state.choices.at(-1)}: ${state.ends[1]}`] : ["", ""];
  }
  const all = ready(), any = state.played.length > 0;
  $("play").disabled = state.playing;
  $("play").firstElementChild.textContent = state.playing ? (state.handle ? "Feel the handle now …" : "Listen now …") : any ? "Play again" : "Play";
  [...$("intervals").children].forEach((one, k) => {
    one.disabled = state.playing || !all;
    one.classList.toggle("playing", state.playing && state.plays === k);
    one.classList.toggle("played", state.played.includes(k));
  });
  for (const one of $("choices").children) one.disabled = !all;
  const known = keys().filter(Boolean), range = known.length > 2 ? `${known[0]} to ${known.at(-1)}` : known.join(" or ");
  $("hint").textContent = all && range ? `Press a button, or key ${range}.` : "";
}

function button(text, press, label) {
  const made = document.createElement("button");
  made.type = "button";
  made.textContent = text;
  if (label) made.setAttribute("aria-label", label);
  made.addEventListener("click", press);
  return made;
}

// --- the connection

function connect() {
  socket = new WebSocket(new URL("socket", location.href.replace(/^http/, "ws")));
  socket.onopen = () => { open = true; };
  socket.onmessage = (event) => {
    const message = JSON.parse(event.data);
    if ("plays" in message) { state.plays = message.plays; state.playing = true; draw(); } else update(message);
  };
  socket.onclose = () => {
    open = false;
    if (state.screen === "end") return;
    $("error").hidden = false;
    $("error").textContent = "No connection to the study program. Please tell the experimenter. Your answers so far are saved.";
    setTimeout(connect, 1000);
  };
}

connect();
window.study = { get state() { return state; } };
