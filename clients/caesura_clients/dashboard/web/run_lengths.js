// How long the current segment may have lasted, and with which probability, at every time.
import { contextOf, fontOf } from "caesura-dashboard/canvas.js";
import { ticks } from "caesura-dashboard/scale.js";

export function drawRunLengths(canvas, scale, columns, ink) {
  const context = contextOf(canvas), y0 = 6, y1 = canvas.clientHeight - 6;
  const shown = columns.filter(([t]) => t >= scale.from && t <= scale.to);
  const longest = Math.max(2, ...shown.map(([, cells]) => Math.max(0, ...cells.map(([length]) => length))));
  const y = (length) => y1 - (length / longest) * (y1 - y0);
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
  context.font = fontOf();
  context.textAlign = "right";
  context.textBaseline = "middle";
  context.fillStyle = ink.faint;
  for (const [value, text] of ticks(0, longest, 4)) context.fillText(text, scale.x0 - 6, y(value));
}
