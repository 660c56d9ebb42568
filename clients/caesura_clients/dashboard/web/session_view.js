// A session: the plot with everything that can be done in it, and the tools that correct what was found.
import { draw } from "caesura-dashboard/draw.js";
import { keyboard } from "caesura-dashboard/keyboard.js";
import { live } from "caesura-dashboard/live.js";
import { KINDS, percent, phaseName } from "caesura-dashboard/palette.js";
import { Scale } from "caesura-dashboard/scale.js";
import { template } from "caesura-dashboard/session_template.js";

const HELD_ROWS = 3000; // of signals: two minutes
const AUTHOR = "caesura-author";
const PLAY_S = 0.1;

const empty = () => ({
  segments: [], phases: [], changepoints: [], gaps: [], signals: [], unit: "m/s",
  tare: null, frame: "base", t: 0, closed: false, session: "", revision: 0, undoable: false, redoable: false,
});

export default {
  mixins: [live, keyboard],
  props: { editable: Boolean, replay: Boolean },
  emits: ["edit", "run-lengths"],
  template,
  data() {
    return {
      ...empty(),
      span: 30, end: null, cursor: null, selected: null, ghost: null, columns: null, playing: false,
      author: localStorage.getItem(AUTHOR) || "", kind: "contact", newton: 10, busy: false, message: "", failed: false,
      kinds: KINDS,
    };
  },
  mounted() {
    this.observers = [new ResizeObserver(() => this.redraw()), new MutationObserver(() => this.redraw())];
    this.observers[0].observe(this.$refs.canvas);
    this.observers[1].observe(document.documentElement, { attributes: true });
    this.scheme = matchMedia("(prefers-color-scheme: dark)");
    this.scheme.addEventListener("change", this.redraw);
  },
  unmounted() {
    this.observers.forEach((one) => one.disconnect());
    this.scheme.removeEventListener("change", this.redraw);
    clearInterval(this.player);
  },
  watch: {
    span: "redraw", end: "redraw", cursor: "redraw", selected: "redraw", ghost: "redraw", columns: "redraw",
    author: (name) => localStorage.setItem(AUTHOR, name),
  },
  computed: {
    newest() {
      const last = this.signals.length ? this.signals[this.signals.length - 1][0] : 0;
      return Math.max(this.t, last, 0.1);
    },
    shownEnd() {
      return this.end ?? this.newest;
    },
    segmentAtCursor() {
      return this.cursor === null ? null : this.segments.find(([t0, tn]) => t0 <= this.cursor && this.cursor <= tn);
    },
    selection() {
      const segment = this.segmentAtCursor;
      const inside = segment
        ? `${segment[2]} ${percent(segment[3])}${segment[6] ? `, else ${segment[6]}` : ""}, ` +
          `${segment[0].toFixed(2)} to ${segment[1].toFixed(2)} s`
        : "no segment";
      const phase = this.cursor === null ? null : this.phases.find(([t0, tn]) => t0 <= this.cursor && this.cursor <= tn);
      const within = phase ? `, in phase ${phaseName(phase)} ${percent(phase[3])}` : "";
      const point = this.changepoints.find(([t]) => t === this.selected);
      const where = point ? `changepoint at ${point[0].toFixed(2)} s, ${point[2] ? "final" : "provisional"} ` +
        `${percent(point[1])}` : "no changepoint selected";
      return this.cursor === null ? "Nothing selected. Click into the plot, or use the arrow keys in it."
        : `Time ${this.cursor.toFixed(2)} s: ${inside}${within}; ${where}.`;
    },
    newestFirst() {
      return this.segments.slice(-30).reverse();
    },
    ready() {
      return this.editable && this.session !== "" && this.author.trim() !== "" && !this.busy;
    },
  },
  methods: {
    percent,
    apply(payload) {
      if (payload.reset) Object.assign(this, empty(), { selected: null, cursor: null, ghost: null, end: null, busy: false, columns: this.columns && [] });
      for (const name of ["t", "closed", "session", "unit", "gaps", "revision", "undoable", "redoable", "columns", "tare", "frame"]) {
        if (name in payload) this[name] = payload[name];
      }
      for (const name of ["segments", "phases", "changepoints"]) {
        if (payload[name]) this[name] = Object.freeze([...this[name].slice(0, payload[name].first), ...payload[name].rows]);
      }
      this.letTheLastGoOn();
      if (payload.signals) this.signals = Object.freeze([...this.signals, ...payload.signals].slice(-HELD_ROWS));
      if (payload.newColumns && this.columns) this.columns = Object.freeze([...this.columns, ...payload.newColumns].slice(-HELD_ROWS));
      this.forgetWhatIsGone();
      this.redraw();
    },
    letTheLastGoOn() { // its end is published once a second only
      for (const name of ["segments", "phases"]) {
        const last = this[name][this[name].length - 1];
        if (!last || this.closed || last[1] >= this.t) continue;
        this[name] = Object.freeze([...this[name].slice(0, -1), [last[0], this.t, ...last.slice(2)]]);
      }
    },
    forgetWhatIsGone() {
      if (this.selected !== null && !this.changepoints.some(([t]) => t === this.selected)) this.selected = null;
    },
    answered(message, failed) {
      Object.assign(this, { message, failed, busy: false });
    },
    scale() {
      const canvas = this.$refs.canvas;
      const end = this.shownEnd, span = Math.min(this.span, Math.max(end, 5));
      const from = Math.max(0, end - span);
      return new Scale(canvas.clientWidth, canvas.clientHeight, from, Math.max(end, from + span), this.columns ? 4 : 3);
    },
    redraw() {
      if (this.asked) return;
      this.asked = requestAnimationFrame(() => {
        this.asked = 0;
        if (this.$refs.canvas) this.paint(this.$refs.canvas);
      });
    },
    paint(canvas) {
      const ratio = window.devicePixelRatio || 1;
      const [width, height] = [canvas.clientWidth * ratio, canvas.clientHeight * ratio].map(Math.round);
      if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
      const context = canvas.getContext("2d");
      context.setTransform(ratio, 0, 0, ratio, 0, 0);
      draw(context, this.scale(), this, this.ink());
    },
    ink() {
      const style = getComputedStyle(document.documentElement);
      const value = (name) => style.getPropertyValue(`--${name}`).trim();
      const names = { text: "ink", faint: "faint", paper: "paper", rule: "rule", accent: "accent", alarm: "alarm" };
      const ink = Object.fromEntries(Object.entries(names).map(([key, name]) => [key, value(name)]));
      return { ...ink, onAccent: value("on-accent"), lines: [value("line-x"), value("line-y"), value("line-z")] };
    },

    // --- pointer: a press on a changepoint selects it, and drags it where it is moved; elsewhere it sets the time ---
    pressed(event) {
      const scale = this.scale(), x = event.offsetX;
      const found = scale.near(x, this.changepoints.map(([t]) => t), event.pointerType);
      this.selected = found < 0 ? null : this.changepoints[found][0];
      this.cursor = this.selected ?? this.within(scale.t(x));
      this.pressedAt = x;
      this.dragging = this.selected !== null && this.editable;
      if (this.dragging) event.target.setPointerCapture(event.pointerId);
    },
    dragged(event) {
      if (!this.dragging || Math.abs(event.offsetX - this.pressedAt) < 4) return;
      this.ghost = this.within(this.scale().t(event.offsetX));
    },
    released() {
      const to = this.ghost;
      Object.assign(this, { ghost: null, dragging: false });
      if (to === null) return;
      this.cursor = to;
      this.move();
    },
    within(t) {
      return Math.round(100 * Math.min(Math.max(t, 0), this.newest)) / 100;
    },

    // --- time ---
    scrub(event) {
      this.end = Number(event.target.value);
      this.cursor = this.end;
    },
    follow() {
      this.stop();
      this.end = null;
    },
    play() {
      if (this.playing) return this.stop();
      this.playing = true;
      if (this.end === null || this.end >= this.newest) this.end = 0;
      this.player = setInterval(() => {
        this.end = Math.min(this.end + PLAY_S, this.newest);
        this.cursor = this.within(this.end);
        if (this.end >= this.newest) this.stop();
      }, 1000 * PLAY_S);
    },
    stop() {
      clearInterval(this.player);
      this.playing = false;
    },
    choose(segment) {
      this.cursor = segment[0];
      const point = this.changepoints.find(([t]) => Math.abs(t - segment[0]) < 0.01);
      this.selected = point ? point[0] : null;
      if (segment[0] < this.scale().from) this.end = Math.min(segment[1] + 2, this.newest);
    },
    toggleRunLengths() {
      this.columns = this.columns ? null : [];
      this.$emit("run-lengths", this.columns !== null);
    },

    // --- corrections ---
    edit(action) {
      if (!this.editable || this.session === "") return;
      if (!this.author.trim()) {
        this.answered("Say who you are first: corrections carry a name.", true);
        this.$refs.author.focus();
        return;
      }
      if (this.busy) return;
      Object.assign(this, { busy: true, message: "", failed: false });
      this.$emit("edit", { ...action, session: this.session, revision: this.revision, author: this.author.trim() });
    },
    insert() {
      if (this.cursor !== null) this.edit({ do: "insert", t: this.cursor });
    },
    remove() {
      if (this.selected !== null) this.edit({ do: "remove", t: this.selected });
    },
    move() {
      if (this.selected !== null && this.cursor !== null) this.edit({ do: "move", t: this.selected, to: this.cursor });
    },
    relabel() {
      if (this.cursor !== null) this.edit({ do: "relabel", t: this.cursor, kind: this.kind });
    },
    limit(newton) {
      if (this.cursor !== null) this.edit({ do: "limit_force", t: this.cursor, newton });
    },
    undo() {
      if (this.undoable) this.edit({ do: "undo" });
    },
    redo() {
      if (this.redoable) this.edit({ do: "redo" });
    },
  },
};
