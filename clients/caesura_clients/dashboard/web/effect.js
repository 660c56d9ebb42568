// What a correction would change, asked of the service before it is made. One question is under way at a time, and only
// the newest answer is shown.
const WAIT_MS = 200; // that a correction has been pointed at, at least
// Likewise, in times of the last answer. An answer for a long session takes seconds of the service's work, which what is
// taught meanwhile needs too; once it is taught, CLOSED_MS are enough.
const ANSWERS = 2, CLOSED_MS = 1000;
const EPS = 1e-3; // [s] rows are rounded to
// What is stated meanwhile of a long session, which the service has to build from its journal first.
const SLOW_MS = 1000;
const COMPUTING = Object.freeze({ lead: "Preview", words: ["The service computes it …"], rows: [], span: [0, 0], failed: false, waits: true });

// The listeners of a button that makes a correction: `on` when it is pointed at, `off` when no longer. A finger points at
// nothing before it presses.
export const pointing = (on, off) => {
  const unlessTouch = (act) => (event) => event.pointerType === "touch" || act();
  return { pointerenter: unlessTouch(on), pointerleave: unlessTouch(off), focus: on, blur: off };
};

export const effect = {
  data: () => ({ effect: null, effectAt: "" }),
  created() {
    Object.assign(this, { wanted: null, underWay: null, askedAt: 0, answerMs: 0 });
  },
  unmounted() {
    clearTimeout(this.effectDue);
    clearTimeout(this.slow);
  },
  watch: {
    revision() {
      this.preview(null);
    },
    effect: "redraw",
  },
  computed: {
    previewedSegments() { // rows of the band with those that would take the place of others
      if (!this.effect || !this.effect.rows.length) return null;
      const [from, to] = this.effect.span;
      const rows = this.effect.rows.map(([t0, tn, kind]) => [t0, tn, kind, 1, true, false]);
      return [...this.segments.filter(([, tn]) => tn < from + EPS), ...rows, ...this.segments.filter(([t0]) => t0 > to - EPS)];
    },
    dragWords() { // what is known of a drag before the service answers
      const segment = (cell) => this.segments.find((one) => Math.abs(one[cell] - this.selected) < EPS);
      const [before, after] = [segment(1), segment(0)];
      if (!before || !after || this.ghost <= before[0] || this.ghost >= after[1]) return `To ${this.shownTime(this.ghost)} s.`;
      const at = this.shownTime(this.ghost);
      return `${before[2]} ${this.shownTime(before[0])} to ${at} s, ${after[2]} ${at} to ${this.shownTime(after[1])} s.`;
    },
  },
  methods: {
    preview(action, at = "") { // null: nothing is pointed at any more
      clearTimeout(this.effectDue);
      if (JSON.stringify(action) !== JSON.stringify(this.wanted)) Object.assign(this, { effect: null, wanted: action });
      this.effectAt = action ? at : "";
      if (action && !this.effect) this.askSoon();
    },
    askSoon() {
      const wait = Math.min(ANSWERS * this.answerMs, this.closed ? CLOSED_MS : Infinity);
      clearTimeout(this.effectDue);
      this.effectDue = setTimeout(() => this.askEffect(), Math.max(WAIT_MS, wait));
    },
    pointing(action) { // listeners of a button that makes a correction
      return pointing(() => this.preview(action, "tip"), () => this.preview(null));
    },
    askEffect() {
      if (!this.wanted || this.underWay || !this.editable || this.session === "") return;
      Object.assign(this, { underWay: this.wanted, askedAt: performance.now() });
      this.slow = setTimeout(() => (this.effect ??= this.underWay === this.wanted ? COMPUTING : null), SLOW_MS);
      this.$emit("preview", { ...this.wanted, session: this.session, revision: this.revision });
    },
    previewed(found) {
      clearTimeout(this.slow);
      const isNewest = this.underWay === this.wanted;
      Object.assign(this, { underWay: null, answerMs: performance.now() - this.askedAt });
      if (isNewest) this.effect = Object.freeze(found);
      else if (this.wanted) this.askSoon();
    },
    forgetEffect() {
      this.preview(null);
      clearTimeout(this.slow);
      this.underWay = null;
    },
  },
};
