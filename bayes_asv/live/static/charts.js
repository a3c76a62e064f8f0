// One chart: uPlot in the look of the page, with lines and words that belong to no curve.

const MINUS = "\u2212";

export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

export function plain(value, places) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const text = places === undefined ? String(+value.toPrecision(4)) : value.toFixed(places);
  return text.replace("-", MINUS);
}

// Limits that move seldom: they hold what is there with some room, are round, and shrink only when
// half of them is empty.
export class Limits {
  constructor() {
    this.low = 0;
    this.high = 0;
  }

  hold(low, high) {
    if (!Number.isFinite(low) || !Number.isFinite(high)) [low, high] = [-1, 1]; // nothing there yet
    if (!(low < high)) {
      const room = Math.abs(low) * 0.1 || 1;
      low -= room;
      high += room;
    }
    const span = high - low;
    const roomy = this.high - this.low > 2.2 * span;
    if (low < this.low || high > this.high || roomy || this.low === this.high) {
      const step = 10 ** Math.floor(Math.log10(span)) / 4;
      this.low = Math.floor((low - 0.06 * span) / step) * step;
      this.high = Math.ceil((high + 0.06 * span) / step) * step;
    }
    return [this.low, this.high];
  }
}

// Least and largest number of some columns from a point on.
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

// What a chart needs:
//   label    words on the axis of values
//   curves   [{ column, colour, width }]: curves, and edges of bands (width 0)
//   bands    [[upper, lower, colour]] by place among the curves
//   marks    () => [{ at, words, dash }]: level lines
//   x, y     () => [low, high]
//   time     words below the axis of time, if any
//   sync     charts with the same word share a cursor
//   told     (place or null) => void: where the cursor is
export class Chart {
  constructor(place, about) {
    this.place = place;
    this.about = about;
    this.seen = true;
    this.data = [[], ...about.curves.map(() => [])];
    this.build();
    this.sizes = new ResizeObserver(() => {
      this.plot.setSize({ width: this.place.clientWidth, height: this.place.clientHeight });
    });
    this.sizes.observe(place);
    this.views = new IntersectionObserver(([entry]) => {
      this.seen = entry.isIntersecting;
      if (this.seen) this.plot.setData(this.data);
    });
    this.views.observe(place);
  }

  build() {
    const { about } = this;
    // Asked once: asking makes the browser lay out the page, and there are 25 frames a second.
    const family = getComputedStyle(document.body).fontFamily;
    const font = `12px ${family}`;
    this.look = { family, ink: colour("ink"), paper: colour("paper") };
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
        width: this.place.clientWidth || 300,
        height: this.place.clientHeight || 150,
        padding: [8, 10, 0, 0],
        legend: { show: false },
        cursor: {
          y: false,
          points: { show: false },
          drag: { x: false, y: false },
          sync: about.sync ? { key: about.sync, scales: ["x", null] } : undefined,
        },
        scales: {
          x: { time: false, range: () => about.x() },
          y: { range: () => about.y() },
        },
        axes: [
          {
            ...axis,
            size: 19,
            gap: 3,
            labelGap: 0,
            labelSize: 16,
            space: 60,
            label: about.time,
            values: (_, marks) => marks.map((mark) => plain(mark)),
          },
          {
            ...axis,
            size: 46,
            gap: 4,
            space: 28,
            label: about.label,
            values: (_, marks) => marks.map((mark) => plain(mark)),
          },
        ],
        series: [
          {},
          ...about.curves.map((curve) => ({
            stroke: curve.width ? colour(curve.colour) : undefined,
            width: curve.width,
            points: { show: false },
            spanGaps: false,
          })),
        ],
        bands: (about.bands ?? []).map(([upper, lower, paint]) => ({
          series: [upper + 1, lower + 1],
          fill: colour(paint),
        })),
        hooks: {
          draw: [(plot) => this.levels(plot)],
          setCursor: [(plot) => {
            this.asked = plot.cursor.left >= 0 && Number.isInteger(plot.cursor.idx);
            about.told?.(this.asked ? plot.cursor.idx : null);
          }],
        },
      },
      this.data,
      this.place,
    );
  }

  show(time, columns) {
    this.data = [time, ...this.about.curves.map((curve) => columns[curve.column] ?? [])];
    if (this.seen) this.plot.setData(this.data);
  }

  levels(plot) {
    const { ctx, bbox } = plot;
    const { family, ink, paper } = this.look;
    const scale = devicePixelRatio;
    ctx.save();
    ctx.font = `${11.5 * scale}px ${family}`;
    ctx.textAlign = "right";
    for (const mark of this.about.marks?.() ?? []) {
      const y = Math.round(plot.valToPos(mark.at, "y", true));
      if (y < bbox.top || y > bbox.top + bbox.height) continue;
      ctx.strokeStyle = ink;
      ctx.lineWidth = scale;
      ctx.setLineDash((mark.dash ?? [6, 4]).map((length) => length * scale));
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
      if (!mark.words) continue;
      const below = mark.below ?? y - 16 * scale < bbox.top;
      ctx.textBaseline = below ? "top" : "bottom";
      const width = ctx.measureText(mark.words).width;
      const [right, edge] = [bbox.left + bbox.width - 4 * scale, y + (below ? 3 : -3) * scale];
      ctx.fillStyle = paper;
      ctx.globalAlpha = 0.75;
      ctx.fillRect(right - width - 3 * scale, below ? edge - 1 : edge - 13 * scale, width + 6 * scale, 14 * scale);
      ctx.globalAlpha = 1;
      ctx.fillStyle = ink;
      ctx.fillText(mark.words, right, edge);
    }
    ctx.restore();
  }
}
