// What is drawn behind and before the signals, the same in every panel; and the band of kinds and phases above them.
import { KINDS, kindOfPhase, patternOf, phaseName } from "caesura-dashboard/palette.js";
import { fontOf } from "caesura-dashboard/canvas.js";

const TINT = 0.1; // at most, behind a signal
const ROOM = 40; // pixels from changepoint to changepoint, below which their lines fade
const FADED = 0.03; // of a line, too faint to be seen: an hour has thousands, in every panel
const PATTERNED = 2, LETTERED = 12; // pixels of a segment, below which neither a pattern nor a letter can be read; see `namedAt`
const FRAMED = 5; // pixels of a phase, below which its frame would cover its colour
export const ROWS = { kinds: [24, 28], phases: [2, 20] }; // of the band: top and height
export const BAND_HEIGHT = 54;

// The rows of a range of time. end: which cell is the last time of a row; rows are in the order of their times.
function within(rows, { from, to }, end) {
  let low = 0, high = rows.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (rows[middle][end] < from) low = middle + 1;
    else high = middle;
  }
  const first = low;
  while (low < rows.length && rows[low][0] <= to) low += 1;
  return rows.slice(first, low);
}

// area: {x(t), left, right, top, bottom, from, to} in pixels of the context
function spans(rows, area, each) {
  for (const row of within(rows, area, 1)) {
    const x0 = Math.max(area.x(row[0]), area.left), x1 = Math.min(area.x(row[1]), area.right);
    if (x1 > x0) each(row, x0, x1 - x0);
  }
}

export function behind(context, area, state) {
  const strip = tintOf(state.segments, area);
  if (!strip) return;
  context.save();
  context.imageSmoothingEnabled = false;
  context.drawImage(strip, area.left, area.top, strip.width, area.bottom - area.top);
  context.restore();
}

// The tint of a view, one pixel high: an hour has thousands of segments, and every panel has the same tint.
const tints = new WeakMap(); // by segments: of which view, and its strip
function tintOf(segments, area) {
  const width = Math.round(area.right - area.left), key = [width, area.from, area.to].join();
  if (width < 1) return null;
  const held = tints.get(segments) || { key: "", strip: new OffscreenCanvas(width, 1) };
  if (held.key === key) return held.strip;
  held.key = key;
  held.strip.width = width; // which also clears it
  const context = held.strip.getContext("2d");
  spans(segments, { ...area, x: (t) => area.x(t) - area.left, left: 0, right: width }, ([, , kind, probability], x, wide) => {
    context.globalAlpha = TINT * (0.3 + 0.7 * probability);
    context.fillStyle = KINDS[kind].colour;
    context.fillRect(x, 0, wide, 1);
  });
  tints.set(segments, held);
  return held.strip;
}

// Where nothing was measured: no line leads across.
export function missing(context, area, state, ink, pixel) {
  const { first, last, holes } = state.data || {};
  const outside = [];
  if (first !== null && first !== undefined && area.from < first) outside.push([area.from, first, ""]);
  if (last !== null && last !== undefined && state.closed && area.to > last) outside.push([last, area.to, ""]);
  context.save();
  context.font = fontOf(pixel);
  context.textAlign = "center";
  for (const [rows, words] of [[holes || [], "missing"], [outside, "not recorded"]]) {
    spans(rows, area, (row, x, width) => {
      context.fillStyle = ink.quiet;
      context.fillRect(x, area.top, Math.max(width, pixel), area.bottom - area.top);
      if (context.measureText(words).width > width - 8 * pixel) return;
      context.fillStyle = ink.faint;
      context.fillText(words, x + width / 2, (area.top + area.bottom) / 2);
    });
  }
  context.restore();
}

export function before(context, area, state, ink, pixel) {
  context.save();
  context.beginPath();
  context.rect(area.left, area.top, area.right - area.left, area.bottom - area.top);
  context.clip();
  veil(context, area, state, ink);
  const shown = within(state.changepoints, { from: area.from, to: Math.min(area.to, state.shownEnd) }, 0);
  const strength = Math.min(1, (area.right - area.left) / pixel / (shown.length + 1) / ROOM);
  for (const [t, probability, isFinal, low, high] of shown) {
    const isSelected = t === state.selected;
    if (!isSelected && strength < FADED) continue;
    if (!isFinal && low !== null) {
      context.globalAlpha = 0.1;
      context.fillStyle = ink.text;
      context.fillRect(area.x(low), area.top, area.x(high) - area.x(low), area.bottom - area.top);
    }
    context.globalAlpha = (isFinal ? 0.75 : 0.3 + 0.5 * probability) * (isSelected ? 1 : strength);
    context.strokeStyle = isSelected ? ink.accent : ink.text;
    context.lineWidth = (isSelected ? 3 : 1) * pixel;
    context.setLineDash(isFinal ? [] : [5 * pixel, 4 * pixel]);
    vertical(context, area, t);
  }
  context.globalAlpha = 1;
  const t = state.ghost ?? state.cursor;
  if (t !== null) {
    context.strokeStyle = ink.accent;
    context.setLineDash([2 * pixel, 2 * pixel]);
    context.lineWidth = (state.ghost === null ? 1.5 : 2.5) * pixel;
    vertical(context, area, t);
  }
  context.restore();
}

