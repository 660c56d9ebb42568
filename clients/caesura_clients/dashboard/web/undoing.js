// What Undo and Redo of this page do. Undo takes back what the operator did here last: where that was to take an older
// correction back, the correction is put back. The service's undo always takes the newest correction back.
//
// `past` and `future` have the acts of this page that lead to what is shown, and those that were undone. An act is the
// number of the correction that it took back, null for any other; `at` is the revision from which undoing it is the next
// step. Where another page was first the revisions differ, and the service's own order counts.
const next = (acts, revision) => {
  const last = acts[acts.length - 1];
  return last && last.at === revision ? last.number : null;
};
const held = (acts, revision) => (acts.length && acts[acts.length - 1].at === revision ? acts : []);
const moved = (acts, at) => acts.map((one, i) => (i === acts.length - 1 ? { ...one, at } : one));

export const undoing = {
  data: () => ({ past: [], future: [], act: null }),
  computed: {
    toPutBack() { // the number of the correction that Undo puts back; null: it takes the newest one back
      return next(this.past, this.revision);
    },
    toTakeBack() { // the number of the correction that Redo takes back once more
      return next(this.future, this.revision);
    },
    canUndo() {
      return this.undoable || this.toPutBack !== null;
    },
    canRedo() { // nothing was undone where the last act was to take a correction back
      return this.toTakeBack !== null || (this.redoable && this.toPutBack === null);
    },
    undoAction() {
      return this.toPutBack === null ? { do: "undo" } : { do: "redo" };
    },
    redoAction() {
      return this.toTakeBack === null ? { do: "redo" } : { do: "take_back", number: this.toTakeBack };
    },
    undoTitle() {
      return this.toPutBack === null ? "Undo the last correction (Ctrl Z)" : `Restore correction ${this.toPutBack} (Ctrl Z)`;
    },
  },
  methods: {
    undo() {
      if (!this.canUndo) return this.stateWhyNot("There is nothing to undo.");
      this.edit(this.undoAction, { undoes: true, number: this.toPutBack });
    },
    redo() {
      if (!this.canRedo) return this.stateWhyNot("There is nothing to redo.");
      this.edit(this.redoAction, { redoes: true, number: this.toTakeBack });
    },
    stateWhyNot(message, failed = false) { // of the last act nothing stays on the page: it would be the answer to this key
      if (!this.editable || this.session === "" || this.busy) return;
      Object.assign(this, { message, failed, refusedAt: null, doubt: "", inList: false });
    },
    acted() { // the service has made it: one revision more than was seen
      const { undoes, redoes, number, seen } = this.act, at = seen + 1;
      this.made = this.revision = Math.max(this.revision, at);
      const past = held(this.past, seen), future = held(this.future, seen);
      if (undoes) {
        this.past = moved(past.slice(0, -1), at);
        this.future = [...future, { number, at }];
      } else if (redoes) {
        this.past = [...past, { number, at }];
        this.future = moved(future.slice(0, -1), at);
      } else {
        this.past = number === null ? [{ number, at }] : [...past, { number, at }]; // a new one ends what could be put back
        this.future = [];
      }
    },
    wordsOf(message) { // where an undo is one for the operator alone: the service has restored a correction
      return this.act && this.act.undoes && this.act.number !== null
        ? message.replace(/^Done again/, `Correction ${this.act.number} counts again`) : message;
    },
    forgetActs() {
      Object.assign(this, { past: [], future: [], act: null });
    },
  },
};
