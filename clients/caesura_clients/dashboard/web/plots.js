// The panels of signals, one uPlot each, below each other with one axis of time.
import uPlot from "caesura-dashboard/vendor/uplot/uPlot.esm.js";
import { fontOf, Painter } from "caesura-dashboard/canvas.js";
import { roundTicks } from "caesura-dashboard/clock.js";
import { behind, before, missing } from "caesura-dashboard/marks.js";
import { fixed } from "caesura-dashboard/numbers.js";
import { aligned, nameOf, nearest, wraps } from "caesura-dashboard/signals.js";

export const LEFT = 64, RIGHT = 12; // beside the plots
// [px] of a line; and of one with a point in every second pixel, whose strokes would cover each other. Without a
// graphics card an hour of strokes of one pixel is drawn in 0.02 s in place of 0.12 s.
const STROKE = 1.4, DENSE_STROKE = 1;
const PADDING = 9, HEIGHT = 160 + 2 * PADDING, AXIS = 24;
const written = (panel, value) => value * (panel.factor || 1); // drawn as measured, written in the panel's unit
const DASHES = [[], [7, 3], [2, 3], [9, 3, 2, 3], [], [7, 3], [2, 3], [9, 3, 2, 3]];
const EMPTY = [[], []];
const TICK_SPACE = 28; // [px] between ticks, at least
const STEPS_DEG = [0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 45, 90, 180];

// Ticks at round angles.
function degrees(u, panel, low, high) {
  const least = written(panel, (high - low) * TICK_SPACE) / (u.bbox.height / devicePixelRatio);
  return roundTicks(0, low, high, (STEPS_DEG.find((one) => one >= least) || 180) / panel.factor);
}

// The lines of a vector that jumps: a point without a neighbour to be joined to is a dot. uPlot itself draws a line
// across a gap within a pixel, and no point between two gaps: so noise at a half turn would be a wall, or nothing.
function dotted(u, k, first, last) {
  const stroke = new Path2D(), values = u.data[k], dot = STROKE * devicePixelRatio / 2;
  let from = null, isAlone = true;
  const end = () => {
    if (from && isAlone) stroke.lineTo(from[0] + dot, from[1]);
    from = null;
  };
  for (let i = first; i <= last; i++) {
    if (values[i] === undefined) continue;
    if (values[i] === null) {
      end();
      continue;
    }
    const here = [u.valToPos(u.data[0][i], "x", true), u.valToPos(values[i], "y", true)];
    isAlone = !from;
    if (from) stroke.lineTo(...here);
    else stroke.moveTo(here[0] - dot, here[1]);
    from = here;
  }
  end();
  return { stroke, fill: null, clip: null, band: null, gaps: null, flags: 1 };
}

