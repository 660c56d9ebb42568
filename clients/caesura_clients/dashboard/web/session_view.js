// A session: the plots with everything that can be done in them, and the tools that correct what was found.
import { AUTHOR, isOfAuthor, storeAuthor } from "caesura-dashboard/author.js";
import { contextOf, inkOf, Painter, watchLook } from "caesura-dashboard/canvas.js";
import { changes } from "caesura-dashboard/clicks.js";
import { clock, isOfDay } from "caesura-dashboard/clock.js";
import Corrections from "caesura-dashboard/corrections.js";
import CorrectMenu from "caesura-dashboard/correct_menu.js";
import { effect } from "caesura-dashboard/effect.js";
import { giveBack } from "caesura-dashboard/focus.js";
import EffectWords from "caesura-dashboard/effect_words.js";
import { keyboard } from "caesura-dashboard/keyboard.js";
import { live } from "caesura-dashboard/live.js";
import { ASKED, SHOWN as PLOTTED } from "caesura-dashboard/measured_path.js";
import { BAND_HEIGHT, drawBand } from "caesura-dashboard/marks.js";
import { KINDS, percent, phaseName } from "caesura-dashboard/palette.js";
import { pair, SHARED } from "caesura-dashboard/pair.js";
import { Plots } from "caesura-dashboard/plots.js";
import { pointer } from "caesura-dashboard/pointer.js";
import { drawRunLengths } from "caesura-dashboard/run_lengths.js";
import { Scale } from "caesura-dashboard/scale.js";
import { template } from "caesura-dashboard/session_template.js";
import { greatest, ofArm, ofGripper, PANELS, SHOWN_AT_FIRST } from "caesura-dashboard/signals.js";
import Staying from "caesura-dashboard/staying.js";
import { unanswered } from "caesura-dashboard/unanswered.js";
import { undoing } from "caesura-dashboard/undoing.js";
import { view } from "caesura-dashboard/view.js";
import { YScales } from "caesura-dashboard/y_scales.js";

const requests = unanswered("correction");
const UNANSWERED = "A correction was asked for before this page was loaded again, and no answer came: make it again if it is not listed below.";
const OUTDATED = "Not done. The session has been corrected since: look at the current state.";
const UNSELECTED = "No changepoint is selected: Page ↑ and Page ↓ select one.";
const HELD_COLUMNS = 3000; // of run lengths: five minutes
const SHOWN = "caesura-signals";
const ROUNDED = 5e-4; // [s] by which the times of rows are off
const PLAY_S = 0.1, LISTED = 30;
// What a hint says where a finger points, and where a mouse does.
const POINTING = matchMedia("(pointer: coarse)").matches
  ? { choose: "Tap", correct: "hold your finger there to correct it", move: "drag it to see another time", opens: "a long press" }
  : { choose: "Click", correct: "right-click it to correct", move: "use the arrow keys in it", opens: "a right click" };

const noRows = () => ({ segments: [], phases: [], changepoints: [] });
const empty = () => ({
  segments: [], phases: [], changepoints: [], data: null, available: [], widest: 0,
  tare: null, frame: "base", start: 0, t: 0, closed: false, session: "", revision: 0, made: 0, undoable: false, redoable: false,
  corrections: [],
});
// The row at a time: at a changepoint the later one, as a correction there means it.
const rowAt = (rows, t) => {
  if (t === null) return null;
  const last = rows[rows.length - 1];
  return rows.find(([t0, tn]) => t0 <= t + ROUNDED && t + ROUNDED < tn) || (last && last[0] <= t && t <= last[1] + ROUNDED ? last : null);
};
const chosen = () => {
  try {
    return JSON.parse(localStorage.getItem(SHOWN)) || SHOWN_AT_FIRST;
  } catch {
    return SHOWN_AT_FIRST;
  }
};

