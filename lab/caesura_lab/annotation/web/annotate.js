// A recording and its marks. Every edit goes to the server with the cursor's time; what comes back is drawn.
import { KINDS } from "caesura-dashboard/palette.js";
import { Scale } from "caesura-dashboard/scale.js";
import { keys, template } from "caesura-annotate/annotate_template.js";
import { linesOf, paint } from "caesura-annotate/annotate_draw.js";

const WINDOW_S = 4; // of the protocol
const LEAST_S = 0.2;
const STEP_S = 0.05;
const FINE_STEP_S = 0.005;
const PANELS = 4;
const milliseconds = (t) => Math.round(1000 * t) / 1000; // as the annotation has it

export default {
  props: { signals: Object, initial: Object },
  emits: ["command"],
  template,
  data() {
    const t = this.signals.t;
    return {
      first: t[0], last: t[t.length - 1], from: t[0], to: t[t.length - 1], cursor: milliseconds(t[0]),
      points: [], segments: [], window: [t[0], t[t.length - 1]], saved: true, stored: false, message: "", failed: false, keys, kinds: KINDS,
    };
  },
  created() {
    this.isAsked = false; // a command that the server has not answered
    this.waiting = []; // actions behind it
    this.show(this.initial);
  },
  mounted() {
    this.observers = [new ResizeObserver(() => this.redraw()), new MutationObserver(() => this.redraw())];
    this.observers[0].observe(this.$refs.canvas);
    this.observers[1].observe(document.documentElement, { attributes: true });
    window.addEventListener("beforeunload", this.leaving);
    this.$refs.canvas.focus();
    this.redraw();
  },
  unmounted() {
    this.observers.forEach((one) => one.disconnect());
    window.removeEventListener("beforeunload", this.leaving);
  },
  watch: { from: "redraw", to: "redraw", cursor: "redraw" },
  computed: {
    lines() {
      return linesOf(this.signals);
    },
    nearest() {
      return this.points.reduce((best, point) => (best && Math.abs(best.t - this.cursor) <= Math.abs(point.t - this.cursor) ? best : point), null);
    },
    standing() {
      if (!this.saved) return "not saved";
      return this.stored ? "saved" : "nothing to save yet";
    },
    here() {
      const end = this.window[1];
      const segment = this.segments.find(({ t0, t1 }) => t0 <= this.cursor && (this.cursor < t1 || (t1 === end && this.cursor === end)));
      return segment ? `${segment.cls} from ${segment.t0.toFixed(2)} to ${segment.t1.toFixed(2)} s` : "no class";
    },
    near() {
      const point = this.nearest;
      if (!point) return "no changepoint yet";
      const second = "t_alt" in point ? ` or ${point.t_alt.toFixed(3)} s` : "";
      return `nearest: ${point.kind || "dip"} at ${point.t.toFixed(3)} s${second}, ± ${point.tol.toFixed(2)} s, ${point.level}`;
    },
  },
  methods: {
    show(state) {
      Object.assign(this, state);
      this.redraw();
    },
    // In the order of the keys; what needs the marks, and what is behind it, waits for the answer to a command.
    act(action, needsMarks = false) {
      if (this.waiting.length || (needsMarks && this.isAsked)) this.waiting.push(action);
      else action();
    },
    // One at a time: before the connection stands, events do not arrive in the order of the keys.
    command(name) {
      this.act(() => {
        this.isAsked = true;
        this.$emit("command", { name, t: this.cursor });
      }, true);
    },
    answered(state) {
      this.show(state);
      this.isAsked = false;
      while (this.waiting.length && !this.isAsked) this.waiting.shift()();
    },
    key(event) {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      const step = event.shiftKey ? FINE_STEP_S : STEP_S;
      const actions = {
        ArrowLeft: () => this.goto(this.cursor - step),
        ArrowRight: () => this.goto(this.cursor + step),
        ArrowUp: () => this.zoom(0.5),
        ArrowDown: () => this.zoom(2),
        PageUp: () => this.pan(-0.5),
        PageDown: () => this.pan(0.5),
        Home: () => this.goto(this.first),
        End: () => this.goto(this.last),
        v: () => this.toggleWindow(),
      };
      const pressed = event.key.length === 1 ? event.key.toLowerCase() : event.key; // the caps lock may be on
      const known = keys.find(({ key, alias }) => key === pressed || alias === pressed);
      const hops = { "[": -1, "]": 1 };
      if (pressed in hops) this.act(() => this.hop(hops[pressed]), true);
      else if (pressed in actions) this.act(actions[pressed]);
      else if (known) this.command(known.name);
      else return;
      event.preventDefault();
    },
    goto(t) {
      this.cursor = milliseconds(Math.min(Math.max(t, this.first), this.last));
      if (this.cursor < this.from || this.cursor > this.to) this.look(this.cursor - (this.to - this.from) / 2, this.to - this.from);
    },
    hop(by) {
      const times = this.points.map(({ t }) => t);
      const found = by > 0 ? times.find((t) => t > this.cursor + 5e-4) : times.filter((t) => t < this.cursor - 5e-4).pop();
      if (found !== undefined) this.goto(found);
    },
    zoom(by, at = this.cursor) {
      const span = Math.min(Math.max((this.to - this.from) * by, LEAST_S), this.last - this.first);
      this.look(at - ((at - this.from) / (this.to - this.from)) * span, span);
    },
    pan(by) {
      this.look(this.from + by * (this.to - this.from), this.to - this.from);
    },
    toggleWindow() {
      if (this.to - this.from > WINDOW_S + 1e-9) this.look(this.cursor - WINDOW_S / 2, WINDOW_S);
      else this.look(this.first, this.last - this.first);
    },
    look(from, span) {
      this.from = Math.max(this.first, Math.min(from, this.last - span));
      this.to = Math.min(this.from + span, this.last);
    },
    pressed(event) {
      const t = this.scale().t(event.offsetX);
      this.act(() => this.goto(t));
    },
    wheeled(event) {
      const at = this.scale().t(event.offsetX);
      this.zoom(event.deltaY < 0 ? 0.8 : 1.25, Math.min(Math.max(at, this.from), this.to));
    },
    leaving(event) {
      if (!this.saved) event.preventDefault();
    },
    scale() {
      const canvas = this.$refs.canvas;
      return new Scale(canvas.clientWidth, canvas.clientHeight, this.from, this.to, PANELS);
    },
    redraw() {
      if (this.asked) return;
      this.asked = requestAnimationFrame(() => {
        this.asked = 0;
        if (this.$refs.canvas) paint(this.$refs.canvas, this.scale(), this);
      });
    },
  },
};
