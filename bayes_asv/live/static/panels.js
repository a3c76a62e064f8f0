// The panels of the page: three parameters, two axles, and the prediction errors of the filter.

import { Chart, Limits, extremes, plain } from "./charts.js";

const AXLES = ["front", "rear"];
const PAINT = { c_f: "front", c_r: "rear", i: "pitch" };
const MAX_WIDTH = 5; // times the newest: wider bands may leave the chart

function element(tag, kind, text = "") {
  const made = document.createElement(tag);
  if (kind) made.className = kind;
  made.textContent = text;
  return made;
}

// Set a text only if it changed, because this runs 25 times per second.
export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

function heading(text, ...keys) {
  const title = element("div", "title");
  title.append(element("h2", "", text), ...keys.map(([kind, label]) => element("span", `key ${kind}`, label)));
  const readout = element("span", "readout");
  title.append(readout);
  return [title, readout];
}

// times: { start, now, length or null, window } of the playback, s
export class Panels {
  constructor(scene, times) {
    this.scene = scene;
    this.times = times;
    this.index = Object.fromEntries(scene.traces.map((name, n) => [name, n]));
    this.acceleration = new Limits();
    this.deflection = new Limits();
    this.ranges = { acceleration: [-1, 1], deflection: [-1, 1], nis: [0, 2] };
    this.cards = scene.parameters.map((parameter, n) => this.card(parameter, n));
    this.axles = AXLES.flatMap((axle) => this.axle(axle));
    this.nis = this.innovations();
    this.charts = [...this.cards.map((card) => card.chart), ...this.axles, this.nis];
  }

  restyle() {
    for (const chart of this.charts) chart.build();
  }

  span() {
    const { start, now, length, window } = this.times;
    if (length !== null && length <= window) return [start, start + length];
    return now - start < window ? [start, start + window] : [now - window, now];
  }

  whole() {
    const { start, now, length } = this.times;
    return [start, Math.max(start + (length ?? 5), now)];
  }

  card(parameter, n) {
    const box = element("article", "card tone-muted");
    box.id = `card-${parameter.name}`;
    const [title, readout] = heading(capital(parameter.label));
    const figures = element("div", "figures");
    const parts = {
      box,
      value: element("span", "value"),
      width: element("span", "small width"),
      interval: element("p", "small interval"),
      sense: element("p", "sense"),
      chance: element("p", "small"),
      limits: new Limits(),
      range: [0, 2 * parameter.nominal],
    };
    figures.append(parts.value, parts.width);
    const container = element("div", "chart");
    box.append(title, figures, parts.interval, parts.sense, parts.chance, container);
    document.getElementById("cards").append(box);
    const colour = PAINT[parameter.name];
    parts.chart = new Chart(container, {
      label: parameter.unit,
      time: "time [s]",
      sync: "run",
      curves: [
        { column: 3 * n + 2, width: 0 },
        { column: 3 * n + 1, width: 0 },
        { column: 3 * n, colour: colour, width: 2 },
      ],
      bands: [[0, 1, `${colour}-band`]],
      marks: () => [{ at: parameter.nominal, label: `nominal ${plain(parameter.nominal)}` }],
      x: () => this.whole(),
      y: () => parts.range,
      onCursor: (at) => {
        const run = this.run;
        if (at === null || !run || run.time[at] === undefined) return setText(readout, "");
        const [value, low, high] = [0, 1, 2].map((k) => plain(run.columns[3 * n + k][at]));
        return setText(readout, `${plain(run.time[at], 2)} s: ${value} (${low} to ${high})`);
      },
    });
    return parts;
  }

  axle(axle) {
    const box = element("article", "panel");
    const { acceleration, deflection, limits } = this.scene;
    const [first, sensed] = heading(
      `${capital(axle)} chassis acceleration`,
      ["measured", "measured"], [axle, "predicted"],
    );
    const [second, moved] = heading(`${capital(axle)} suspension deflection`);
    moved.id = `reach-${axle}`; // shows the travel so far, unless a cursor is on the chart
    const places = [element("div", "chart"), element("div", "chart")];
    box.append(first, places[0], second, places[1]);
    document.getElementById("axles").append(box);
    const at = (name) => this.index[`${axle} ${name}`];
    const value = (name, n) => plain(this.traces?.columns[at(name)]?.[n]);
    const stamp = (n) => plain(this.traces?.time[n], 3);
    const shared = { x: () => this.span(), sync: "traces" };
    return [
      new Chart(places[0], {
        ...shared,
        label: `${acceleration}, up positive`,
        curves: [
          { column: at("predicted high"), width: 0 },
          { column: at("predicted low"), width: 0 },
          { column: at("measured"), colour: "measured", width: 4 },
          { column: at("predicted"), colour: axle, width: 1.5 },
        ],
        bands: [[0, 1, `${axle}-band`]],
        y: () => this.ranges.acceleration,
        onCursor: (n) => setText(sensed, n === null ? "" : `${stamp(n)} s: ${value("measured", n)} / ${value("predicted", n)}`),
      }),
      new Chart(places[1], {
        ...shared,
        label: `${deflection}, extension positive`,
        time: "time [s]",
        curves: [
          { column: at("deflection high"), width: 0 },
          { column: at("deflection low"), width: 0 },
          { column: at("deflection"), colour: axle, width: 2 },
        ],
        bands: [[0, 1, `${axle}-band`]],
        marks: () => stops(limits[axle], deflection),
        y: () => this.ranges.deflection,
        onCursor: (n) => setText(moved, n === null ? (this.reach?.[axle] ?? "") : `${stamp(n)} s: ${value("deflection", n)} (${value("deflection low", n)} to ${value("deflection high", n)})`),
      }),
    ];
  }

