// What a pointer does in the plots: a press sets the time or takes a changepoint along; a drag elsewhere marks the range
// to zoom to, with shift or a finger it moves the view; two fingers zoom. A right click or a long press corrects there.
import { BAND_HEIGHT, namedAt } from "caesura-dashboard/marks.js";

const MOVED = 4; // pixels, from which on a press is a drag
const ROOM = 30;
const GONE = "Not done. The changepoint was moved or removed while you dragged it: look at the current state.";
const LONG_MS = 500; // of a press by a finger that opens the menu

export const pointer = {
  methods: {
    offset(event) {
      const box = this.$refs.plots.getBoundingClientRect();
      return event.clientX - box.left - this.$refs.plots.clientLeft;
    },
    pressed(event) {
      if (event.button > 0) return;
      const x = this.offset(event), scale = this.scale();
      this.fingers.set(event.pointerId, x);
      this.pressLong(event);
      event.currentTarget.setPointerCapture(event.pointerId);
      if (this.fingers.size === 2) return Object.assign(this, { drag: "pinch", ghost: null, marked: null });
      const found = this.changepointAt(x, event.pointerType);
      this.selected = found.t;
      this.cursor = this.selected ?? this.within(scale.t(x));
      this.pressedAt = x;
      this.taken = this.selected;
      this.drag = found.canMove ? "changepoint" : event.shiftKey || event.pointerType === "touch" ? "pan" : "mark";
    },
    changepointAt(x, pointer) { // its time, or null; and whether it can be dragged
      const times = this.changepoints.map(([t]) => t), scale = this.scale(), i = scale.near(x, times, pointer);
      return { t: i < 0 ? null : times[i], canMove: i >= 0 && this.editable && this.room(times, i, scale) > ROOM };
    },
    pressLong(event) {
      clearTimeout(this.long);
      if (event.pointerType !== "touch" || this.fingers.size > 1) return;
      const y = this.height(event);
      this.long = setTimeout(() => {
        Object.assign(this, { drag: null, ghost: null, panned: false });
        this.openMenu(this.pressedAt, y);
      }, LONG_MS);
    },
    lifted(event) { // after a long press, the browser would click what the menu has put under the finger
      if (this.menu) event.preventDefault();
    },
    height(event) {
      return event.clientY - this.$refs.plots.getBoundingClientRect().top;
    },
    pointedAt(event) { // a right click; the menu key opens the menu by itself
      if (!this.editable) return;
      event.preventDefault();
      if (event.pointerType !== "mouse" || this.session === "") return;
      const x = this.offset(event), { t } = this.changepointAt(x, "mouse");
      this.cursor = t ?? this.within(this.scale().t(x));
      this.selected = t ?? this.selected;
      this.openMenu(x, this.height(event));
    },
    dragged(event) {
      const x = this.offset(event), before = this.fingers.get(event.pointerId);
      if (event.pointerType === "mouse") this.pointedInBand = this.drag ? null : this.inBand(x, this.height(event));
      if (event.pointerType === "mouse" && !this.drag) this.canTake = this.changepointAt(x, "mouse").canMove;
      if (!this.drag || before === undefined) return;
      if (this.drag === "pinch") return this.pinched(event.pointerId, x);
      if (Math.abs(x - this.pressedAt) < MOVED && this.ghost === null && this.marked === null && !this.panned) return;
      clearTimeout(this.long);
      const scale = this.scale();
      if (this.drag === "changepoint") {
        this.ghost = this.within(scale.t(x));
        this.preview(this.selected === this.taken ? { do: "move", t: this.selected, to: this.ghost } : null, "tip");
      }
      if (this.drag === "mark") this.marked = [Math.min(x, this.pressedAt), Math.max(x, this.pressedAt)].map((at) => Math.min(Math.max(at, scale.x0), scale.x1));
      if (this.drag === "pan") {
        this.fingers.set(event.pointerId, x);
        this.panned = true;
        this.pan((before - x) / (scale.x1 - scale.x0));
      }
    },
    inBand(x, y) { // where a pointer rests upon a segment or a phase: its name may not have room there
      const found = y < BAND_HEIGHT ? namedAt(this, this.scale().t(x), y - this.$refs.band.offsetTop) : null;
      return found && { ...found, x };
    },
    room(times, i, scale) { // pixels to the nearest other changepoint: those that lie close are selected, not dragged
      return Math.min(...[times[i - 1], times[i + 1]].map((t) => (t === undefined ? Infinity : Math.abs(scale.x(t) - scale.x(times[i])))));
    },
    pinched(id, x) {
      const other = [...this.fingers].find(([one]) => one !== id)[1];
      const before = Math.abs(this.fingers.get(id) - other), now = Math.abs(x - other);
      this.fingers.set(id, x);
      if (before > 8 && now > 8) this.zoom(before / now, this.scale().t((x + other) / 2));
    },
    released(event) {
      clearTimeout(this.long);
      this.fingers.delete(event.pointerId);
      const { drag, ghost, marked } = this, scale = this.scale();
      if (this.fingers.size === 0) Object.assign(this, { drag: null, ghost: null, marked: null, panned: false });
      if (drag === "changepoint") this.preview(null);
      if (event.type === "pointercancel") return;
      if (drag === "changepoint" && ghost !== null) {
        this.cursor = ghost;
        if (this.selected === this.taken) this.move();
        else this.stateWhyNot(GONE, true);
      }
      if (drag === "mark" && marked) this.show(...marked.map((x) => scale.t(x)));
    },
  },
};
