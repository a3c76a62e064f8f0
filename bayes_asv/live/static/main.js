// The page: receives frames, draws at most once per screen refresh, and sends controls.

import { Curves, Link, send } from "./link.js";
import { Panels, capital, setText } from "./panels.js";
import { plain } from "./charts.js";

const $ = (id) => document.getElementById(id);
const times = { start: 0, now: 0, length: null, window: 10 };
const stats = { received: 0, drawn: 0, at: 0 };
let scene = null;
let panels = null;
let traces = null;
let run = null;
let frame = null;
let texts = null; // sent with every third frame
let drawing = false;
let seeking = false;

window.liveStats = stats; // read by the benchmark

function receiveScene(message) {
  const first = scene === null;
  scene = message;
  traces = new Curves(message.points.traces);
  run = new Curves(message.points.run);
  times.length = message.duration;
  document.title = `${message.vehicle}: live view`;
  setText($("vehicle"), message.vehicle);
  setText($("source"), message.live ? `live from ${message.source}` : message.source);
  document.body.classList.toggle("live", message.live);
  if (first) panels = new Panels(message, times);
}

function receiveFrame(message) {
  stats.received += 1;
  frame = message;
  if (message.traces) {
    traces.update(message.traces);
    run.update(message.run);
    times.now = message.time;
    times.start = message.time - message.position;
    texts = message.now ?? texts;
  }
  if (!drawing) requestAnimationFrame(draw);
  drawing = true;
}

function draw() {
  drawing = false;
  controls();
  if (texts) {
    const { short, long, tone } = texts.consistency;
    $("verdict").className = `verdict tone-${tone}`;
    setText($("verdict-short"), capital(short));
    setText($("verdict-long"), long);
    panels.setTexts(texts);
    texts = null;
  }
  if (frame.state === "waiting") {
    setText($("verdict-long"), scene.live ? `No row has come from ${scene.source} yet.` : "The filter is starting.");
  }
  drawCurves();
  stats.drawn += 1;
  stats.at = times.now;
}

// A new connection, as after another window was chosen, begins without a point.
function drawCurves() {
  if (traces?.time.length) panels.draw(traces, run);
}

function controls() {
  const { state, speed, position, end, notes } = frame;
  const failed = state === "failed";
  const running = state === "playing" || state === "waiting";
  const label = running ? "Pause" : state === "ended" && !scene.live ? "Again" : scene.live ? "Live" : "Play";
  setText($("play"), label);
  $("play").setAttribute("aria-pressed", String(state === "paused"));
  for (const button of $("speeds").children) {
    button.setAttribute("aria-pressed", String(Number(button.dataset.speed) === speed));
  }
  const length = times.length ?? end;
  if (!seeking) $("seek").value = length > 0 ? Math.round((1000 * position) / length) : 0;
  const unusual = [0.1, 1, 10].includes(speed) || scene.live ? "" : `, ×${plain(speed)}`;
  const status = state === "playing" ? unusual : `, ${state}`;
  const of = scene.live ? "" : ` of ${plain(length, 2)}`;
  setText($("clock"), `${plain(position, 2)}${of} s${status}`);
  if (failed) setBanner(notes[0]);
  setNotes(failed ? notes.slice(1) : notes);
}

function setNotes(notes) {
  const list = $("notes");
  if (list.dataset.text === notes.join("\n")) return;
  list.dataset.text = notes.join("\n");
  list.replaceChildren(
    ...notes.map((note) => {
      const item = document.createElement("li");
      item.textContent = note;
      return item;
    }),
  );
}

function setBanner(text) {
  $("banner").hidden = !text;
  setText($("banner"), text);
}

const link = new Link({
  scene: receiveScene,
  frame: receiveFrame,
  connected: (connected) => setBanner(connected ? "" : "The connection to the program is lost; reconnecting …"),
  ended: () => setBanner("The program has ended. This is its last state."),
});

function toggle() {
  if (frame === null) return;
  if (frame.state === "ended" && !scene.live) send("restart");
  else send(frame.state === "paused" || frame.state === "ended" ? "play" : "pause");
}

$("play").addEventListener("click", toggle);
$("restart").addEventListener("click", () => send("restart"));
for (const button of $("speeds").children) {
  button.addEventListener("click", () => send("speed", Number(button.dataset.speed)));
}
$("seek").addEventListener("pointerdown", () => { seeking = true; });
$("seek").addEventListener("change", () => { seeking = false; });
$("seek").addEventListener("input", () => {
  if (frame) send("seek", ($("seek").value / 1000) * (times.length ?? frame.end));
});
$("window").addEventListener("change", () => {
  times.window = Number($("window").value);
  link.open(times.window);
});
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("button, select, input, a")) return;
  const speed = { ".": 0.1, 1: 1, 0: 10 }[event.key];
  if (event.key === " ") toggle();
  else if (event.key.toLowerCase() === "r") send("restart");
  else if (speed) send("speed", speed);
  else return;
  event.preventDefault();
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  panels?.restyle();
  drawCurves();
});

times.window = Number($("window").value);
link.open(times.window);
