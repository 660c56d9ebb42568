// The clock of a session as people read it, as `session_time_display.py`: from `start` [s] on. What is drawn,
// chosen and sent has the clock of the samples.
import { fixed } from "caesura-dashboard/numbers.js";

const OF_DAY_S = 1e8;
export const isOfDay = (t) => t >= OF_DAY_S;

export const clock = {
  methods: {
    shownTime(t, digits = 2) {
      return fixed(t - this.start, digits);
    },
    readTime(typed) { // one of day is taken as it is
      return isOfDay(typed) ? typed : typed + this.start;
    },
  },
};

// Ticks at round shown times, on the clock of the samples.
export function roundTicks(start, low, high, step) {
  const first = Math.ceil((low - start) / step - 1e-6), last = Math.floor((high - start) / step + 1e-6);
  return Array.from({ length: Math.max(0, last - first + 1) }, (_, i) => start + (first + i) * step);
}
