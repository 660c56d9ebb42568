// What a pointer does in the plots: a press sets the time or takes a changepoint along; a drag elsewhere marks the range
// to zoom to, with shift or a finger it moves the view; two fingers zoom.
const MOVED = 4; // pixels, from which on a press is a drag
const ROOM = 30;

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
      event.currentTarget.setPointerCapture(event.pointerId);
      if (this.fingers.size === 2) return Object.assign(this, { drag: "pinch", ghost: null, marked: null });
      const times = this.changepoints.map(([t]) => t), found = scale.near(x, times, event.pointerType);
      this.selected = found < 0 ? null : this.changepoints[found][0];
      this.cursor = this.selected ?? this.within(scale.t(x));
      this.pressedAt = x;
      const takes = this.selected !== null && this.editable && this.room(times, found, scale) > ROOM;
      this.drag = takes ? "changepoint" : event.shiftKey || event.pointerType === "touch" ? "pan" : "mark";
    },
    dragged(event) {
      if (!this.drag || !this.fingers.has(event.pointerId)) return;
      const x = this.offset(event), before = this.fingers.get(event.pointerId);
      if (this.drag === "pinch") return this.pinched(event.pointerId, x);
      if (Math.abs(x - this.pressedAt) < MOVED && this.ghost === null && this.marked === null && !this.panned) return;
      const scale = this.scale();
      if (this.drag === "changepoint") this.ghost = this.within(scale.t(x));
      if (this.drag === "mark") this.marked = [Math.min(x, this.pressedAt), Math.max(x, this.pressedAt)].map((at) => Math.min(Math.max(at, scale.x0), scale.x1));
      if (this.drag === "pan") {
        this.fingers.set(event.pointerId, x);
        this.panned = true;
        this.pan((before - x) / (scale.x1 - scale.x0));
      }
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
      this.fingers.delete(event.pointerId);
      const { drag, ghost, marked } = this, scale = this.scale();
      if (this.fingers.size === 0) Object.assign(this, { drag: null, ghost: null, marked: null, panned: false });
      if (event.type === "pointercancel") return;
      if (drag === "changepoint" && ghost !== null) {
        this.cursor = ghost;
        this.move();
      }
      if (drag === "mark" && marked) this.show(...marked.map((x) => scale.t(x)));
    },
  },
};
