// The path that was measured, for the drawing in three dimensions: samples of the part of time that the plots show, each
// a place that the robot reported, in the colour of its segment. No line leads across missing samples.
//
// An answer has the extremes of each column alone. Where its bins are as narrow as two samples, that is every sample,
// and the three columns share their times; a time that they do not share is left out. A minute of them is a megabyte:
// they are asked for once the drawing comes into sight.
import { load } from "caesura-dashboard/signals.js";

export const SHOWN = "caesura-shown", ASKED = "caesura-shown-asked"; // events: what the plots show, and the question for it
const COLUMNS = ["px", "py", "pz"], MM = 1000;
const BINS = 4096, PART_S = 8; // of one query: bins of 2 ms, two samples of a robot at 1 kHz
const LONGEST_S = 64, MOST = 4000; // places that are drawn
const NEAR = "100px"; // of the window, where a drawing is about to be seen
const WAIT_MS = 300, AGAIN_MS = 1000, EPS_S = 1e-6;

// Places [t, x, y, z] at the times that all three columns have.
export function placesOf(points) {
  const [xs, ys, zs] = COLUMNS.map((name) => points[name] || []), places = [];
  for (let i = 0, j = 0, k = 0; i < xs.length && j < ys.length && k < zs.length;) {
    const t = Math.max(xs[i], ys[j], zs[k]);
    if (xs[i] === t && ys[j] === t && zs[k] === t) {
      places.push([t, MM * xs[i + 1], MM * ys[j + 1], MM * zs[k + 1]]);
      [i, j, k] = [i + 2, j + 2, k + 2];
    } else {
      if (xs[i] < t) i += 2;
      if (ys[j] < t) j += 2;
      if (zs[k] < t) k += 2;
    }
  }
  return places;
}

// Runs of places {kind, places} of one segment each, without a line across a hole. kind: null outside of all segments.
export function runsOf(places, segments, holes) {
  const runs = [];
  let at = 0, hole = 0, before = null;
  for (const place of places) {
    const [t] = place;
    while (at < segments.length && segments[at][1] <= t) at += 1;
    const kind = at < segments.length && segments[at][0] <= t ? segments[at][2] : null;
    while (hole < holes.length && holes[hole][1] <= (before ? before[0] : -Infinity) + EPS_S) hole += 1;
    const isApart = before !== null && hole < holes.length && holes[hole][0] < t - EPS_S;
    const last = runs.at(-1);
    if (!last || isApart) runs.push({ kind, places: [place] });
    else if (last.kind !== kind) runs.push({ kind, places: [before, place] });
    else last.places.push(place);
    before = place;
  }
  return runs;
}

export const measuredPath = {
  data: () => ({ measured: null, showsMeasured: true, plotted: null, why: "" }),
  computed: {
    runs() {
      return this.measured && this.showsMeasured ? runsOf(this.measured.places, this.plotted.segments, this.measured.holes) : [];
    },
    measuredWords() {
      if (!this.measured) return this.why;
      const { places, from, to, every } = this.measured, times = `${this.shownTime(from, 1)} to ${this.shownTime(to, 1)} s`;
      return `Measured: ${places.length} samples${every > 1 ? ` (1 of ${every})` : ""}, ${times} as in the plots.`;
    },
  },
  watch: { runs: "draw" },
  mounted() {
    this.sight = new IntersectionObserver((seen) => {
      this.isInSight = seen.at(-1).isIntersecting;
      if (this.isInSight && this.isDue) this.measure();
    }, { rootMargin: NEAR });
    this.sight.observe(this.$refs.canvas);
    window.addEventListener(SHOWN, this.follow);
    window.dispatchEvent(new CustomEvent(ASKED));
  },
  unmounted() {
    window.removeEventListener(SHOWN, this.follow);
    this.sight.disconnect();
    clearTimeout(this.due);
  },
  methods: {
    follow({ detail }) { // {station, session, from, to, segments, closed}
      const before = this.plotted, isOther = !before || ["session", "from", "to", "closed"].some((name) => before[name] !== detail[name]);
      this.plotted = Object.freeze(detail);
      if (!isOther) return;
      clearTimeout(this.due);
      if (!detail.closed || (before && before.session !== detail.session)) this.measured = null;
      if (!detail.closed) this.why = detail.session && "The measured path is drawn once the demonstration has ended.";
      else this.due = setTimeout(() => this.measure(), WAIT_MS);
    },
    async measure() {
      this.isDue = !this.isInSight;
      if (this.isDue) return;
      this.isLate = this.measuring; // one question at a time, then one for what is shown by then
      if (this.measuring || !this.plotted.closed) return;
      const asked = this.plotted, { from, to } = asked;
      this.why = to - from > LONGEST_S ? `The measured path is drawn where the plots show at most ${LONGEST_S} s: zoom in.` : "";
      if (this.why) return void (this.measured = null);
      this.measuring = true;
      try {
        const found = await this.samples(asked);
        if (this.plotted.session !== asked.session) this.isLate = true;
        else if (!this.isLate) this.measured = found && Object.freeze(found);
        if (!found) this.why = "No position was measured here.";
      } catch (error) {
        Object.assign(this, { measured: null, why: `The measured path cannot be shown: ${error.message}` });
        clearTimeout(this.due);
        this.due = setTimeout(() => this.measure(), AGAIN_MS);
      }
      this.measuring = false;
      if (this.isLate) this.measure();
    },
    async samples({ station, session, from, to }) { // from the journal, part after part
      const parts = Math.ceil((to - from) / PART_S), all = [], holes = [];
      for (let i = 0; i < parts; i += 1) {
        const range = { from: from + ((to - from) * i) / parts, to: from + ((to - from) * (i + 1)) / parts };
        const found = await load(station, session, { ...range, bins: BINS, columns: COLUMNS, exact: true });
        if (!COLUMNS.every((name) => found.available.includes(name))) return null;
        const known = all.length ? all.at(-1)[0] : -Infinity;
        all.push(...placesOf(found.points).filter(([t]) => t > known && t >= from && t <= to));
        holes.push(...found.holes);
      }
      if (!all.length) return null;
      const every = Math.ceil(all.length / MOST);
      const places = all.filter((_, k) => k % every === 0 || k === all.length - 1);
      return { places, holes, every, from: places[0][0], to: places.at(-1)[0] };
    },
  },
};
