// The panels of the page: parameters, suspension elements, measured outputs, and the prediction errors.

import { Chart, Limits, extremes, plain, steps } from "./charts.js";

// Colour of a parameter, an output or an element: that of its axle.
function paint(name) {
  if (name.startsWith("front") || name.startsWith("c_f")) return "front";
  return name.startsWith("rear") || name.startsWith("c_r") ? "rear" : "pitch";
}

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
    // Outputs of one unit share their scale.
    this.units = [...new Set(scene.outputs.map((output) => output.unit))];
    this.limits = Object.fromEntries([...this.units, "deflection"].map((unit) => [unit, new Limits()]));
    this.ranges = { deflection: [-1, 1], nis: [0, 2] };
    for (const unit of this.units) this.ranges[`of ${unit}`] = [-1, 1];
    this.cards = scene.parameters.map((parameter, n) => this.card(parameter, n));
    this.moved = {};
    this.used = {};
    this.events = [];
    const apart = scene.outputs.filter((output) => !scene.elements.includes(output.key));
    this.axles = [
      ...scene.elements.flatMap((name) => this.element(name)),
      ...apart.map((output) => this.output(output, this.panel())),
    ];
    this.nis = this.innovations();
    const histograms = Object.values(this.used).flatMap((own) => [own.travel, own.speed, own.force]);
    this.charts = [...this.cards.map((card) => card.chart), ...this.axles, this.nis, ...histograms];
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
    const colour = paint(parameter.name);
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

  panel() {
    const box = element("article", "panel");
    document.getElementById("axles").append(box);
    return box;
  }

  // What is measured above a suspension element, if anything is, and its deflection.
  element(name) {
    const box = this.panel();
    const above = this.scene.outputs.find((output) => output.key === name);
    const charts = above ? [this.output(above, box)] : [];
    const { deflection, limits } = this.scene;
    const colour = paint(name);
    const [title, moved] = heading(`${capital(name.replace("_", " "))} suspension deflection`);
    moved.id = `reach-${name}`; // shows the travel so far, unless a cursor is on the chart
    const place = element("div", "chart");
    box.append(title, place);
    const at = (what) => this.index[`${name} ${what}`];
    const value = (what, n) => plain(this.traces?.columns[at(what)]?.[n]);
    this.moved[name] = new Chart(place, {
      x: () => this.span(),
      sync: "traces",
      label: `${deflection}, extension positive`,
      time: "time [s]",
      curves: [
        { column: at("deflection high"), width: 0 },
        { column: at("deflection low"), width: 0 },
        { column: at("deflection"), colour: colour, width: 2 },
      ],
      bands: [[0, 1, `${colour}-band`]],
      marks: () => stops(limits[name], deflection),
      lines: () => this.happened(name),
      y: () => this.ranges.deflection,
      onCursor: (n) => setText(moved, n === null ? (this.reach?.[name] ?? "") : `${plain(this.traces?.time[n], 3)} s: ${value("deflection", n)} (${value("deflection low", n)} to ${value("deflection high", n)})`),
    });
    this.used[name] = this.histograms(name, box);
    return [...charts, this.moved[name]];
  }

  // Where a suspension element spends its time, and what force its damper then has.
  histograms(name, box) {
    const { deflection, limits, bins, dampers, force } = this.scene;
    const colour = paint(name);
    const row = element("div", "trio");
    box.append(row);
    const ends = (edges) => () => [edges[0], edges[edges.length - 1]];
    const top = { travel: 1, speed: 1 };
    const chart = (text, options) => {
      const part = element("div");
      const [title, readout] = heading(text);
      const place = element("div", "chart");
      part.append(title, place);
      row.append(part);
      return new Chart(place, { ...options, space: 34, onCursor: (n) => setText(readout, n === null ? "" : options.says(n)) });
    };
    const share = (what, text, unit, x, lines) => chart(text, {
      label: "% of the time",
      time: unit,
      curves: [{ column: 0, colour: colour, width: 1 }, { column: 1, width: 0 }],
      bands: [[0, 1, `${colour}-band`]],
      x,
      y: () => [0, top[what]],
      lines,
      says: (n) => `${plain(this.shares?.[name]?.[what][Math.min(n >> 1, bins[name][what].length - 2)], 1)} %`,
    });
    const [bump, droop] = limits[name];
    const marks = [bump, droop].filter((at) => at !== null);
    return {
      top,
      travel: share("travel", "Travel", deflection, ends(bins[name].travel), () => marks.map((at) => ({ at }))),
      speed: share("speed", "Damper speed", `${deflection}/s`, () => this.driven(name), () => [{ at: 0, label: "" }]),
      force: chart("Damper force", {
        label: force[0],
        time: `${deflection}/s`,
        curves: [
          { column: 1, width: 0 },
          { column: 0, width: 0 },
          { column: 2, colour: colour, width: 2 },
          { column: 3, colour: "measured", width: 2 },
        ],
        bands: [[0, 1, `${colour}-band`]],
        x: () => this.driven(name),
        y: () => this.force?.[name] ?? [-1, 1],
        says: (n) => `${plain(this.laws?.[name]?.[n], 3)} ${force[0]}`,
      }),
      damper: dampers[name],
    };
  }

  // Range of the speeds that were driven, the same either way.
  driven(name) {
    const edges = this.scene.bins[name].speed;
    const shares = this.shares?.[name]?.speed ?? [];
    const most = shares.reduce((far, share, n) => (share > 0 ? Math.max(far, Math.abs(edges[n]), Math.abs(edges[n + 1])) : far), edges[edges.length >> 1] + (edges[1] - edges[0]));
    return [-most, most];
  }

  happened(place) {
    return this.events.filter((event) => event[2] === place).map(([at, label]) => ({ at, label }));
  }

  drawHistograms(run) {
    const last = run.time.length - 1;
    for (const [name, own] of Object.entries(this.used)) {
      const shares = this.shares?.[name];
      if (!shares) continue;
      for (const what of ["travel", "speed"]) {
        const [x, share] = steps(this.scene.bins[name][what], shares[what]);
        own.top[what] = Math.max(5, 1.15 * Math.max(...shares[what]));
        own[what].show(x, [share, share.map(() => 0)]);
      }
      const [low, high] = this.driven(name);
      const speeds = Array.from({ length: 41 }, (_, n) => low + ((high - low) * n) / 40);
      const rates = [0, 1, 2].map((k) => run.columns[3 * own.damper + k][last]);
      const nominal = this.scene.parameters[own.damper].nominal;
      // Edges of the band change sides where the speed changes its sign.
      const law = (rate) => speeds.map((speed) => rate * speed * this.scene.force[1]);
      const [middle, below, above] = rates.map(law);
      const lower = below.map((value, n) => Math.min(value, above[n]));
      const upper = below.map((value, n) => Math.max(value, above[n]));
      this.laws = { ...this.laws, [name]: middle };
      const most = Math.max(...law(Math.min(Math.max(rates[0], nominal) * 1.3, 4 * nominal)));
      this.force = { ...this.force, [name]: [-most, most] };
      own.force.show(speeds, [lower, upper, middle, law(nominal)]);
    }
  }

  output(output, box) {
    const colour = paint(output.key);
    const [title, sensed] = heading(capital(output.label), ["measured", "measured"], [colour, "predicted"]);
    const place = element("div", "chart");
    box.append(title, place);
    const at = (what) => this.index[`${output.key} ${what}`];
    const value = (what, n) => plain(this.traces?.columns[at(what)]?.[n]);
    return new Chart(place, {
      x: () => this.span(),
      sync: "traces",
      label: `${output.unit}, ${output.sign}`,
      curves: [
        { column: at("predicted high"), width: 0 },
        { column: at("predicted low"), width: 0 },
        { column: at("measured"), colour: "measured", width: 4 },
        { column: at("predicted"), colour: colour, width: 1.5 },
      ],
      bands: [[0, 1, `${colour}-band`]],
      y: () => this.ranges[`of ${output.unit}`],
      onCursor: (n) => setText(sensed, n === null ? "" : `${plain(this.traces?.time[n], 3)} s: ${value("measured", n)} / ${value("predicted", n)}`),
    });
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
      lines: () => this.happened("nis"),
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
    this.shares = Object.fromEntries(this.scene.elements.map((name, n) => [name, now.shares[n]]));
    this.events = now.events;
    this.fresh = true;
    this.reach = Object.fromEntries(this.scene.elements.map((name, n) => [name, now.travel[n] && `so far ${now.travel[n]}`]));
    for (const [name, chart] of Object.entries(this.moved)) {
      if (!chart.hasCursor) setText(document.getElementById(`reach-${name}`), this.reach[name]);
    }
  }

  draw(traces, run) {
    [this.traces, this.run] = [traces, run];
    const all = (names, what) => names.map((name) => traces.columns[this.index[`${name} ${what}`]]);
    // Bands may leave the chart, because they are very wide at first.
    for (const unit of this.units) {
      const keys = this.scene.outputs.filter((output) => output.unit === unit).map((output) => output.key);
      this.ranges[`of ${unit}`] = this.limits[unit].cover(...extremes([...all(keys, "measured"), ...all(keys, "predicted")]));
    }
    const ends = Object.values(this.scene.limits).flat().filter((end) => end !== null);
    this.ranges.deflection = this.limits.deflection.cover(...extremes([...all(this.scene.elements, "deflection"), ends]));
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
    if (this.fresh) this.drawHistograms(run);
    this.fresh = false;
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
