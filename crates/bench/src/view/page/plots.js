// Curves and histograms, with uPlot.

import { el, num } from "./dom.js";

const shade = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/** Height of text in charts, px: as that of the page. */
const textSize = () => (window.innerWidth >= 2000 ? 14 : 11);

const charts = new Set();

const powersOfTen = (_, __, low, high) => {
  const [first, last] = [Math.ceil(Math.log10(Math.max(low, 1e-12)) - 1e-9), Math.floor(Math.log10(high) + 1e-9)];
  return Array.from({ length: Math.max(1, last - first + 1) }, (_, k) => 10 ** (first + k));
};

/** Redraws all charts in the colors of the page. */
export function redrawCharts() {
  charts.forEach((chart) => chart.make());
}

/**
 * A chart that fills the width of its box and a fraction of the window's height: `series` are { label,
 * values, color, axis, dash }.
 */
export class Chart {
  constructor({ label, share = 0.17 }) {
    // A fraction of the window, limited so that text remains readable.
    this.height = Math.round(Math.min(Math.max(window.innerHeight * share, 120), 420));
    this.element = el("figure", { class: "chart", role: "group", "aria-label": label }, (this.caption = el("figcaption", {}, label)));
    this.box = el("div", { class: "plot" });
    this.element.append(this.box);
    this.given = null;
    new ResizeObserver(() => this.resized()).observe(this.box);
    charts.add(this);
  }

  /** The caption above the chart. */
  set title(text) {
    this.caption.textContent = text;
  }

  /** Shows curves over `x`; `axes` are labels: { x, left, right }. */
  show(given) {
    this.given = given;
    this.make();
  }

  resized() {
    const width = this.box.clientWidth;
    if (!this.plot) {
      // It was hidden when it was made.
      this.make();
    } else if (Math.abs(width - this.plot.width) > 1) {
      this.plot.setSize({ width, height: this.height });
    }
  }

  make() {
    const width = this.box.clientWidth;
    this.plot?.destroy();
    this.plot = null;
    if (!this.given || width < 40) {
      return;
    }
    const { x, series, axes, log = false, bars = false, marks = [], points = false, clicked } = this.given;
    const size = textSize();
    const axis = (scale, label, side, stroke) => ({
      scale,
      label,
      side,
      stroke: stroke ?? shade("--muted"),
      grid: { stroke: shade("--line"), width: 1, show: side !== 1 },
      ticks: { stroke: shade("--line"), width: 1, size: 4 },
      font: `${size}px system-ui, sans-serif`,
      labelFont: `${size}px system-ui, sans-serif`,
      labelSize: size + 5,
      size: side === 2 ? size + 19 : 4 * size + 2,
      gap: 3,
      ...(log && side === 3 ? { splits: powersOfTen } : {}),
      values: (_, ticks) => ticks.map((tick) => (tick === null ? "" : tick >= 1e4 ? tick.toExponential(0).replace("e+", "e") : num(tick, 3))),
    });
    const own = series.map((one) => ({
      label: one.label,
      scale: one.axis ?? "left",
      stroke: one.color,
      fill: bars ? one.color : undefined,
      width: bars ? 0 : 1.75,
      dash: one.dash,
      spanGaps: true,
      paths: bars ? uPlot.paths.bars({ size: [1, Infinity], gap: 0 }) : one.isLoose ? () => null : undefined,
      points: { show: points, size: 7, fill: one.color },
      value: (_, value) => num(value, 4),
    }));
    const hasRight = series.some((one) => one.axis === "right");
    const options = {
      width,
      height: this.height,
      legend: { show: !bars && series.length > 1, live: false },
      cursor: { drag: { x: false, y: false }, points: { size: 6 } },
      scales: { x: { time: false }, left: log ? { distr: 3, log: 10 } : {}, right: {} },
      axes: [
        axis("x", axes.x, 2),
        axis("left", axes.left, 3),
        ...(hasRight ? [axis("right", axes.right, 1)] : []),
      ],
      series: [{ label: axes.x, value: (_, value) => num(value, 4) }, ...own],
      hooks: { draw: [(plot) => this.drawMarks(plot, marks)] },
    };
    this.plot = new uPlot(options, [x, ...series.map((one) => one.values)], this.box);
    if (clicked) {
      this.plot.over.addEventListener("click", () => {
        const k = this.plot.cursor.idx;
        if (k !== null && k !== undefined) {
          clicked(k);
        }
      });
    }
  }

  drawMarks(plot, marks) {
    const ratio = window.devicePixelRatio || 1;
    const context = plot.ctx;
    for (const mark of marks) {
      const at = plot.valToPos(mark.x, "x", true);
      const { left, top, width, height } = plot.bbox;
      if (at < left || at > left + width) {
        continue;
      }
      context.save();
      context.strokeStyle = shade("--text");
      context.fillStyle = shade("--text");
      context.lineWidth = 1.5 * ratio;
      context.setLineDash([4 * ratio, 3 * ratio]);
      context.beginPath();
      context.moveTo(at, top);
      context.lineTo(at, top + height);
      context.stroke();
      context.font = `${textSize() * ratio}px system-ui, sans-serif`;
      const isRight = at > left + 0.75 * width;
      context.textAlign = isRight ? "right" : "left";
      context.fillText(mark.label, at + (isRight ? -4 : 4) * ratio, top + 12 * ratio);
      context.restore();
    }
  }
}

/** Histogram with equal bins: centers and counts. */
export function binned(values, low, high, bins) {
  const counts = new Float64Array(bins);
  const scale = bins / Math.max(high - low, 1e-12);
  for (const value of values) {
    counts[Math.min(bins - 1, Math.max(0, Math.floor((value - low) * scale)))]++;
  }
  const middles = Array.from(counts, (_, k) => low + (k + 0.5) / scale);
  return [middles, Array.from(counts)];
}
