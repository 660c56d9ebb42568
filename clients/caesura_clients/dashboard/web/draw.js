// One picture: panels of signals, segments shaded behind them, changepoints across them, gaps, cursor.
import { KINDS, kindOfPhase, patternOf, phaseName } from "caesura-dashboard/palette.js";
import { BAND, ticks } from "caesura-dashboard/scale.js";

const FONT = "12px system-ui, sans-serif";
const DASHES = [[], [7, 2], [3, 2, 1, 2]]; // x, y, z
const SIGNALS = [
  { name: "position from the start", unit: () => "m", columns: [1, 2, 3], least: 0.1, relative: true },
  { name: "speed", unit: (unit) => unit, columns: [4], least: 0.1, zero: true },
  { name: "force", unit: () => "N", columns: [5, 6, 7], least: 5, tared: true },
];

// state: segments, changepoints, gaps, signals, unit, columns (run lengths or null), cursor, selected, ghost
export function draw(context, scale, state, ink) {
  context.clearRect(0, 0, scale.width, scale.height);
  context.font = FONT;
  context.lineWidth = 1;
  shadeSegments(context, scale, state, ink);
  drawPhases(context, scale, state, ink);
  shadeGaps(context, scale, state, ink);
  SIGNALS.forEach((signal, i) => drawPanel(context, scale, scale.panels[i], signal, state, ink));
  if (state.columns) drawRunLengths(context, scale, scale.panels[3], state.columns, ink);
  drawTime(context, scale, ink);
  veil(context, scale, state, ink);
  drawChangepoints(context, scale, state, ink);
  drawCursor(context, scale, state, ink);
}

function shadeSegments(context, scale, { segments }, ink) {
  const height = scale.bottom - scale.top;
  for (const [t0, tn, kind, probability, isFinal, corrected] of segments) {
    if (tn < scale.from || t0 > scale.to) continue;
    const x0 = Math.max(scale.x(t0), scale.x0);
    const width = Math.min(scale.x(tn), scale.x1) - x0;
    if (width <= 0) continue;
    context.globalAlpha = 0.06 + 0.3 * probability;
    context.fillStyle = KINDS[kind].colour;
    context.fillRect(x0, scale.top, width, height);
    const pattern = patternOf(context, kind);
    if (pattern) {
      context.globalAlpha = 0.15 + 0.45 * probability;
      context.fillStyle = pattern;
      context.fillRect(x0, scale.top, width, height);
    }
    context.globalAlpha = 1;
    context.fillStyle = KINDS[kind].colour;
    context.fillRect(x0, scale.top - 5, width, 4);
    label(context, `${kind}${corrected ? " ✎" : ""}${isFinal ? "" : " ~"}`, KINDS[kind].letter, x0, width, scale, ink);
  }
}

function drawPhases(context, scale, { phases }, ink) {
  for (const phase of phases) {
    const [t0, tn, kind, probability, isFinal] = phase;
    if (tn < scale.from || t0 > scale.to) continue;
    const x0 = Math.max(scale.x(t0), scale.x0);
    const width = Math.min(scale.x(tn), scale.x1) - x0;
    if (width <= 0) continue;
    context.globalAlpha = 0.1 + 0.3 * probability;
    context.fillStyle = KINDS[kindOfPhase(kind)].colour;
    context.fillRect(x0, BAND.top, width, BAND.height);
    context.globalAlpha = 1;
    context.strokeStyle = ink.faint;
    context.strokeRect(x0 + 0.5, BAND.top + 0.5, Math.max(width - 1, 1), BAND.height - 1);
    write(context, [`${phaseName(phase)}${isFinal ? "" : " ~"}`, kind], x0, width, BAND.top + BAND.height - 5, ink);
  }
  if (phases.length) {
    context.textAlign = "right";
    context.fillStyle = ink.faint;
    context.fillText("phases", scale.x0 - 6, BAND.top + BAND.height - 5);
  }
}

function label(context, long, short, x0, width, scale, ink) {
  write(context, [long, short], x0, width, scale.top - 10, ink);
}

function write(context, texts, x0, width, y, ink) {
  const text = texts.find((words) => context.measureText(words).width <= width - 4);
  if (!text) return;
  context.fillStyle = ink.text;
  context.textAlign = "center";
  context.textBaseline = "alphabetic";
  context.fillText(text, x0 + width / 2, y);
}

function shadeGaps(context, scale, { gaps }, ink) {
  for (const [t0, tn] of gaps) {
    if (tn < scale.from || t0 > scale.to) continue;
    const x0 = Math.max(scale.x(t0), scale.x0);
    const width = Math.max(Math.min(scale.x(tn), scale.x1) - x0, 3);
    context.fillStyle = ink.paper;
    context.fillRect(x0, scale.top, width, scale.bottom - scale.top);
    context.strokeStyle = ink.alarm;
    context.strokeRect(x0 + 0.5, scale.top + 0.5, width - 1, scale.bottom - scale.top - 1);
    if (width > 30) {
      context.fillStyle = ink.text;
      context.textAlign = "center";
      context.fillText("gap", x0 + width / 2, (scale.top + scale.bottom) / 2);
    }
  }
}