// What comes after the time that is looked at stands back.
function veil(context, area, { shownEnd, end }, ink) {
  if (end === null || shownEnd >= area.to) return;
  context.globalAlpha = 0.75;
  context.fillStyle = ink.paper;
  const x = Math.max(area.x(shownEnd), area.left);
  context.fillRect(x, area.top, area.right - x, area.bottom - area.top);
  context.globalAlpha = 1;
}

function vertical(context, area, t) {
  context.beginPath();
  context.moveTo(area.x(t), area.top);
  context.lineTo(area.x(t), area.bottom);
  context.stroke();
}

// What stands at a place of the band, in full: a row of kinds or of phases, and which; null where there is none.
// t: [s]; y: [px] from the top of the band.
export function namedAt(state, t, y) {
  const name = Object.keys(ROWS).find((row) => y >= ROWS[row][0] && y < ROWS[row][0] + ROWS[row][1]);
  const rows = name === "phases" ? state.phases : state.previewedSegments || state.segments;
  const row = name && rows.find(([t0, tn]) => t0 <= t && t < tn);
  return row ? { name, row } : null;
}

export function drawBand(context, area, state, ink) {
  context.font = fontOf();
  const preview = state.previewedSegments;
  spans(preview || state.segments, area, ([, , kind, probability, isFinal, corrected], x, width) => {
    block(context, ROWS.kinds, x, width, KINDS[kind].colour, 0.25 + 0.6 * probability, patternOf(context, kind));
    write(context, [`${kind}${corrected ? " ✎" : ""}${isFinal ? "" : " ~"}`, KINDS[kind].letter], ROWS.kinds, x, width, ink);
  });
  spans(state.phases, area, (phase, x, width) => {
    block(context, ROWS.phases, x, width, KINDS[kindOfPhase(phase[2])].colour, 0.1 + 0.3 * phase[3], null);
    context.strokeStyle = ink.faint;
    if (width >= FRAMED) context.strokeRect(x + 0.5, ROWS.phases[0] + 0.5, Math.max(width - 1, 1), ROWS.phases[1] - 1);
    write(context, [`${phaseName(phase)}${phase[4] ? "" : " ~"}`, phase[6] || phase[2]], ROWS.phases, x, width, ink, false);
  });
  if (preview) frame(context, area, state.effect.span, ink);
  context.textAlign = "right";
  context.textBaseline = "middle";
  context.fillStyle = ink.faint;
  for (const [name, [top, height]] of Object.entries(ROWS)) {
    const words = preview && name === "kinds" ? "preview" : name;
    if (state[name === "kinds" ? "segments" : "phases"].length) context.fillText(words, area.left - 3, top + height / 2);
  }
  veil(context, { ...area, top: ROWS.phases[0], bottom: ROWS.kinds[0] }, state, ink); // no changepoint through a phase's name
  before(context, { ...area, top: ROWS.kinds[0], bottom: BAND_HEIGHT }, state, ink, 1);
  for (const [t, , , , , corrected] of within(state.changepoints, { from: area.from, to: Math.min(area.to, state.shownEnd) }, 0)) {
    if (corrected || t === state.selected) diamond(context, area.x(t), ROWS.kinds[0], t === state.selected ? ink.accent : ink.text);
  }
}

// Around what is not there yet.
function frame(context, area, [from, to], ink) {
  const [top, height] = ROWS.kinds, x0 = Math.max(area.x(from), area.left), x1 = Math.min(area.x(to), area.right);
  context.strokeStyle = ink.accent;
  context.lineWidth = 3;
  context.strokeRect(x0, top + 1, x1 - x0, height - 2);
  context.lineWidth = 1;
}

function block(context, [top, height], x, width, colour, alpha, pattern) {
  context.globalAlpha = alpha;
  context.fillStyle = colour;
  context.fillRect(x, top, width, height);
  if (pattern && width >= PATTERNED) {
    context.fillStyle = pattern;
    context.fillRect(x, top, width, height);
  }
  context.globalAlpha = 1;
}

function write(context, texts, [top, height], x, width, ink, plate = true) {
  const text = width >= LETTERED && texts.find((words) => context.measureText(words).width <= width - 8);
  if (!text) return;
  context.textAlign = "center";
  context.textBaseline = "middle";
  if (plate) {
    const wide = context.measureText(text).width + 6;
    context.globalAlpha = 0.85;
    context.fillStyle = ink.paper;
    context.fillRect(x + width / 2 - wide / 2, top + 3, wide, height - 6);
    context.globalAlpha = 1;
  }
  context.fillStyle = ink.text;
  context.fillText(text, x + width / 2, top + height / 2 + 1);
}

function diamond(context, x, y, colour) {
  context.fillStyle = colour;
  context.beginPath();
  [[0, -7], [6, 0], [0, 7], [-6, 0]].forEach(([dx, dy]) => context.lineTo(x + dx, y + dy));
  context.fill();
}
