// Editing an app at its card: its values, its place, a duplicate, another app after it. One form, one edit, one undo.
//
// `base` has the values that the form was filled from. What arrives meanwhile replaces what was not typed into. An edit
// says what it was typed over, so that it does not overwrite what another operator has set there.
import Conflict from "caesura-dashboard/conflict.js";
import NewApp from "caesura-dashboard/new_app.js";
import { unsaved } from "caesura-dashboard/unsaved.js";

const MM = 1000;
const FIELDS = {
  speed: { label: "Speed [%]", scale: 100, step: 5, min: 10, max: 200, rounded: 0.5 },
  force_n: { label: "Force [N]", scale: 1, step: 0.5, min: 0, rounded: 0.005 },
  tolerance_m: { label: "Tolerance [mm]", scale: MM, step: 0.5, min: 0.1, rounded: 0.005 },
  gripper_width: { label: "Gripper width [mm]", scale: MM, step: 1, min: 0, rounded: 0.05 },
};
const TEXTS = ["name", "note", "target_name"], AXES = [0, 1, 2], TARGET_ROUNDED = 0.05;
// The same, but for what is rounded on the way.
const alike = (one, other, rounded) => one === other || (typeof one === "number" && typeof other === "number" && Math.abs(one - other) <= 1.01 * rounded);

