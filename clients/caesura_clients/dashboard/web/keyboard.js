// What the keys do in the plot. Everything that a pointer can do, and nothing that the browser uses itself.
export const keyboard = {
  methods: {
    key(event) {
      const command = event.ctrlKey || event.metaKey;
      const pressed = event.key.length === 1 ? event.key.toLowerCase() : event.key; // M is also m, as with Caps Lock
      const name = command ? `ctrl+${event.shiftKey ? "shift+" : ""}${pressed}` : pressed;
      const step = event.shiftKey ? 1 : 0.1;
      const actions = {
        ArrowLeft: () => this.step(-step),
        ArrowRight: () => this.step(step),
        Home: () => this.jump(this.begin),
        End: () => this.jump(this.newest),
        PageUp: () => this.hop(-1),
        PageDown: () => this.hop(1),
        Enter: () => this.insert(),
        Insert: () => this.insert(),
        Delete: () => this.remove(),
        m: () => this.move(),
        r: () => this.openMenu(),
        ContextMenu: () => this.openMenu(),
        l: () => this.follow(),
        "+": () => this.zoom(0.5),
        "=": () => this.zoom(0.5),
        "-": () => this.zoom(2),
        0: () => this.all(),
        ",": () => this.pan(-0.5),
        ".": () => this.pan(0.5),
        Escape: () => {
          Object.assign(this, { selected: null, ghost: null, marked: null, drag: null });
          this.preview(null);
        },
        "ctrl+z": () => this.undo(),
        "ctrl+y": () => this.redo(),
        "ctrl+shift+z": () => this.redo(),
      };
      if (!(name in actions)) return;
      event.preventDefault();
      actions[name]();
    },
    step(by) {
      this.goto((this.cursor ?? this.shownEnd) + by);
    },
    goto(t) {
      this.cursor = this.within(t);
      this.reveal(this.cursor);
    },
    jump(t) { // what is selected and out of view then would be removed unseen
      this.goto(t);
      const [from, to] = this.view();
      if (this.selected !== null && (this.selected < from || this.selected > to)) this.selected = null;
    },
    hop(by) {
      const times = this.changepoints.map(([t]) => t);
      const from = this.selected ?? this.cursor ?? this.shownEnd;
      const found = by > 0 ? times.find((t) => t > from) : times.filter((t) => t < from).pop();
      if (found === undefined) return;
      this.selected = this.cursor = found;
      this.reveal(found);
    },
    reveal(t) {
      const [from, to] = this.view();
      if (t < from || t > to) this.show(t - this.span / 2, t + this.span / 2);
    },
  },
};
