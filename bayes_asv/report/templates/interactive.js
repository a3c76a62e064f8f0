// The recordings of an estimate: linked charts against time, two cursors, and the state plane.
"use strict";

(() => {
  const { runs } = JSON.parse(document.getElementById("data").textContent);
  const find = (id) => document.getElementById(id);
  const colour = (name) =>
    getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  const text = (value) =>
    value === null || !Number.isFinite(value)
      ? "–"
      : String(+value.toPrecision(4)).replace("-", "\u2212");

  const marks = { a: null, b: null }; // s
  let here = null; // s, under the pointer
  let charts = []; // of the recording that is shown
  let shown = null; // it
  let window_ = null; // [first, last] s that is shown

  // Index of the instant nearest to a time.
  function nearest(times, at) {
    let low = 0;
    let high = times.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] < at) low = middle;
      else high = middle;
    }
    return at - times[low] < times[high] - at ? low : high;
  }

  function valueAt(curve, at) {
    if (at === null) return null;
    const { time } = curve;
    return at < time[0] || at > time[time.length - 1] ? null : curve.values[nearest(time, at)];
  }

  // Lines of the two cursors, over a chart.
  function drawMarks(u) {
    const { ctx, bbox } = u;
    ctx.save();
    ctx.font = `${12 * devicePixelRatio}px system-ui, sans-serif`;
    for (const [name, at] of Object.entries(marks)) {
      if (at === null) continue;
      const x = u.valToPos(at, "x", true);
      if (x < bbox.left || x > bbox.left + bbox.width) continue;
      ctx.strokeStyle = ctx.fillStyle = colour("ink");
      ctx.lineWidth = 1.5 * devicePixelRatio;
      ctx.setLineDash(name === "a" ? [] : [6, 4]);
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
      ctx.textAlign = "left";
      ctx.fillText(name.toUpperCase(), x + 4 * devicePixelRatio, bbox.top + 12 * devicePixelRatio);
    }
    ctx.restore();
  }

  function makeChart(chart, last) {
    const box = document.createElement("div");
    box.className = "chart";
    const title = document.createElement("h2");
    title.textContent = `${chart.title} [${chart.unit}]`;
    const plot = document.createElement("div");
    plot.className = "plot";
    plot.setAttribute("role", "img");
    plot.setAttribute("aria-label", `${chart.title} against time`);
    box.append(title, plot);
    find("charts").append(box);
    const axis = {
      stroke: () => colour("ink"),
      grid: { stroke: () => colour("grid"), width: 1 },
      ticks: { stroke: () => colour("grid"), width: 1 },
      values: (_, ticks) => ticks.map(text),
    };
    const bands = chart.band ? [chart.curves.length + 2, chart.curves.length + 1] : null;
    const series = [
      {},
      ...chart.curves.map((curve) => ({
        label: curve.name,
        stroke: () => colour(curve.colour),
        width: curve.width || 1.3,
        dash: curve.dashed ? [6, 3] : undefined,
        points: { show: false },
      })),
    ];
    const data = [chart.time, ...chart.curves.map((curve) => curve.values)];
    const options = {
      width: plot.clientWidth,
      height: plot.clientHeight,
      series,
      scales: { x: { time: false } },
      axes: [{ ...axis, label: last ? "time [s]" : undefined, size: last ? 46 : 26 }, { ...axis, size: 62 }],
      legend: { show: false },
      cursor: { sync: { key: "time", setSeries: false, scales: ["x", null] }, drag: { x: true, y: false }, y: false },
      hooks: {
        draw: [drawMarks],
        setScale: [(u, key) => key === "x" && zoom(u.scales.x.min, u.scales.x.max, u)],
        setCursor: [
          (u) => {
            const { left } = u.cursor;
            point(left === null || left < 0 ? null : u.posToVal(left, "x"));
          },
        ],
      },
    };
    if (bands) {
      for (const side of chart.band) {
        series.push({ width: 0, stroke: "transparent", points: { show: false } });
        data.push(side);
      }
      options.bands = [{ series: bands, fill: () => `${colour(chart.curves[1].colour)}40` }];
    }
    const u = new uPlot(options, data, plot);
    u.over.addEventListener("click", (event) => {
      const at = u.posToVal(event.offsetX, "x");
      if (u.select.width > 2) return; // the end of a drag
      mark(event.shiftKey ? "b" : "a", at);
    });
    u.over.addEventListener("dblclick", reset);
    new ResizeObserver(() =>
      u.setSize({ width: plot.clientWidth, height: plot.clientHeight }),
    ).observe(plot);
    return u;
  }

  // Show the same time in all charts.
  let zooming = false;
  function zoom(first, last, from) {
    if (zooming || first === undefined || first === null) return;
    zooming = true;
    window_ = [first, last];
    for (const u of charts) if (u !== from) u.setScale("x", { min: first, max: last });
    zooming = false;
    drawStates();
  }

  function reset() {
    if (shown) for (const u of charts) u.setScale("x", { min: shown.window[0], max: shown.window[1] });
  }

  function point(at) {
    here = at;
    fillValues();
    drawStates();
  }

  function mark(name, at) {
    marks[name] = at;
    const field = find(name);
    if (document.activeElement !== field) field.value = at === null ? "" : at.toFixed(4);
    for (const u of charts) u.redraw(false);
    fillValues();
    drawStates();
  }

  function fillValues() {
    const rows = find("values").tBodies[0].rows;
    let n = 0;
    for (const chart of shown.charts) {
      for (const curve of chart.curves) {
        const [at, a, b] = [here, marks.a, marks.b].map((time) =>
          valueAt({ time: chart.time, values: curve.values }, time),
        );
        const cells = rows[n].cells;
        const difference = a === null || b === null ? null : b - a;
        [at, a, b, difference].forEach((value, k) => (cells[k + 1].textContent = text(value)));
        n += 1;
      }
    }
    const times = find("values").tHead.rows[0].cells;
    times[1].textContent = here === null ? "here" : `${text(here)} s`;
    times[4].textContent = marks.a === null || marks.b === null ? "B \u2212 A" : `${text(marks.b - marks.a)} s`;
  }

  function makeValues() {
    const body = find("values").tBodies[0];
    body.replaceChildren();
    for (const chart of shown.charts) {
      for (const curve of chart.curves) {
        const row = body.insertRow();
        const label = document.createElement("th");
        label.scope = "row";
        const swatch = document.createElement("span");
        swatch.className = curve.dashed ? "swatch dashed" : "swatch";
        swatch.style[curve.dashed ? "borderColor" : "background"] = `var(--${curve.colour})`;
        label.append(swatch, `${curve.label} [${chart.unit}]`);
        row.append(label);
        for (let k = 0; k < 4; k++) row.insertCell();
      }
    }
  }

  // Damper velocity over travel of every suspension element.
  let planes = [];
  function makeStates() {
    find("states").replaceChildren();
    planes = shown.states.map((state) => {
      const canvas = document.createElement("canvas");
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", `${state.name}: damper velocity over travel`);
      find("states").append(canvas);
      new ResizeObserver(drawStates).observe(canvas);
      return { ...state, canvas };
    });
  }

  const extent = (values) => {
    const finite = values.filter((v) => v !== null);
    const [low, high] = [Math.min(...finite), Math.max(...finite)];
    const margin = 0.08 * (high - low) || 1;
    return [low - margin, high + margin];
  };

  function drawStates() {
    if (!shown || !window_) return;
    for (const plane of planes) {
      const { canvas } = plane;
      const scale = devicePixelRatio;
      const [width, height] = [canvas.clientWidth * scale, canvas.clientHeight * scale];
      if (!width) continue;
      canvas.width = width;
      canvas.height = height;
      const ctx = canvas.getContext("2d");
      const left = 52 * scale;
      const bottom = 34 * scale;
      const [x0, x1] = extent(plane.travel);
      const [y0, y1] = extent(plane.velocity);
      const x = (v) => left + ((v - x0) / (x1 - x0)) * (width - left - 8 * scale);
      const y = (v) => height - bottom - ((v - y0) / (y1 - y0)) * (height - bottom - 8 * scale);
      ctx.font = `${11 * scale}px system-ui, sans-serif`;
      ctx.fillStyle = colour("ink");
      ctx.textAlign = "center";
      ctx.fillText(`${plane.name} travel [${plane.unit}], extension +`, (left + width) / 2, height - 4 * scale);
      ctx.save();
      ctx.translate(10 * scale, (height - bottom) / 2);
      ctx.rotate(-Math.PI / 2);
      ctx.fillText(`velocity [${plane.velocityUnit}]`, 0, 0);
      ctx.restore();
      for (const [low, high, across] of [[x0, x1, true], [y0, y1, false]]) {
        const rough = (high - low) / 5;
        const power = 10 ** Math.floor(Math.log10(rough));
        const step = [1, 2, 5, 10].map((k) => k * power).find((s) => s >= rough);
        for (let k = Math.ceil(low / step); k * step < high; k++) {
          const at = across ? x(k * step) : y(k * step);
          ctx.strokeStyle = colour("grid");
          ctx.lineWidth = k === 0 ? 2 * scale : scale;
          ctx.beginPath();
          if (across) { ctx.moveTo(at, 8 * scale); ctx.lineTo(at, height - bottom); }
          else { ctx.moveTo(left, at); ctx.lineTo(width - 8 * scale, at); }
          ctx.stroke();
          ctx.textAlign = across ? "center" : "right";
          ctx.fillText(text(k * step), across ? at : left - 4 * scale, across ? height - bottom + 13 * scale : at + 4 * scale);
        }
      }
      const line = (from, to, weight, alpha) => {
        ctx.strokeStyle = colour(plane.colour);
        ctx.globalAlpha = alpha;
        ctx.lineWidth = weight * scale;
        ctx.beginPath();
        let pen = false;
        for (let n = from; n <= to; n++) {
          if (plane.travel[n] === null || plane.velocity[n] === null) { pen = false; continue; }
          const [px, py] = [x(plane.travel[n]), y(plane.velocity[n])];
          if (pen) ctx.lineTo(px, py);
          else ctx.moveTo(px, py);
          pen = true;
        }
        ctx.stroke();
        ctx.globalAlpha = 1;
      };
      line(0, plane.time.length - 1, 1, 0.35);
      line(nearest(plane.time, window_[0]), nearest(plane.time, window_[1]), 2, 1);
      for (const [label, at] of [["", here], ["A", marks.a], ["B", marks.b]]) {
        if (at === null || at < plane.time[0] || at > plane.time[plane.time.length - 1]) continue;
        const n = nearest(plane.time, at);
        if (plane.travel[n] === null) continue;
        ctx.fillStyle = colour("ink");
        ctx.beginPath();
        ctx.arc(x(plane.travel[n]), y(plane.velocity[n]), (label ? 4 : 5) * scale, 0, 2 * Math.PI);
        ctx.fill();
        ctx.textAlign = "left";
        ctx.fillText(label, x(plane.travel[n]) + 6 * scale, y(plane.velocity[n]) - 4 * scale);
      }
    }
  }

  function show(run) {
    for (const u of charts) u.destroy();
    find("charts").replaceChildren();
    charts = [];
    shown = run;
    window_ = run.window;
    here = marks.a = marks.b = null;
    find("a").value = find("b").value = "";
    makeValues();
    makeStates();
    zooming = true; // until all charts are there
    charts = run.charts.map((chart, n) => makeChart(chart, n === run.charts.length - 1));
    zooming = false;
    reset();
    fillValues();
  }

  for (const [n, run] of runs.entries()) find("run").append(new Option(run.name, String(n)));
  find("run").addEventListener("change", () => show(runs[Number(find("run").value)]));
  for (const name of ["a", "b"]) {
    find(name).addEventListener("input", () => {
      const at = Number.parseFloat(find(name).value);
      mark(name, Number.isFinite(at) ? at : null);
    });
  }
  find("reset").addEventListener("click", reset);
  find("controls").addEventListener("submit", (event) => event.preventDefault());
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    for (const u of charts) u.redraw(false);
    drawStates();
  });
  show(runs[0]);
})();