export default {
  mixins: [unsaved],
  components: { Conflict, NewApp },
  props: { app: Object, sessions: Array, kinds: Array, busy: Boolean },
  inject: ["appsShown", "keyOf", "typed", "lost", "cameBack"],
  emits: ["edit"],
  data: () => ({ open: false, draft: null, base: null, sent: {}, conflict: null, last: 0, session: "" }),
  template: `
    <details class="app-edit" :open="open" @toggle="toggled($event.target.open)">
      <summary :aria-label="'Edit app ' + app.number">Edit</summary>
      <form v-if="open && draft" @submit.prevent="save">
        <label>Name <input class="app-name" v-model="draft.name" maxlength="10000" autocomplete="off"></label>
        <label>Note <input class="app-note" v-model="draft.note" maxlength="10000" autocomplete="off"></label>
        <fieldset v-if="draft.target"><legend>Target [mm]</legend>
          <input v-for="(axis, i) in ['x', 'y', 'z']" :key="axis" :aria-label="'Target ' + axis + ' in mm'" type="number" step="0.1"
            v-model.number="draft.target[i]" required></fieldset>
        <label v-if="app.target">Name of the position <input class="app-target_name" v-model="draft.target_name" maxlength="10000" autocomplete="off"></label>
        <label v-for="[name, field] in numbers" :key="name">{{ field.label }}
          <input :class="'app-' + name" type="number" step="any" :min="field.min" :max="field.max" v-model.number="draft[name]" @change="refill(name)"></label>
        <div class="row"><button class="save" :aria-disabled="Boolean(busy || !changed)">Save</button>
          <button type="button" class="as-taught" :aria-disabled="Boolean(busy || !app.set.length)" @click="asTaught">As taught</button></div>
        <conflict v-if="conflict" :words="conflict.words" :busy="busy" @anyway="saveAnyway" @new-value="takeNew"></conflict>
      </form>
      <div v-if="open" class="row" role="group" :aria-label="'Place of app ' + app.number">
        <button class="repeats" :aria-disabled="Boolean(busy || !app.earlier)" :aria-label="'Run app ' + app.number + ' earlier'" @click="move(app.earlier)">◀</button>
        <button class="repeats" :aria-disabled="Boolean(busy || !app.later)" :aria-label="'Run app ' + app.number + ' later'" @click="move(app.later)">▶</button>
        <button class="duplicate" :aria-disabled="busy" :aria-label="'Duplicate app ' + app.number" @click="say({ do: 'duplicate', app: app.reference })">Duplicate</button>
        <button class="delete" :aria-disabled="busy" :aria-label="'Delete app ' + app.number" @click="say({ do: 'delete', app: app.reference })">Delete</button>
      </div>
      <new-app v-if="open" :previous="app" :near="app" :kinds="kinds" :busy="busy" @edit="say"></new-app>
      <fieldset v-if="open" class="again"><legend>Teach again</legend>
        <p v-if="!sessions.length">Teach the part in a session of its own at this station. Then it can be chosen here.</p>
        <template v-else>
          <label>To app <select class="part-last" v-model.number="last">
            <option v-for="one in following" :key="one.number" :value="one.number">{{ one.number }} · {{ one.name || one.title }}</option></select></label>
          <label>Replace by session <select class="part-session" v-model="session"><option value="">choose</option>
            <option v-for="[name, words] in sessions" :key="name" :value="name">{{ words }}</option></select></label>
          <button class="replace-part" :aria-disabled="Boolean(busy || !session || !lastApp)" :aria-label="'Replace app ' + app.number + ' to ' + last"
            @click="replace">Replace</button>
        </template></fieldset>
    </details>`,
  computed: {
    numbers() {
      return Object.entries(FIELDS).filter(([name]) => name in this.app.values);
    },
    following() {
      return this.appsShown().filter(({ number }) => number >= this.app.number);
    },
    lastApp() {
      return this.following.find(({ number }) => number === this.last);
    },
    changed() {
      return Object.keys(this.changes()).length > 0;
    },
  },
  methods: {
    isUnsaved() {
      return this.open && this.draft !== null && this.changed;
    },
    toggled(open) {
      if (open && this.open) return; // it was opened with what is in `typed`
      this.open = open;
      if (open) Object.assign(this, { draft: this.start(this.app), base: this.start(this.app), sent: {}, conflict: null, last: this.app.number, session: "" });
      if (open) this.$nextTick(() => this.$el.scrollIntoView({ block: "nearest", inline: "nearest" }));
      else this.$nextTick(() => this.$el.parentElement.scrollIntoView({ block: "nearest", inline: "nearest" })); // others may be shown again
    },
    start({ name, note, target_name, values }) {
      return { name, note, target_name, ...values, target: values.target && [...values.target] };
    },
    changes() { // what was typed, in the units of the wire
      const { draft, base, app } = this, found = {}, cleared = [];
      for (const name of TEXTS) {
        const text = draft[name].trim();
        if (text && text !== base[name]) found[name] = text;
        if (!text && base[name]) cleared.push(name);
      }
      const moved = (i) => draft.target[i] !== base.target[i];
      if (draft.target && AXES.some(moved)) found.target = AXES.map((i) => (moved(i) ? draft.target[i] / MM : app.target[i]));
      for (const [name, { scale }] of this.numbers) {
        if (this.isCleared(name)) cleared.push(name);
        else if (draft[name] !== base[name] && draft[name] !== "" && draft[name] !== null) found[name] = draft[name] / scale;
      }
      return cleared.length ? { ...found, as_taught: cleared } : found;
    },
    isCleared(name) { // a number that an operator has set
      return this.draft[name] === "" && this.app.set.includes(name);
    },
    refill(name) { // it is as taught already
      if (this.draft[name] === "" && !this.isCleared(name)) this.draft[name] = this.base[name];
    },
    save() {
      const { draft, base } = this, { as_taught = [], ...found } = this.changes();
      const names = [...Object.keys(found), ...as_taught];
      const seen = Object.fromEntries(names.map((name) => [name, base[name] ?? null]));
      if (seen.target) seen.target = AXES.map((i) => (draft.target[i] === base.target[i] ? null : base.target[i]));
      this.sent = Object.fromEntries(names.map((name) => [name, name === "target" ? [...draft.target] : draft[name]]));
      this.say({ do: "change", app: this.app.reference, ...this.changes() }, seen, this.answered);
    },
    answered(words, failed, found) {
      if (failed) this.sent = {};
      this.conflict = found ? { words, found } : null;
    },
    saveAnyway() {
      this.meet(this.base);
      this.save();
    },
    takeNew() {
      this.meet(this.base);
      this.meet(this.draft);
      this.conflict = null;
    },
    meet(values) { // what another operator has set takes their place
      const { target, ...found } = this.conflict.found;
      Object.assign(values, found);
      if (target) values.target = AXES.map((i) => target[i] ?? values.target[i]);
    },
    learn(draft, base, name, now, sent, rounded) { // of one field, or one coordinate of the target
      if (draft[name] === base[name] || alike(draft[name], now, rounded)) draft[name] = base[name] = now;
      else if (sent === "" && draft[name] === "") draft[name] = base[name] = now; // cleared: as taught
      else if (alike(sent, now, rounded)) base[name] = now; // saved here, and typed on since
    },
    asTaught() {
      this.say({ do: "change", app: this.app.reference, as_taught: this.app.set });
    },
    move({ after }) {
      this.say({ do: "move", app: this.app.reference, after });
    },
    replace() {
      this.say({ do: "replace_part", first: this.app.reference, last: this.lastApp.reference, session: this.session });
    },
    say(action, seen = null, answered = null) {
      this.$emit("edit", action, seen, answered);
    },
  },
  mounted() {
    const key = this.keyOf(this.app), typed = this.typed.get(key);
    if (!typed) return;
    this.typed.delete(key);
    Object.assign(this, typed, { open: true, last: this.app.number });
    this.cameBack(this.app);
  },
  beforeUnmount() { // another operator has deleted the app, or corrected what it was inferred from
    if (!this.isUnsaved()) return;
    this.typed.set(this.keyOf(this.app), { draft: this.draft, base: this.base });
    this.lost(this.app);
  },
  watch: {
    app(app) {
      if (!this.draft) return;
      const { draft, base, sent } = this, { target, ...now } = this.start(app);
      for (const [name, value] of Object.entries(now)) this.learn(draft, base, name, value, sent[name], FIELDS[name] ? FIELDS[name].rounded : 0);
      if (target && draft.target) AXES.forEach((i) => this.learn(draft.target, base.target, i, target[i], sent.target && sent.target[i], TARGET_ROUNDED));
      else Object.assign(draft, { target }), Object.assign(base, { target: target && [...target] });
      for (const name of Object.keys(sent)) if (JSON.stringify(draft[name]) === JSON.stringify(base[name])) delete sent[name];
    },
  },
};