  innovations() {
    const [title, readout] = heading(
      "Prediction errors (mean NIS a reading)",
      ["ink", "value"], ["good box", "95 % band of a correct filter"],
    );
    const container = element("div", "chart");
    document.getElementById("nis").append(title, container);
    return new Chart(container, {
      label: "NIS",
      time: "time [s]",
      sync: "traces",
      curves: [
        { column: this.index["nis high"], width: 0 },
        { column: this.index["nis low"], width: 0 },
        { column: this.index.nis, colour: "ink", width: 2 },
      ],
      bands: [[0, 1, "good-band"]],
      marks: () => [{ at: 1, label: "", dash: [2, 4] }],
      x: () => this.span(),
      y: () => this.ranges.nis,
      onCursor: (n) => setText(readout, n === null ? "" : `${plain(this.traces?.time[n], 3)} s: ${plain(this.traces?.columns[this.index.nis]?.[n])}`),
    });
  }

  setTexts(now) {
    now.cards.forEach((text, n) => {
      const card = this.cards[n];
      const kind = `card tone-${text.tone}`;
      if (card.box.className !== kind) card.box.className = kind;
      setText(card.value, text.value);
      setText(card.width, text.width);
      setText(card.interval, `95 %: ${text.interval}`);
      setText(card.sense, capital(text.sense));
      setText(card.chance, text.chance);
    });
    this.reach = Object.fromEntries(AXLES.map((axle, n) => [axle, now.travel[n] && `so far ${now.travel[n]}`]));
    AXLES.forEach((axle, n) => {
      if (!this.axles[2 * n + 1].hasCursor) setText(document.getElementById(`reach-${axle}`), this.reach[axle]);
    });
  }

  draw(traces, run) {
    [this.traces, this.run] = [traces, run];
    const all = (name) => AXLES.map((axle) => traces.columns[this.index[`${axle} ${name}`]]);
    // Bands may leave the chart, because they are very wide at first.
    this.ranges.acceleration = this.acceleration.cover(...extremes([...all("measured"), ...all("predicted")]));
    const ends = Object.values(this.scene.limits).flat().filter((end) => end !== null);
    this.ranges.deflection = this.deflection.cover(...extremes([...all("deflection"), ends]));
    const [, top] = extremes([traces.columns[this.index.nis]]);
    const [, band] = extremes([traces.columns[this.index["nis high"]].slice(-50)]);
    this.ranges.nis = [0, Math.min(Math.max(1.3 * top || 0, 1.3 * band || 0, 1.6), 50)];
    this.cards.forEach((card, n) => {
      const { nominal } = this.scene.parameters[n];
      const edges = [run.columns[3 * n + 1], run.columns[3 * n + 2]];
      const [low, high] = extremes(edges, narrowFrom(...edges));
      const margin = 0.03 * nominal;
      const from = Math.max(Math.min(low, nominal - margin), 0);
      card.range = card.limits.cover(from, Math.min(Math.max(high, nominal + margin), 4 * nominal));
      card.range = [Math.max(card.range[0], 0), card.range[1]];
      card.chart.show(run.time, run.columns);
    });
    for (const chart of [...this.axles, this.nis]) chart.show(traces.time, traces.columns);
  }
}

// First point from which on a band was at most MAX_WIDTH times as wide as it is now.
function narrowFrom(low, high) {
  let n = low.length - 1;
  const most = MAX_WIDTH * (high[n] - low[n]);
  while (n > 0 && high[n - 1] - low[n - 1] <= most) n -= 1;
  return Math.max(n, 0);
}

function stops([bump, droop], unit) {
  const marks = [];
  if (bump !== null) marks.push({ at: bump, label: `bump stop ${plain(bump)} ${unit}`, below: false });
  if (droop !== null) marks.push({ at: droop, label: `droop stop ${plain(droop)} ${unit}`, below: true });
  return marks;
}

export function capital(text) {
  return text ? text[0].toUpperCase() + text.slice(1) : "";
}
