// Where things lie in the plot: time to the right, panels one below the other. Pixels are those of CSS.
import { fixed } from "caesura-dashboard/numbers.js";

export const MARGIN = { left: 64, right: 12, top: 46, bottom: 24 };
export const BAND = { top: 3, height: 17 }; // of the phases
export const GAP = 14; // between panels
export const HANDLE = { mouse: 9, pen: 12, touch: 22 }; // how near a pointer must come to a changepoint

export class Scale {
  constructor(width, height, from, to, panels) {
    Object.assign(this, { width, height, from, to });
    this.x0 = MARGIN.left;
    this.x1 = Math.max(width - MARGIN.right, this.x0 + 1);
    this.top = MARGIN.top;
    this.bottom = height - MARGIN.bottom;
    const each = (this.bottom - this.top - GAP * (panels - 1)) / panels;
    this.panels = Array.from({ length: panels }, (_, i) => {
      const y0 = this.top + i * (each + GAP);
      return [y0, y0 + each];
    });
  }
  x(t) {
    return this.x0 + ((t - this.from) / (this.to - this.from)) * (this.x1 - this.x0);
  }
  t(x) {
    return this.from + ((x - this.x0) / (this.x1 - this.x0)) * (this.to - this.from);
  }
  near(x, times, pointer) {
    const reach = HANDLE[pointer] || HANDLE.mouse;
    let best = -1;
    times.forEach((t, i) => {
      const off = Math.abs(this.x(t) - x);
      if (off <= reach && (best < 0 || off < Math.abs(this.x(times[best]) - x))) best = i;
    });
    return best;
  }
}

export function ticks(low, high, wanted) {
  const raw = (high - low) / wanted;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((n) => n * power).find((n) => n >= raw);
  const first = Math.ceil(low / step - 1e-9);
  const found = [];
  for (let i = first; i * step <= high + step * 1e-9; i += 1) found.push(i * step);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return found.map((value) => [value, fixed(value, digits)]);
}
