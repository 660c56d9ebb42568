// Four panels: speed on a logarithmic and on a linear axis, position, force; over them classes, changepoints, cursor.
import { KINDS, patternOf } from "caesura-dashboard/palette.js";
import { ticks } from "caesura-dashboard/scale.js";

const FONT = "12px system-ui, sans-serif";
const DASHES = [[], [7, 2], [3, 2, 1, 2]]; // x, y, z
const LOG_SPEEDS = [1, 10, 100, 1000];
const GUIDES = [5, 10]; // mm/s: between them a movement starts and stops, as the protocol has it
const LEAST_SPEED = 0.3;
const TITLE = 18; // pixels above what is drawn in a panel

export function linesOf({ position, force, unit }) { // what each colour and dash stands for
  const joints = position.map((_, i) => `q${i + 1}`);
  return DASHES.map((dash, i) => {
    const axis = "xyz"[i], moved = unit === "mm" ? [] : joints.filter((_, k) => k % 3 === i);
    return { axis, dash: dash.join(" "), name: [...moved, ...(moved.length && !force ? [] : [axis])].join(", ") };
  });
}

export function paint(canvas, scale, state) {
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth * ratio, canvas.clientHeight * ratio].map(Math.round);
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, scale.width, scale.height);
  context.font = FONT;
  context.lineWidth = 1;
  const ink = inkOf();
  drawClasses(context, scale, state, ink);
  panels(state.signals, ink).forEach((panel, i) => drawPanel(context, scale, scale.panels[i], panel, state, ink));
  drawTime(context, scale, ink);
  drawPoints(context, scale, state, ink);
  drawCursor(context, scale, state, ink);
}

function inkOf() {
  const style = getComputedStyle(document.documentElement);
  const value = (name) => style.getPropertyValue(`--${name}`).trim();
  const names = { text: "ink", faint: "faint", paper: "paper", rule: "rule", accent: "accent", alarm: "alarm", onAccent: "on-accent" };
  const ink = Object.fromEntries(Object.entries(names).map(([key, name]) => [key, value(name)]));
  return { ...ink, lines: [value("line-x"), value("line-y"), value("line-z")] };
}

function panels({ speed, position, force, unit }, ink) {
  const three = (lines) => lines.map((values, i) => ({ values, colour: ink.lines[i % 3], dash: DASHES[i % 3] }));
  const one = (values, width = 1) => [{ values, colour: ink.text, dash: [], width }];
  const norm = force && force[0].map((_, i) => Math.hypot(...force.map((axis) => axis[i])));
  return [
    { title: `speed [${unit}/s], logarithmic`, lines: one(speed), log: true },
    { title: `speed [${unit}/s]`, lines: one(speed), zero: true },
    { title: `${unit === "mm" ? "position" : "joints"} about ${unit === "mm" ? "its" : "their"} mean [${unit}]`, lines: three(position) },
    { title: force ? "force [N]" : "no force in this recording", lines: force ? [...three(force), ...one(norm, 2)] : [] },
  ];
}

function drawPanel(context, scale, [y0, y1], panel, { signals }, ink) {
  const [begin, end] = [scale.from, scale.to].map((t) => indexOf(signals.t, t));
  const shown = panel.lines.flatMap(({ values }) => values.slice(begin, end + 1));
  const [low, high] = panel.log ? [LEAST_SPEED, 1.3 * Math.max(20, max(shown))] : limits(shown, panel.zero);
  const map = panel.log ? (v) => Math.log(Math.max(v, LEAST_SPEED)) : (v) => v;
  const top = y0 + TITLE;
  const y = (v) => y1 - ((map(v) - map(low)) / (map(high) - map(low))) * (y1 - top);
  context.save();
  context.beginPath();
  context.rect(scale.x0, top, scale.x1 - scale.x0, y1 - top);
  context.clip();
  if (panel.log) guides(context, scale, y, ink);
  for (const one of panel.lines) line(context, scale, signals.t, one, [begin, end], y);
  context.restore();
  frame(context, scale, [y0, y1], panel.title, ink);
  const marks = panel.log ? LOG_SPEEDS.filter((v) => v > low && v < high).map((v) => [v, String(v)]) : ticks(low, high, 4);
  context.textAlign = "right";
  context.textBaseline = "middle";
  context.fillStyle = ink.faint;
  if (panel.lines.length) for (const [value, text] of marks) context.fillText(text, scale.x0 - 6, y(value));
}

function guides(context, scale, y, ink) {
  context.strokeStyle = ink.alarm;
  context.globalAlpha = 0.5;
  for (const speed of GUIDES) {
    context.beginPath();
    context.moveTo(scale.x0, y(speed));
    context.lineTo(scale.x1, y(speed));
    context.stroke();
  }
  context.globalAlpha = 1;
}

function line(context, scale, t, { values, colour, dash, width }, [begin, end], y) {
  context.strokeStyle = colour;
  context.lineWidth = width || 1;
  context.setLineDash(dash);
  context.beginPath();
  for (let i = Math.max(begin - 1, 0); i <= Math.min(end + 1, t.length - 1); i += 1) context.lineTo(scale.x(t[i]), y(values[i]));
  context.stroke();
  context.setLineDash([]);
  context.lineWidth = 1;
}

