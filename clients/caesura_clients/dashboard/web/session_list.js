// Every session that the service holds: searched, filtered and sorted in the browser.
import { storedAuthor } from "caesura-dashboard/author.js";
import { changes } from "caesura-dashboard/clicks.js";
import { live } from "caesura-dashboard/live.js";
import { dayAndTime } from "caesura-dashboard/numbers.js";
import Staying from "caesura-dashboard/staying.js";

const ARRIVES_MS = 5000; // by then the list of the service has what was changed here

const COLUMNS = [
  ["task", "name"], ["success", "success"], ["opened", "taught"], ["station", "station"], ["operator", "operator"], ["tags", "tags"],
  ["length", "length"], ["segments", "segments"], ["apps", "apps"], ["gaps", "gaps"],
  ["version", "program"], ["edited", "changed"], ["instance", "instance"],
];
const MOST = 50; // sessions of a dataset
const named = (one) => one.task || one.session; // as the column of names has it
const BRIEF = 40; // letters of a name in a message, which would cover the list
const brief = (name) => (Array.from(name).length > BRIEF ? `${Array.from(name).slice(0, BRIEF - 1).join("")}…` : name);
const RESULTS = { true: "yes", false: "no", null: "–" };
const KEPT = "caesura-session-list", FILTERS = ["words", "station", "success", "deleted", "by", "falling"]; // for who comes back to the list
const order = (a, b) => (typeof a === "number" && typeof b === "number" ? a - b : String(a).localeCompare(String(b)));

