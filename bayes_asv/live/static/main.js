// The page: takes frames as they come, draws at most once a screen refresh, and passes on wishes.

import { Curves, Link, ask } from "./link.js";
import { Panels, capital, say } from "./panels.js";
import { plain } from "./charts.js";

const $ = (id) => document.getElementById(id);
const times = { start: 0, now: 0, length: null, window: 10 };
const stats = { received: 0, drawn: 0, at: 0 };
let scene = null;
let panels = null;
let traces = null;
let run = null;
let frame = null;
let words = null; // they come with every third frame
let fresh = false;
let seeking = false;

window.liveStats = stats; // read by the benchmark

function meet(said) {
  const first = scene === null;
  scene = said;
  traces = new Curves(said.points.traces);
  run = new Curves(said.points.run);
  times.length = said.duration;
  document.title = `${said.vehicle}: live view`;
  say($("vehicle"), said.vehicle);
  say($("source"), said.live ? `live from ${said.source}` : said.source);
  document.body.classList.toggle("live", said.live);
  if (first) panels = new Panels(said, times);
}

function take(said) {
  stats.received += 1;
  frame = said;
  if (said.traces) {
    traces.take(said.traces);
    run.take(said.run);
    times.now = said.time;
    times.start = said.time - said.position;
    words = said.now ?? words;
  }
  if (!fresh) requestAnimationFrame(draw);
  fresh = true;
}

function draw() {
  fresh = false;
  controls();
  if (words) {
    const { short, long, tone } = words.consistency;
    $("verdict").className = `verdict tone-${tone}`;
    say($("verdict-short"), capital(short));
    say($("verdict-long"), long);
    panels.words(words);
    words = null;
  }
  if (frame.state === "waiting") {
    say($("verdict-long"), scene.live ? `No row has come from ${scene.source} yet.` : "The filter is starting.");
  }
  if (frame.traces) panels.draw(traces, run);
  stats.drawn += 1;
  stats.at = times.now;
}

function controls() {
  const { state, speed, position, end, notes } = frame;
  const failed = state === "failed";
  const running = state === "playing" || state === "waiting";
  const word = running ? "Pause" : state === "ended" && !scene.live ? "Again" : scene.live ? "Live" : "Play";
  say($("play"), word);
  $("play").setAttribute("aria-pressed", String(state === "paused"));
  for (const button of $("speeds").children) {
    button.setAttribute("aria-pressed", String(Number(button.dataset.speed) === speed));
  }
  const length = times.length ?? end;
  if (!seeking) $("seek").value = length > 0 ? Math.round((1000 * position) / length) : 0;
  const odd = [0.1, 1, 10].includes(speed) || scene.live ? "" : `, ×${plain(speed)}`;
  const how = state === "playing" ? odd : `, ${state}`;
  const of = scene.live ? "" : ` of ${plain(length, 2)}`;
  say($("clock"), `${plain(position, 2)}${of} s${how}`);
  if (failed) tell(notes[0]);
  list(failed ? notes.slice(1) : notes);
}

function list(notes) {
  const place = $("notes");
  if (place.dataset.said === notes.join("\n")) return;
  place.dataset.said = notes.join("\n");
  place.replaceChildren(
    ...notes.map((note) => {
      const item = document.createElement("li");
      item.textContent = note;
      return item;
    }),
  );
}

function tell(words) {
  $("banner").hidden = !words;
  say($("banner"), words);
}

const link = new Link({
  scene: meet,
  frame: take,
  connected: (there) => tell(there ? "" : "The line to the program is cut; trying again …"),
  ended: () => tell("The program has ended. What is shown is the last it said."),
});

function toggle() {
  if (frame === null) return;
  if (frame.state === "ended" && !scene.live) ask("restart");
  else ask(frame.state === "paused" || frame.state === "ended" ? "play" : "pause");
}

$("play").addEventListener("click", toggle);
$("restart").addEventListener("click", () => ask("restart"));
for (const button of $("speeds").children) {
  button.addEventListener("click", () => ask("speed", Number(button.dataset.speed)));
}
$("seek").addEventListener("pointerdown", () => { seeking = true; });
$("seek").addEventListener("change", () => { seeking = false; });
$("seek").addEventListener("input", () => {
  if (frame) ask("seek", ($("seek").value / 1000) * (times.length ?? frame.end));
});
$("window").addEventListener("change", () => {
  times.window = Number($("window").value);
  link.open(times.window);
});
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("button, select, input, a")) return;
  const speed = { ".": 0.1, 1: 1, 0: 10 }[event.key];
  if (event.key === " ") toggle();
  else if (event.key.toLowerCase() === "r") ask("restart");
  else if (speed) ask("speed", speed);
  else return;
  event.preventDefault();
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  panels?.restyle();
  if (traces?.time.length) panels.draw(traces, run);
});

times.window = Number($("window").value);
link.open(times.window);