function extent(rows, columns, least, zero) {
  let low = zero ? 0 : Infinity, high = -Infinity;
  for (const row of rows) {
    for (const column of columns) {
      const value = row[column];
      if (value === null) continue;
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  if (low > high) [low, high] = [0, least];
  const middle = (low + high) / 2, half = Math.max(high - low, least) * 0.55;
  return zero ? [0, Math.max(high, least) * 1.1] : [middle - half, middle + half];
}

function drawPanel(context, scale, [y0, y1], signal, state, ink) {
  const rows = shownRows(scale, signal, state);
  const [low, high] = extent(rows, signal.columns, signal.least, signal.zero);
  const y = (value) => y1 - ((value - low) / (high - low)) * (y1 - y0);
  frame(context, scale, [y0, y1], ink, titleOf(signal, state) + whatIsMissing(signal, state, rows));
  yTicks(context, scale, low, high, y, ink);
  signal.columns.forEach((column, i) => {
    context.strokeStyle = ink.lines[signal.columns.length === 1 ? 0 : i];
    context.setLineDash(signal.columns.length === 1 ? [] : DASHES[i]);
    context.lineWidth = 1.6;
    line(context, scale, rows, column, y);
  });
  context.setLineDash([]);
  context.lineWidth = 1;
}

function whatIsMissing(signal, state, rows) {
  const has = (row) => row[signal.columns[0]] !== null;
  if (rows.some((row) => has(row) && !row.rough)) return "";
  if (state.signals.length && !state.signals.some(has)) return ": the robot does not send it";
  return rows.some(has) ? ": straight between the ends of segments" : ": not held for this time";
}

// Where samples are not held any more, the ends of segments still say how it went.
function roughRows(scale, { segments, signals }) {
  const held = signals.length ? signals[0][0] : Infinity;
  return segments.filter(([t0, tn]) => tn >= scale.from && t0 <= scale.to && tn <= held).flatMap(([t0, tn, , , , , , start, end]) =>
    [[t0, start], [tn, end]].map(([t, [px, py, pz, fx, fy, fz]]) => Object.assign([t, px, py, pz, null, fx, fy, fz], { rough: true })));
}

// Axes that lie far apart would flatten each other, so positions are drawn from where the session began. Forces are
// drawn without their bias, as the service sees them, once it has found it.
function shownRows(scale, signal, state) {
  const { signals, tare } = state;
  const rows = signals.filter((row) => row[0] >= scale.from - 0.1 && row[0] <= scale.to + 0.1);
  const rough = roughRows(scale, state);
  const origin = state.segments.length ? state.segments[0][7] : null;
  if (signal.relative && origin) return [...rough, ...rows].map((row) => less(row, signal.columns, origin));
  return signal.tared && tare ? [...rough, ...rows.map((row) => less(row, signal.columns, tare))] : [...rough, ...rows];
}

function less(row, columns, off) {
  const without = row.map((value, i) => (columns.includes(i) && value !== null ? value - off[i - columns[0]] : value));
  return Object.assign(without, { rough: row.rough });
}

function titleOf(signal, { unit, tare, frame }) {
  const words = { true: "without its bias ", false: "as measured " }[signal.tared ? String(tare !== null) : ""] || "";
  return `${signal.name} ${words}${signal.tared && frame === "flange" ? "at the flange " : ""}[${signal.unit(unit)}]`;
}

function line(context, scale, rows, column, y) {
  context.save();
  context.beginPath();
  context.rect(scale.x0, 0, scale.x1 - scale.x0, scale.height);
  context.clip();
  context.beginPath();
  let last = -Infinity;
  for (const row of rows) {
    if (row[column] === null) continue;
    if (row[0] - last > 0.5 && !row.rough) context.moveTo(scale.x(row[0]), y(row[column]));
    else context.lineTo(scale.x(row[0]), y(row[column]));
    last = row[0];
  }
  context.stroke();
  context.restore();
}

function frame(context, scale, [y0, y1], ink, title) {
  context.strokeStyle = ink.rule;
  context.strokeRect(scale.x0 + 0.5, Math.round(y0) + 0.5, scale.x1 - scale.x0 - 1, Math.round(y1 - y0) - 1);
  const width = context.measureText(title).width;
  context.fillStyle = ink.paper;
  context.globalAlpha = 0.8;
  context.fillRect(scale.x0 + 4, y0 + 4, width + 8, 17);
  context.globalAlpha = 1;
  context.fillStyle = ink.text;
  context.textAlign = "left";
  context.textBaseline = "alphabetic";
  context.fillText(title, scale.x0 + 8, y0 + 17);
}

function yTicks(context, scale, low, high, y, ink) {
  context.textAlign = "right";
  context.textBaseline = "middle";
  for (const [value, text] of ticks(low, high, 4)) {
    context.fillStyle = ink.faint;
    context.fillText(text, scale.x0 - 6, y(value));
    context.fillStyle = ink.rule;
    context.fillRect(scale.x0 - 3, Math.round(y(value)), 3, 1);
  }
}

function drawTime(context, scale, ink) {
  context.textAlign = "center";
  context.textBaseline = "top";
  context.fillStyle = ink.faint;
  for (const [t, text] of ticks(scale.from, scale.to, Math.max(2, (scale.x1 - scale.x0) / 90))) {
    context.fillText(`${text} s`, Math.min(scale.x(t), scale.x1 - 12), scale.bottom + 6);
    context.fillRect(Math.round(scale.x(t)), scale.bottom, 1, 4);
  }
}

function drawChangepoints(context, scale, { changepoints, selected, shownEnd }, ink) {
  for (const [t, probability, isFinal, low, high, corrected] of changepoints) {
    if (t < scale.from || t > shownEnd) continue;
    if (!isFinal && low !== null) {
      context.globalAlpha = 0.12;
      context.fillStyle = ink.text;
      context.fillRect(scale.x(low), scale.top, scale.x(high) - scale.x(low), scale.bottom - scale.top);
    }
    context.globalAlpha = isFinal ? 1 : 0.4 + 0.6 * probability;
    const isSelected = t === selected;
    context.strokeStyle = isSelected ? ink.accent : ink.text;
    context.lineWidth = isSelected ? 3 : 1.5;
    context.setLineDash(isFinal ? [] : [5, 4]);
    vertical(context, scale, t);
    context.setLineDash([]);
    if (corrected || isSelected) diamond(context, scale.x(t), scale.top, isSelected ? ink.accent : ink.text);
    context.globalAlpha = 1;
  }
  context.lineWidth = 1;
}

// What comes after the time that is looked at is there, but stands back.
function veil(context, scale, { shownEnd, end }, ink) {
  if (end === null || shownEnd >= scale.to) return;
  context.globalAlpha = 0.75;
  context.fillStyle = ink.paper;
  const x = Math.max(scale.x(shownEnd), scale.x0);
  context.fillRect(x, 0, scale.x1 - x + 1, scale.bottom);
  context.globalAlpha = 1;
}

function vertical(context, scale, t) {
  context.beginPath();
  context.moveTo(scale.x(t), scale.top - 5);
  context.lineTo(scale.x(t), scale.bottom);
  context.stroke();
}

function diamond(context, x, y, colour) {
  context.fillStyle = colour;
  context.beginPath();
  [[0, -7], [6, 0], [0, 7], [-6, 0]].forEach(([dx, dy]) => context.lineTo(x + dx, y + dy));
  context.fill();
}

function drawCursor(context, scale, { cursor, ghost }, ink) {
  const t = ghost ?? cursor;
  if (t === null || t < scale.from || t > scale.to) return;
  context.strokeStyle = ink.accent;
  context.setLineDash([2, 2]);
  context.lineWidth = ghost === null ? 1.5 : 2.5;
  vertical(context, scale, t);
  context.setLineDash([]);
  context.lineWidth = 1;
  const text = `${t.toFixed(2)} s`;
  const width = context.measureText(text).width + 8;
  const x = Math.min(scale.x(t) + 3, scale.x1 - width);
  context.fillStyle = ink.accent;
  context.fillRect(x, scale.bottom - 18, width, 17);
  context.fillStyle = ink.onAccent;
  context.textAlign = "left";
  context.textBaseline = "middle";
  context.fillText(text, x + 4, scale.bottom - 9);
}

function drawRunLengths(context, scale, [y0, y1], columns, ink) {
  const shown = columns.filter(([t]) => t >= scale.from && t <= scale.to);
  const longest = Math.max(2, ...shown.map(([, cells]) => Math.max(0, ...cells.map(([length]) => length))));
  const y = (length) => y1 - (length / longest) * (y1 - y0);
  context.fillStyle = ink.paper;
  context.fillRect(scale.x0, y0, scale.x1 - scale.x0, y1 - y0);
  const width = Math.max(1.5, scale.x(scale.from + 0.1) - scale.x(scale.from));
  const cell = Math.max(2, ((y1 - y0) / longest) * 0.1);
  context.fillStyle = ink.text;
  for (const [t, cells] of shown) {
    for (const [length, probability] of cells) {
      context.globalAlpha = Math.min(1, 0.08 + probability ** 0.5);
      context.fillRect(Math.max(scale.x(t) - width, scale.x0), y(length) - cell / 2, width, cell);
    }
  }
  context.globalAlpha = 1;
  frame(context, scale, [y0, y1], ink, "run length [s]");
  yTicks(context, scale, 0, longest, y, ink);
}