export default {
  mixins: [live],
  components: { Staying },
  props: { editable: Boolean },
  emits: ["older", "ask"],
  data: () => ({
    changed: null, isDeleting: false, outcome: "", refused: false, made: {},
    asking: false, message: "", failed: false,
    warning: "", answers: true, damaged: [], sessions: null, words: "", chosen: [], station: "", success: "", deleted: false, by: "opened", falling: true, columns: COLUMNS, most: MOST,
  }),
  created() {
    const [{ type } = {}] = performance.getEntriesByType("navigation");
    if (type !== "navigate") Object.assign(this, JSON.parse(sessionStorage.getItem(KEPT)));
    this.$watch(this.filters, (now) => sessionStorage.setItem(KEPT, JSON.stringify(now)), { immediate: true });
  },
  template: `
    <div>
      <div role="alert"><p v-if="warning" class="banner">{{ warning }}</p></div>
      <div class="filters" role="search">
        <label class="wide">Search <input class="words" type="search" v-model="words" placeholder="name, tag, note, operator" autocomplete="off"></label>
        <label>Station <select class="by-station" v-model="station"><option value="">all</option>
          <option v-for="one in stations" :key="one" :value="one">{{ one }}</option></select></label>
        <label>Success <select class="by-success" v-model="success"><option value="">all</option><option value="true">yes</option>
          <option value="false">no</option><option value="null">not stated</option></select></label>
        <label class="check"><input class="with-deleted" type="checkbox" v-model="deleted"> deleted ones too</label>
      </div>
      <div class="list-said"><p class="summary" role="status">{{ summary }}</p>
        <staying v-if="editable" class="saved" :class="{ failed: refused }">{{ outcome }}
          <button v-if="changed && !isDeleting && !refused" ref="undo" class="take-back" @click="undo">Undo</button></staying></div>
      <p class="compare"><a v-if="chosen.length === 2" class="button" :href="'/compare?first=' + chosen[0] + '&second=' + chosen[1]">Compare these two</a>
        <span v-else class="help">Choose two sessions to compare them.</span>
        <a v-if="closed.length && closed.length <= most" class="dataset" :href="dataset">LeRobot dataset of {{ closed.length === 1 ? "this session" : "these " + closed.length }}</a></p>
      <div v-if="found.length" class="scroll" tabindex="0" role="region" aria-label="All sessions">
        <table class="sessions"><thead><tr><th scope="col">compare</th><th v-for="[key, title] in columns" :key="key" scope="col" :class="'is-' + key" :aria-sort="sorted(key)">
          <button class="sort" @click="sort(key)">{{ title }}<span aria-hidden="true">{{ by === key ? (falling ? " ▾" : " ▴") : "" }}</span></button></th>
          <th v-if="editable" scope="col" class="is-delete">delete</th></tr></thead>
        <tbody><tr v-for="one in found" :key="one.station + '/' + one.session" :class="{ deleted: one.deleted }">
          <td class="is-chosen"><input type="checkbox" class="choose" :checked="chosen.includes(nameOf(one))" @change="choose(nameOf(one))"
            :aria-label="'compare ' + called(one)"></td>
          <td v-for="[key, title] in columns" :key="key" :data-title="title" :class="['is-' + key, { alarm: key === 'gaps' && one.gaps > 0 }]">
            <a v-if="key === 'task'" :href="one.href" :title="'session ' + one.session">{{ named(one) }}</a>
            <template v-else>{{ shown(key, one) }}</template></td>
          <td v-if="editable" class="is-delete"><button v-if="one.held" class="delete" :aria-disabled="isDeleting" :aria-label="(one.deleted ? 'Restore ' : 'Delete ') + called(one)"
            @click="ask(one, !one.deleted)">{{ one.deleted ? "Restore" : "Delete" }}</button></td>
        </tr></tbody></table>
      </div>
      <p v-else-if="sessions" class="empty">{{ sessions.length ? "No session is like that." : !answers ? "The service does not answer: which sessions it has is not known." : "No session is known." }}</p>
      <section v-if="damaged.length" class="damaged-sessions" role="status"><h2>Sessions whose results cannot be shown</h2>
        <ul><li v-for="line in damaged" :key="line">{{ line }}</li></ul></section>
      <p class="older-line"><button class="older" :aria-disabled="asking" @click="older">Older sessions</button>
        <span role="status" :class="{ alarm: failed }">{{ message }}</span></p>
    </div>`,
  computed: {
    known() { // with what was changed here and is not in the service's list yet
      return (this.sessions || []).map((one) => (this.nameOf(one) in this.made ? { ...one, deleted: this.made[this.nameOf(one)] } : one));
    },
    stations() {
      return [...new Set((this.sessions || []).map((one) => one.station))].sort();
    },
    found() {
      const words = this.words.toLowerCase().split(/\s+/).filter(Boolean);
      const rows = this.known.filter((one) => {
        const text = [one.task, one.operator, one.note, one.station, one.session, ...one.tags].join(" ").toLowerCase();
        return (this.deleted || !one.deleted) && (!this.station || one.station === this.station) &&
          (!this.success || String(one.success) === this.success) && words.every((word) => text.includes(word));
      });
      const sign = this.falling ? -1 : 1;
      const key = (one) => (this.by === "task" ? named(one) : one[this.by] ?? "");
      return rows.sort((a, b) => sign * order(key(a), key(b)));
    },
    closed() {
      return this.found.filter((one) => one.closed);
    },
    dataset() {
      return "/datasets?" + this.closed.map((one) => "session=" + this.nameOf(one)).join("&");
    },
    summary() {
      if (!this.answers && !this.known.length) return "";
      const all = this.known.filter((one) => this.deleted || !one.deleted).length;
      const count = `${all} session${all === 1 ? "" : "s"}`;
      return this.found.length === all ? count : `${this.found.length} of ${count}`;
    },
  },
  methods: {
    filters() {
      return Object.fromEntries(FILTERS.map((name) => [name, this[name]]));
    },
    older() {
      Object.assign(this, { asking: true, message: "", failed: false });
      this.$emit("older", this.station);
    },
    answered(message, failed) {
      Object.assign(this, { message, failed, asking: false });
    },
    ask(one, deleted) {
      const { station, session, task, operator, note, tags, success } = one;
      const before = { task: task || null, operator: operator || null, note: note || null, tags, success, deleted: !deleted };
      changes();
      Object.assign(this, { isDeleting: true, changed: { name: this.nameOf(one), words: brief(named(one)), deleted }, outcome: deleted ? "Deleting …" : "Restoring …", refused: false });
      const author = storedAuthor();
      this.$emit("ask", { station, request: { type: "describe", author, session, before, description: { ...before, deleted } } });
    },
    undo() {
      const one = this.known.find((row) => this.nameOf(row) === this.changed.name);
      if (one) this.ask(one, !this.changed.deleted);
      else Object.assign(this, { outcome: `${this.changed.words} is no longer in the list, and was not changed.`, refused: true });
    },
    described(message, failed) {
      const { name, words, deleted } = this.changed;
      Object.assign(this, { isDeleting: false, refused: failed });
      this.outcome = failed ? message : deleted ? `${words} is deleted.` : `${words} is restored.`;
      if (failed) return;
      this.made = { ...this.made, [name]: deleted };
      setTimeout(() => this.forget(name), ARRIVES_MS);
      this.$nextTick(() => document.activeElement === document.body && this.$refs.undo?.focus({ preventScroll: true })); // the button went with its row
    },
    forget(name) {
      const { [name]: _, ...others } = this.made;
      this.made = others;
    },
    named,
    called(one) { // where another one has this name too, also its time
      const isAlone = this.found.every((other) => other === one || named(other) !== named(one));
      return isAlone || !one.opened ? named(one) : `${named(one)}, ${dayAndTime(one.opened)}`;
    },
    nameOf: (one) => `${one.station}/${one.session}`,
    choose(name) { // a third takes the place of the first
      this.chosen = this.chosen.includes(name) ? this.chosen.filter((one) => one !== name) : [...this.chosen, name].slice(-2);
    },
    apply(payload) {
      Object.assign(this, { warning: payload.warning, answers: payload.answers });
      this.damaged = payload.damaged;
      this.sessions = Object.freeze(payload.sessions);
    },
    sort(key) {
      if (this.by === key) this.falling = !this.falling;
      else Object.assign(this, { by: key, falling: key === "opened" || key === "edited" });
    },
    sorted(key) {
      return this.by === key ? (this.falling ? "descending" : "ascending") : "none";
    },
    shown(key, one) {
      if (key === "opened") return one.opened ? dayAndTime(one.opened) : "–";
      if (key === "edited") return [one.author, one.edited && dayAndTime(one.edited)].filter(Boolean).join(", ") || "–";
      if (key === "success") return RESULTS[one.success];
      if (key === "tags") return one.tags.join(", ") || "–";
      if (key === "length") return `${one.length.toFixed(1)} s${one.closed ? "" : one.leftOpen ? ", not ended" : ", going on"}`;
      if (key === "version") return `version ${one.version}`;
      return one[key] || (typeof one[key] === "number" ? one[key] : "–");
    },
  },
};