function frame(context, scale, [y0, y1], title, ink) {
  context.strokeStyle = ink.rule;
  context.strokeRect(scale.x0 + 0.5, Math.round(y0) + 0.5, scale.x1 - scale.x0 - 1, Math.round(y1 - y0) - 1);
  context.fillStyle = ink.text;
  context.textAlign = "left";
  context.textBaseline = "middle";
  context.fillText(title, scale.x0 + 8, y0 + TITLE / 2 + 1);
}

function drawClasses(context, scale, { segments }, ink) {
  for (const { t0, t1, cls } of segments) {
    const x0 = Math.max(scale.x(t0), scale.x0), width = Math.min(scale.x(t1), scale.x1) - x0;
    if (width <= 0) continue;
    for (const [alpha, fill] of [[0.25, KINDS[cls].colour], [0.35, patternOf(context, cls)]]) {
      if (!fill) continue;
      context.globalAlpha = alpha;
      context.fillStyle = fill;
      context.fillRect(x0, scale.top, width, scale.bottom - scale.top);
    }
    context.globalAlpha = 1;
    context.fillStyle = ink.text;
    context.textAlign = "center";
    context.textBaseline = "alphabetic";
    const text = [cls, KINDS[cls].letter].find((words) => context.measureText(words).width < width);
    if (text) context.fillText(text, x0 + width / 2, scale.top - 14);
  }
}

function drawPoints(context, scale, { points, nearest }, ink) {
  let free = -Infinity; // where the next name may begin
  for (const point of points) {
    if (point.t < scale.from || point.t > scale.to) continue;
    const chosen = point === nearest, colour = chosen ? ink.accent : ink.text;
    const x = scale.x(point.t), left = Math.max(scale.x(point.t - point.tol), scale.x0);
    context.globalAlpha = chosen ? 0.2 : 0.05;
    context.fillStyle = colour;
    context.fillRect(left, scale.top, Math.min(scale.x(point.t + point.tol), scale.x1) - left, scale.bottom - scale.top);
    context.globalAlpha = 1;
    vertical(context, scale, x, colour, point.level === "major" ? 2 : 1, point.level === "major" ? [] : [4, 4]);
    if ("t_alt" in point) vertical(context, scale, scale.x(point.t_alt), colour, 1.5, [2, 3]);
    const name = (point.kind || "dip").replace("_", " "), width = context.measureText(name).width;
    const at = Math.min(x, scale.x1 - width);
    if (!chosen && (point.level !== "major" || at < free)) continue;
    context.fillStyle = ink.paper;
    context.fillRect(at, scale.top - 12, width, 12);
    context.fillStyle = colour;
    context.textAlign = "left";
    context.textBaseline = "alphabetic";
    context.fillText(name, at, scale.top - 2);
    free = at + width + 4;
  }
}

function drawCursor(context, scale, { cursor }, ink) {
  if (cursor < scale.from || cursor > scale.to) return;
  const x = scale.x(cursor), text = `${cursor.toFixed(3)} s`, width = context.measureText(text).width + 8;
  vertical(context, scale, x, ink.alarm, 1, []);
  const at = Math.min(x + 2, scale.x1 - width);
  context.fillStyle = ink.alarm;
  context.fillRect(at, scale.bottom - 17, width, 16);
  context.fillStyle = ink.paper;
  context.textAlign = "left";
  context.textBaseline = "middle";
  context.fillText(text, at + 4, scale.bottom - 9);
}

function drawTime(context, scale, ink) {
  context.textAlign = "center";
  context.textBaseline = "top";
  const major = ticks(scale.from, scale.to, Math.max(2, (scale.x1 - scale.x0) / 90));
  for (const [t] of ticks(scale.from, scale.to, Math.max(10, (scale.x1 - scale.x0) / 18))) {
    context.fillStyle = ink.rule;
    context.globalAlpha = 0.5;
    context.fillRect(Math.round(scale.x(t)), scale.top, 1, scale.bottom - scale.top + 3);
    context.globalAlpha = 1;
  }
  for (const [t, text] of major) {
    context.fillStyle = ink.faint;
    context.fillRect(Math.round(scale.x(t)), scale.bottom, 1, 5);
    context.fillText(`${text} s`, Math.min(scale.x(t), scale.x1 - 12), scale.bottom + 6);
  }
}

function vertical(context, scale, x, colour, width, dash) {
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.setLineDash(dash);
  context.beginPath();
  context.moveTo(x, scale.top);
  context.lineTo(x, scale.bottom);
  context.stroke();
  context.setLineDash([]);
  context.lineWidth = 1;
}

function limits(values, zero) {
  const low = zero ? 0 : min(values), high = max(values);
  const margin = Math.max(0.05 * (high - low), 0.5);
  return [zero ? 0 : low - margin, high + margin];
}

const max = (values) => values.reduce((a, b) => Math.max(a, b), -Infinity);
const min = (values) => values.reduce((a, b) => Math.min(a, b), Infinity);

function indexOf(t, time) { // the last sample at or before it
  let low = 0, high = t.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (t[middle] <= time) low = middle;
    else high = middle - 1;
  }
  return low;
}