export default {
  mixins: [clock, live, keyboard, view, pair, pointer, effect, undoing],
  components: { CorrectMenu, Corrections, EffectWords, Staying },
  props: { station: String, editable: Boolean, replay: Boolean, why: { type: String, default: "Corrections are off: this dashboard only reads." } },
  emits: ["edit", "preview", "run-lengths"],
  template,
  data() {
    return {
      ...empty(),
      span: 30, end: null, cursor: null, selected: null, ghost: null, marked: null, columns: null, playing: false, listed: false,
      author: localStorage.getItem(AUTHOR) || "", draft: "", asked: null, busy: false, message: "", failed: false, refusedAt: null,
      menu: null, canTake: false, pointedInBand: null, doubt: "", inList: false,
      kinds: KINDS, opens: POINTING.opens, chosen: chosen(), trouble: "",
    };
  },
  created() {
    Object.assign(this, { fingers: new Map(), drag: null, panned: false, waiting: 0, loading: false, origin: null, opener: null, menuOpener: null, hasRecalled: false, received: noRows() });
  },
  mounted() {
    this.plots = new Plots(this.$refs.panels, this, this.linked ? SHARED : new YScales());
    this.own = [new Painter(this.$refs.band, this.paintBand), new Painter(this.$refs.lengths, this.paintLengths)];
    this.$refs.plots.plots = this.plots; // for who looks at the page from outside
    this.unwatch = watchLook(this.$refs.plots, this.arrange, this.redraw);
    window.addEventListener(AUTHOR, this.named);
    window.addEventListener(ASKED, this.tellShown);
  },
  unmounted() {
    this.unwatch();
    window.removeEventListener(AUTHOR, this.named);
    window.removeEventListener(ASKED, this.tellShown);
    clearInterval(this.player);
    clearTimeout(this.waiting);
    this.plots.close();
    this.own.forEach((one) => one.close());
  },
  watch: {
    span: "moved", end: "moved", cursor: "redraw", selected: "redraw", ghost: "redraw", columns: "goOn",
    panels: "arrange",
    editable() {
      Object.assign(this, { menu: null, asked: null });
    },
    chosen(names) {
      if (!this.isStacked()) localStorage.setItem(SHOWN, JSON.stringify(names));
    },
    author: (name) => localStorage.setItem(AUTHOR, name),
  },
  computed: {
    newest() {
      return Math.max(this.t, (this.data && this.data.last) || 0, 0.1);
    },
    begin() { // [s] most sessions begin at 0; a clock that does not is shown from its first segment on
      const t = this.segments.length ? this.segments[0][0] : this.start;
      return t < 0 || t > 60 ? t : 0;
    },
    offered() { // signals that this session has
      return PANELS.map((one) => ofArm(one, this.available)).filter((one) => one.inferred || (one.columns.length && one.columns.every((name) => this.available.includes(name))))
        .map((one) => this.described(one));
    },
    panels() {
      return this.offered.filter((one) => this.chosen.includes(one.name));
    },
    tipStyle() { // beside what is dragged, or at the right
      if (this.ghost === null) return { right: "0.5rem" };
      const x = this.scale().x(this.ghost), width = this.$refs.plots.clientWidth;
      return x < width / 2 ? { left: `${x + 12}px` } : { right: `${width - x + 12}px` };
    },
    bandWords() { // of what is pointed at in the band, as of the selected segment
      const { name, row } = this.pointedInBand, [t0, tn, kind, probability] = row;
      const what = name === "phases" ? `phase ${phaseName(row)}` : kind, marks = [name === "kinds" && row[5] ? "corrected" : "", row[4] ? "" : "provisional"];
      return [`${what} ${percent(probability)}`, `${this.shownTime(t0)} to ${this.shownTime(tn)} s`, ...marks].filter(Boolean).join(", ");
    },
    bandStyle() {
      const { x } = this.pointedInBand, width = this.$refs.plots.clientWidth;
      return x < width / 2 ? { left: `${x + 12}px` } : { right: `${width - x + 12}px` };
    },
    markedStyle() {
      return this.marked && { left: `${this.marked[0]}px`, width: `${this.marked[1] - this.marked[0]}px` };
    },
    shownEnd() {
      return this.end ?? this.newest;
    },
    segmentAtCursor() {
      return rowAt(this.segments, this.cursor);
    },
    phaseAtCursor() {
      return rowAt(this.phases, this.cursor);
    },
    selection() {
      const segment = this.segmentAtCursor;
      const inside = segment
        ? `${segment[2]} ${percent(segment[3])}${segment[6] ? `, else ${segment[6]}` : ""}, ` +
          `${this.shownTime(segment[0])} to ${this.shownTime(segment[1])} s`
        : "no segment";
      const phase = this.phaseAtCursor;
      const within = phase ? `, in phase ${phaseName(phase)} ${percent(phase[3])}` : "";
      const point = this.changepoints.find(([t]) => t === this.selected);
      const where = point ? `changepoint at ${this.shownTime(point[0])} s, ${point[2] ? "final" : "provisional"} ` +
        `${percent(point[1])}` : "no changepoint selected";
      if (!this.session) return this.replay ? "" : "Signals and segments are drawn here once a demonstration begins.";
      return this.cursor === null ? `${POINTING.choose} a time in the plot, or ${this.editable ? POINTING.correct : POINTING.move}.`
        : `Time ${this.shownTime(this.cursor)} s: ${inside}${within}; ${where}.`;
    },
    newestFirst() {
      return this.segments.slice(-LISTED).reverse();
    },
  },
  methods: {
    percent,
    apply(payload) {
      if (payload.reset) this.restart(payload.session);
      for (const name of ["start", "t", "closed", "session", "revision", "undoable", "redoable", "corrections", "columns", "tare", "frame"]) {
        if (name in payload) this[name] = payload[name];
      }
      this.revision = Math.max(this.revision, this.made); // what was sent before an edit of this page may come after its answer
      if (this.refusedAt !== null && this.revision > this.refusedAt) Object.assign(this, { message: OUTDATED, failed: false, refusedAt: null });
      for (const name of ["segments", "phases", "changepoints"]) {
        if (!payload[name]) continue;
        this.received[name] = Object.freeze([...this.received[name].slice(0, payload[name].first), ...payload[name].rows]);
        this[name] = this.received[name];
      }
      this.letTheLastGoOn();
      if (payload.newColumns && this.columns) this.columns = Object.freeze([...this.columns, ...payload.newColumns].slice(-HELD_COLUMNS));
      this.forgetWhatIsGone();
      this.fit();
      if (payload.segments || payload.changepoints) this.plots.fill(true);
      if (payload.reset || this.closed) this.redraw();
      else this.goOn();
      if (payload.reset || payload.segments || "closed" in payload) this.tellShown();
      this.want();
      if (this.editable && this.session !== "" && !this.hasRecalled) this.recall();
    },
    recall() { // a correction whose answer was lost with the connection
      this.hasRecalled = true;
      const isHere = ({ station, session }) => station === this.station && session === this.session;
      if (requests.recall(isHere)) Object.assign(this, { message: UNANSWERED, failed: true });
    },
    restart(session) { // with another session, or after the connection was lost
      if (this.busy || session !== this.session) Object.assign(this, { message: "", failed: false, refusedAt: null });
      this.forgetEffect();
      this.forgetActs();
      this.received = noRows();
      const { available } = this; // the panels of the session before stand until the samples of this one are there
      Object.assign(this, empty(), { available, menu: null, asked: null, doubt: "", selected: null, cursor: null, ghost: null, end: null, span: 30,
        busy: false, columns: this.columns && [], origin: null, fitted: false });
    },
    fit() { // a session that is over when it is first shown is shown as a whole
      if (this.fitted || this.session === "" || !(this.t > 0)) return;
      this.fitted = true;
      if (this.replay || this.closed) this.span = this.longest();
    },
    letTheLastGoOn() { // its end is published once a second only; the rows that follow leave it as it was received
      if (!this.received.phases.length) return; // a new page has only the first segment yet
      for (const name of ["segments", "phases"]) {
        const rows = this.received[name], last = rows[rows.length - 1];
        if (!last || this.closed || last[1] >= this.t) continue;
        this[name] = Object.freeze([...rows.slice(0, -1), [last[0], this.t, ...last.slice(2)]]);
      }
    },
    forgetWhatIsGone() {
      if (this.selected !== null && !this.changepoints.some(([t]) => t === this.selected)) this.selected = null;
    },
    answered(message, failed, revision = null, doubt = "") { // revision: of the session, to which a refusal applies; doubt: as of a transport without a load
      requests.forget();
      Object.assign(this, { refusedAt: revision, doubt: doubt && `${doubt} Undo takes it back.` });
      Object.assign(this, { message: failed ? message : this.wordsOf(message), failed, busy: false });
      if (failed) this.made = 0;
      else if (this.act) this.acted();
      this.act = null;
      if (failed && isOfAuthor(message)) this.askAgain();
    },
    named(event) {
      this.author = event.detail;
    },
    scale() {
      return new Scale(this.$refs.plots.clientWidth, BAND_HEIGHT, ...this.view(), 1);
    },
    painters() {
      this.plots.ink = this.ink();
      return [...this.own, ...this.plots.painters];
    },
    redraw() { // something was moved or chosen
      this.painters().forEach((one) => one.now());
    },
    goOn() { // something new arrived
      this.painters().forEach((one) => one.soon(this.pixelMs()));
    },
    tellShown() { // to the path in three dimensions
      if (this.linked) return;
      const [from, to] = this.view(), { station, session, segments, closed } = this;
      window.dispatchEvent(new CustomEvent(PLOTTED, { detail: { station, session, from, to: Math.min(to, this.newest), segments, closed } }));
    },
    moved() {
      this.redraw();
      this.tellShown();
      clearTimeout(this.waiting);
      this.waiting = 0;
      this.want();
    },
    paintBand() {
      const context = contextOf(this.$refs.band), scale = this.scale();
      drawBand(context, { left: scale.x0, right: scale.x1, from: scale.from, to: scale.to, x: (t) => scale.x(t) }, this, this.plots.ink);
      Object.assign(this.$refs.plots.dataset, { from: scale.from, to: scale.to });
    },
    paintLengths() {
      if (this.columns) drawRunLengths(this.$refs.lengths, this.scale(), this.columns, this.plots.ink);
    },
    arrange() { // other panels, or another width
      if (!this.plots.show(this.panels)) return; // a panel more makes the view higher, and all stays as it is drawn
      if (this.menu) Object.assign(this.menu, { x: this.scale().x(this.cursor), ...this.spaceOfMenu() });
      this.moved();
    },

    // --- signals ---
    take_data(data) {
      const isWhole = (this.replay || this.closed) && this.end === null && this.span >= this.longest();
      if (data.available.join() !== this.available.join()) this.available = data.available;
      this.data = Object.freeze({ ...data, shown: data.shown || this.shownColumns() }); // the first answer has all columns
      if (!this.segments.length && isOfDay(data.last)) this.start = data.first ?? data.last; // the first segment is not there yet
      if (isWhole) this.span = this.longest(); // the last samples are later than what was found
      this.widest = Math.max(this.widest, greatest(data.points.gripper));
      if (!this.origin && data.points.px && data.points.px.length) {
        this.origin = this.segments.length ? this.segments[0][7] : ["px", "py", "pz"].map((name) => data.points[name][1]);
      }
      this.plots.fill();
      if (this.closed) this.tellShown(); // up to the last sample
      if (this.end === null && !this.closed) this.goOn();
      else this.redraw();
    },
    shownColumns() {
      const columns = this.panels.filter((one) => !one.inferred).flatMap((one) => one.columns);
      return this.available.length ? (columns.length ? columns : this.available.slice(0, 1)).join(",") : "";
    },
    toggle(name) {
      if (this.isStacked()) return this.chooseForBoth(name);
      this.chosen = this.chosen.includes(name) ? this.chosen.filter((one) => one !== name) : [...this.chosen, name];
    },
    described(panel) {
      if (panel.tared) {
        const frame = this.frame === "flange" ? " at the flange" : "";
        return { ...panel, title: `${panel.title} ${this.tare ? "without its bias" : "as measured"}${frame}` };
      }
      if (panel.name === "gripper") return ofGripper(panel, this.widest);
      return panel.name === "speed" && !this.available.includes("px") ? { ...panel, title: "speed of the joints", unit: "rad/s", factor: 1, digits: 3 } : panel;
    },
    off(panel) { // what is taken off what was measured, as the title of the panel says
      return (panel.fromStart ? this.origin : panel.tared ? this.tare : null) || [];
    },
    ink: inkOf,

    within(t) {
      return this.start + Math.round(100 * (Math.min(Math.max(t, this.begin), this.newest) - this.start)) / 100;
    },

    // --- time ---
    scrub(event) {
      this.end = Number(event.target.value);
      this.cursor = this.end;
    },
    follow() {
      this.stop();
      Object.assign(this, { end: null, span: this.replay ? this.longest() : Math.max(this.span, 30) });
    },
    play() {
      if (this.playing) return this.stop();
      this.playing = true;
      if (this.end === null || this.end >= this.newest) this.end = this.begin;
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
      this.reveal(segment[0]);
    },
    toggleRunLengths() {
      this.columns = this.columns ? null : [];
      this.$emit("run-lengths", this.columns !== null);
    },

    // --- corrections ---
    edit(action, how = {}) { // how: of an undo or a redo, as `undoing.js` has it
      if (!this.editable || this.session === "" || this.busy) return;
      if (!this.author.trim()) return this.askName(action, how);
      this.preview(null);
      changes();
      this.act = { number: action.do === "take_back" ? action.number : null, ...how, seen: this.revision };
      Object.assign(this, { busy: true, message: "Correcting …", failed: false, refusedAt: null, doubt: "",
        inList: action.do === "take_back" && !how.redoes });
      requests.keep({ station: this.station, session: this.session });
      this.lastAsked = [action, how];
      this.$emit("edit", { ...action, session: this.session, revision: this.revision, author: this.author.trim() });
    },
    askName(action, how = {}) { // of who corrects, at the first correction; then it is made
      Object.assign(this, { asked: action, askedHow: how, draft: this.author });
      this.opener = document.activeElement.closest(".correct-menu") ? this.menuOpener : document.activeElement;
      this.$nextTick(() => this.$refs.author.focus());
    },
    askAgain() { // for another name
      const name = this.author;
      storeAuthor("");
      this.askName(...this.lastAsked);
      this.draft = name;
    },
    leaveName() {
      this.asked = null;
      this.returnFocus();
    },
    returnFocus() { // to what has opened a menu or a form: a button, or else the plots
      this.$nextTick(() => giveBack(this.opener, this.$refs.plots));
    },
    name() {
      const action = this.asked;
      if (!this.draft.trim()) return;
      Object.assign(this, { author: this.draft.trim(), asked: null });
      if (action.do) this.edit(action, this.askedHow);
      this.returnFocus();
    },
    rename() {
      this.menu = null;
      this.askName({});
      this.opener = this.menuOpener;
    },
    openMenu(x = null, y = BAND_HEIGHT) {
      if (!this.editable || this.session === "") return;
      this.menuOpener = x === null ? document.activeElement : this.$refs.plots; // a finger has given it no focus
      this.cursor ??= this.within((this.view()[0] + this.shownEnd) / 2);
      this.reveal(this.cursor);
      this.menu = { x: x ?? this.scale().x(this.cursor), y, ...this.spaceOfMenu() };
    },
    spaceOfMenu() { // [px] up to where it may reach, and the segments of which a correction is previewed
      const { left, width } = this.$refs.plots.getBoundingClientRect(), scale = this.scale();
      const room = document.documentElement.clientWidth - left;
      const isAtPoint = this.selected !== null && Math.abs(this.selected - this.cursor) < ROUNDED;
      const rows = [this.segmentAtCursor, isAtPoint && rowAt(this.segments, this.cursor - 2 * ROUNDED)].filter(Boolean);
      const inPlot = (t) => Math.min(Math.max(scale.x(t), scale.x0), scale.x1);
      const kept = rows.length ? [inPlot(rows.at(-1)[0]), inPlot(rows[0][1])] : null;
      return { width, room, kept };
    },
    leaveMenu() {
      this.menu = null;
      this.preview(null);
    },
    closeMenu() {
      this.leaveMenu();
      this.opener = this.menuOpener;
      this.returnFocus();
    },
    chosenInMenu(action) {
      this.closeMenu();
      this.edit(action);
    },
    insert() {
      if (this.cursor !== null) this.edit({ do: "insert", t: this.cursor });
    },
    remove() {
      if (this.selected === null) return this.stateWhyNot(UNSELECTED);
      this.edit({ do: "remove", t: this.selected });
    },
    move() {
      if (this.selected === null) return this.stateWhyNot(UNSELECTED);
      if (this.cursor !== null) this.edit({ do: "move", t: this.selected, to: this.cursor });
    },
  },
};
