// One chart: uPlot in the style of the page, with labelled level lines.

const MINUS = "\u2212";

export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

export function plain(value, places) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const text = places === undefined ? String(+value.toPrecision(4)) : value.toFixed(places);
  return text.replace("-", MINUS);
}

// Limits that change seldom: they cover the values with a margin, are round, and shrink only when
// half of the range is empty.
export class Limits {
  constructor() {
    this.low = 0;
    this.high = 0;
  }

  cover(low, high) {
    if (!Number.isFinite(low) || !Number.isFinite(high)) [low, high] = [-1, 1]; // no values yet
    if (!(low < high)) {
      const margin = Math.abs(low) * 0.1 || 1;
      low -= margin;
      high += margin;
    }
    const span = high - low;
    const tooWide = this.high - this.low > 2.2 * span;
    if (low < this.low || high > this.high || tooWide || this.low === this.high) {
      const step = 10 ** Math.floor(Math.log10(span)) / 4;
      this.low = Math.floor((low - 0.06 * span) / step) * step;
      this.high = Math.ceil((high + 0.06 * span) / step) * step;
    }
    return [this.low, this.high];
  }
}

// Smallest and largest number of some columns from a point on.
export function extremes(columns, from = 0) {
  let low = Infinity;
  let high = -Infinity;
  for (const column of columns) {
    for (let n = from; n < column.length; n++) {
      const value = column[n];
      if (value === null) continue;
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  return [low, high];
}

// A histogram as a curve: its edges twice each, and the shares between them.
export function steps(edges, shares) {
  const x = edges.flatMap((edge, n) => (n === 0 || n === edges.length - 1 ? [edge] : [edge, edge]));
  return [x, shares.flatMap((share) => [share, share])];
}

// Options of a chart:
//   label    label of the value axis
//   curves   [{ column, colour, width }]: curves, and edges of bands (width 0)
//   bands    [[upper, lower, colour]] by index of the curves
//   marks    () => [{ at, label, dash }]: level lines
//   lines    () => [{ at, label }]: upright lines
//   x, y     () => [low, high]
//   time     label of the time axis, if any
//   space    least distance of its marks, px
//   sync     charts with the same key share a cursor
//   onCursor (index or null) => void: position of the cursor
export class Chart {
  constructor(element, options) {
    this.element = element;
    this.options = options;
    this.visible = true;
    this.data = [[], ...options.curves.map(() => [])];
    this.build();
    this.sizes = new ResizeObserver(() => {
      this.plot.setSize({ width: this.element.clientWidth, height: this.element.clientHeight });
    });
    this.sizes.observe(element);
    this.views = new IntersectionObserver(([entry]) => {
      this.visible = entry.isIntersecting;
      if (this.visible) this.plot.setData(this.data);
    });
    this.views.observe(element);
  }

  build() {
    const { options } = this;
    // Read once: reading makes the browser lay out the page, and there are 25 frames per second.
    const family = getComputedStyle(document.body).fontFamily;
    const font = `12px ${family}`;
    this.style = { family, ink: colour("ink"), paper: colour("paper") };
    const axis = {
      stroke: colour("ink"),
      font,
      labelFont: font,
      grid: { stroke: colour("grid"), width: 1 },
      ticks: { show: false },
      labelGap: 2,
      labelSize: 18,
    };
    this.plot?.destroy();
    this.plot = new uPlot(
      {
        width: this.element.clientWidth || 300,
        height: this.element.clientHeight || 150,
        padding: [8, 10, 0, 0],
        legend: { show: false },
        cursor: {
          y: false,
          points: { show: false },
          drag: { x: false, y: false },
          sync: options.sync ? { key: options.sync, scales: ["x", null] } : undefined,
        },
        scales: {
          x: { time: false, range: () => options.x() },
          y: { range: () => options.y() },
        },
        axes: [
          {
            ...axis,
            size: 19,
            gap: 3,
            labelGap: 0,
            labelSize: 16,
            space: options.space ?? 60,
            label: options.time,
            values: (_, marks) => marks.map((mark) => plain(mark)),
          },
          {
            ...axis,
            size: 46,
            gap: 4,
            space: 28,
            label: options.label,
            values: (_, marks) => marks.map((mark) => plain(mark)),
          },
        ],
        series: [
          {},
          ...options.curves.map((curve) => ({
            stroke: curve.width ? colour(curve.colour) : undefined,
            width: curve.width,
            points: { show: false },
            spanGaps: false,
          })),
        ],
        bands: (options.bands ?? []).map(([upper, lower, paint]) => ({
          series: [upper + 1, lower + 1],
          fill: colour(paint),
        })),
        hooks: {
          draw: [(plot) => this.drawMarks(plot), (plot) => this.drawLines(plot)],
          setCursor: [(plot) => {
            this.hasCursor = plot.cursor.left >= 0 && Number.isInteger(plot.cursor.idx);
            options.onCursor?.(this.hasCursor ? plot.cursor.idx : null);
          }],
        },
      },
      this.data,
      this.element,
    );
  }

  show(time, columns) {
    this.data = [time, ...this.options.curves.map((curve) => columns[curve.column] ?? [])];
    if (this.visible) this.plot.setData(this.data);
  }

  drawLines(plot) {
    const { ctx, bbox } = plot;
    const { family, ink } = this.style;
    const scale = devicePixelRatio;
    ctx.save();
    ctx.font = `${11.5 * scale}px ${family}`;
    for (const line of this.options.lines?.() ?? []) {
      const x = Math.round(plot.valToPos(line.at, "x", true));
      if (x < bbox.left || x > bbox.left + bbox.width) continue;
      ctx.strokeStyle = ink;
      ctx.lineWidth = scale;
      ctx.setLineDash([2 * scale, 3 * scale]);
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
      if (!line.label) continue;
      const width = ctx.measureText(line.label).width;
      const left = x + width + 6 * scale > bbox.left + bbox.width ? x - width - 4 * scale : x + 4 * scale;
      this.drawLabel(ctx, line.label, left, bbox.top + 2 * scale);
    }
    ctx.restore();
  }

  // A text on a plate that lets the curves shine through; left and top are those of the text.
  drawLabel(ctx, text, left, top) {
    const scale = devicePixelRatio;
    ctx.textAlign = "left";
    ctx.textBaseline = "top";
    ctx.fillStyle = this.style.paper;
    ctx.globalAlpha = 0.75;
    ctx.fillRect(left - 3 * scale, top - scale, ctx.measureText(text).width + 6 * scale, 14 * scale);
    ctx.globalAlpha = 1;
    ctx.fillStyle = this.style.ink;
    ctx.fillText(text, left, top);
  }

  drawMarks(plot) {
    const { ctx, bbox } = plot;
    const { family, ink } = this.style;
    const scale = devicePixelRatio;
    ctx.save();
    ctx.font = `${11.5 * scale}px ${family}`;
    for (const mark of this.options.marks?.() ?? []) {
      const y = Math.round(plot.valToPos(mark.at, "y", true));
      if (y < bbox.top || y > bbox.top + bbox.height) continue;
      ctx.strokeStyle = ink;
      ctx.lineWidth = scale;
      ctx.setLineDash((mark.dash ?? [6, 4]).map((length) => length * scale));
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
      if (!mark.label) continue;
      const below = mark.below ?? y - 16 * scale < bbox.top;
      const width = ctx.measureText(mark.label).width;
      const left = bbox.left + bbox.width - 4 * scale - width;
      this.drawLabel(ctx, mark.label, left, y + (below ? 3 : -15) * scale);
    }
    ctx.restore();
  }
}