export class Plots {
  // host: the element that holds them; state: the component, whose view and data are drawn; scales: those of its values
  constructor(host, state, scales) {
    Object.assign(this, { host, state, scales, plots: new Map(), ink: state.ink() });
  }
  // Show these panels, in this order. Returns whether they, or their width, are others than before.
  show(panels) {
    const width = this.host.clientWidth; // while there are panels: without them a page may need no scroll bar
    const key = JSON.stringify([panels.map(({ name, unit, title, columns }) => [name, unit, title, columns]), width]);
    if (key === this.key) return false;
    Object.assign(this, { key, width });
    this.close();
    panels.forEach((panel, i) => this.plots.set(panel.name, this.make(panel, i === panels.length - 1)));
    return true;
  }
  close() {
    for (const { plot, box, painter } of this.plots.values()) {
      painter.close();
      plot.destroy();
      box.remove();
    }
    this.plots.clear();
    this.scales.forget(this.state);
  }
  make(panel, isLast) {
    const box = document.createElement("div");
    box.className = "panel";
    box.dataset.signal = panel.name;
    const title = box.appendChild(document.createElement("p"));
    title.className = "panel-title";
    const words = title.appendChild(document.createElement("strong"));
    words.textContent = `${panel.title}${panel.unit ? ` [${panel.unit}]` : ""}`;
    const values = panel.columns.map((column, i) => this.value(title, panel, column, i));
    this.host.appendChild(box);
    const plot = new uPlot(this.options(panel, isLast), EMPTY, box);
    const held = { plot, box, panel, values, isFilled: false };
    return Object.assign(held, { painter: new Painter(box, () => this.paint(held)) });
  }
  value(title, panel, column, i) {
    const label = title.appendChild(document.createElement("span"));
    label.className = `value line-${panel.columns.length === 1 ? 0 : i}`;
    if (panel.columns.length > 1) { // a line alone is what the title says
      label.appendChild(document.createElement("i"));
      label.append(`${nameOf(column)} `);
    }
    return label.appendChild(document.createElement("output"));
  }
  options(panel, isLast) {
    const line = (i) => () => this.ink.lines[panel.columns.length === 1 ? 0 : i % this.ink.lines.length];
    const axis = { stroke: () => this.ink.faint, font: fontOf(), ticks: { stroke: () => this.ink.rule, size: 4 }, grid: { stroke: () => this.ink.rule, width: 0.5 } };
    return {
      width: this.width, height: HEIGHT + (isLast ? AXIS : 0), padding: [PADDING, RIGHT, isLast ? 0 : PADDING, 0],
      legend: { show: false },
      cursor: { drag: { x: false, y: false, setScale: false }, sync: { key: "caesura", setSeries: false }, y: false, points: { show: false } },
      scales: { x: { time: false, range: () => this.state.view() }, y: { range: (u, low, high) => this.range(panel, low, high) } },
      axes: [
        {
          ...axis, show: isLast, size: AXIS, gap: 2,
          splits: (u, i, low, high, step) => roundTicks(this.state.start, low, high, step),
          values: (u, ticks) => ticks.map((t, i) => this.time(u, t, i ? "" : " s")),
        },
        {
          ...axis, size: LEFT, gap: 4, space: TICK_SPACE, ...(panel.unit === "°" ? { splits: (u, i, low, high) => degrees(u, panel, low, high) } : {}),
          values: (u, ticks) => ticks.map((value) => `${+written(panel, value).toFixed(6)}`),
        },
      ],
      series: [{}, ...panel.columns.map((_, i) => ({
        stroke: line(i), width: STROKE, dash: DASHES[panel.columns.length === 1 ? 0 : i], points: { show: false }, spanGaps: false,
        ...(panel.wraps ? { paths: dotted } : {}),
        ...(panel.name === "changepoints" ? { paths: uPlot.paths.bars({ size: [0.001, 3, 3] }), fill: line(i) } : {}),
      }))],
      hooks: {
        drawClear: [(u) => { behind(u.ctx, this.area(u), this.state); if (!panel.inferred) missing(u.ctx, this.area(u), this.state, this.ink, devicePixelRatio); }],
        draw: [(u) => { before(u.ctx, this.area(u), this.state, this.ink, devicePixelRatio); this.read(u, panel); }],
        setCursor: [(u) => this.read(u, panel)],
      },
    };
  }
  // None at the right edge, where it would be cut. The element of the plot gets its width after the axes.
  time(u, t, unit) {
    const words = `${+(t - this.state.start).toFixed(5)}${unit}`;
    const { font } = u.ctx; // uPlot's own, which it does not set anew
    u.ctx.font = fontOf();
    const { width } = u.ctx.measureText(words);
    u.ctx.font = font;
    return u.valToPos(t, "x") + width / 2 > u.bbox.width / devicePixelRatio + RIGHT ? "" : words;
  }
  area(u) {
    const { left, top, width, height } = u.bbox;
    const [from, to] = this.state.view();
    return { left, right: left + width, top, bottom: top + height, from, to, x: (t) => left + ((t - from) / (to - from)) * width };
  }
  range(panel, low, high) {
    return panel.name === "changepoints" ? [0, 1.05] : this.scales.range(this.state, panel, low, high);
  }
  // New data: each panel takes its own when it is drawn. inferred: only what was inferred is new.
  fill(inferred = false) {
    for (const held of this.plots.values()) if (held.panel.inferred || !inferred) held.isFilled = false;
  }
  content(panel) {
    const { data, segments, changepoints } = this.state;
    if (panel.name === "changepoints") return [changepoints.map(([t]) => t), changepoints.map(([, probability]) => probability)];
    if (panel.name === "load") {
      const steps = segments.filter((one) => one[8] !== null).flatMap(([t0, tn, , , , , , , load]) => [[t0, load], [tn, load], [tn + 1e-6, null]]);
      return [steps.map(([t]) => t), steps.map(([, load]) => load)];
    }
    if (!data || !panel.columns.every((name) => data.points[name])) return [[], ...panel.columns.map(() => [])];
    const holes = panel.wraps ? [...data.holes, ...wraps(data.points, panel.columns)] : data.holes;
    return aligned(data.points, panel.columns, holes, this.state.off(panel));
  }
  paint(held) {
    if (!held.isFilled) held.plot.setData(this.content(held.panel), false);
    held.isFilled = true;
    const [min, max] = this.state.view(), stroke = this.strokeOf(held, max - min);
    held.plot.series.forEach((series, i) => { if (i) series.width = stroke; });
    held.plot.setScale("x", { min, max });
  }
  strokeOf({ panel, plot }, span) {
    const { data } = this.state, points = data && !panel.inferred && data.points[panel.columns[0]];
    if (!points) return STROKE;
    const shown = (points.length / 2) * Math.min(1, span / (data.to - data.from));
    return 2 * shown > plot.over.clientWidth ? DENSE_STROKE : STROKE;
  }
  get painters() {
    return [...this.plots.values()].map(({ painter }) => painter);
  }
  // The values in the title of a panel: at the time under the pointer, or else at the chosen one.
  read(u, panel) {
    const held = this.plots.get(panel.name), { cursor } = this.state, [from, to] = this.state.view();
    const chosen = cursor !== null && cursor >= from && cursor <= to ? cursor : null; // of what is out of view nothing is known
    if (held) this.say(held, u.cursor.left >= 0 ? u.posToVal(u.cursor.left, "x") : chosen);
  }
  say({ panel, values }, t) {
    const { data, segments, changepoints } = this.state;
    const off = this.state.off(panel);
    const [from, to] = this.state.view();
    panel.columns.forEach((column, i) => {
      let words = "";
      if (t !== null && panel.name === "load") {
        const one = segments.find(([t0, tn]) => t0 <= t && t <= tn);
        words = one && one[8] !== null ? `${fixed(one[8], 3)} ± ${fixed(one[9] ?? 0, 3)}` : "–";
      } else if (t !== null && panel.name === "changepoints") {
        const one = changepoints.find(([at]) => Math.abs(at - t) < (to - from) / 150);
        words = one ? one[1].toFixed(2) : "–";
      } else if (t !== null) {
        const reach = Math.max(2 * (data ? data.bin_s : 0), (to - from) / 400);
        const found = data && nearest(data.points[column], t, data.holes, reach);
        words = found ? fixed(written(panel, found[1] - (off[i] || 0)), panel.digits) : "missing";
      }
      values[i].ariaLive = this.state.playing ? "off" : "polite"; // else each is announced ten times a second
      values[i].textContent = words;
    });
  }
}
