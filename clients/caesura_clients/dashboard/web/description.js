// What people state about a session. Each field is stored when it is left; the last change can be undone.
//
// `filled` has the texts that the fields were filled with: a change says what it was typed over, so that it
// does not overwrite what another operator has stated in the same field meanwhile.
import { storedAuthor } from "caesura-dashboard/author.js";
import { changes as counted } from "caesura-dashboard/clicks.js";
import Conflict from "caesura-dashboard/conflict.js";
import { live } from "caesura-dashboard/live.js";
import { dayAndTime } from "caesura-dashboard/numbers.js";
import Staying from "caesura-dashboard/staying.js";
import { unanswered } from "caesura-dashboard/unanswered.js";
import { unsaved } from "caesura-dashboard/unsaved.js";

const requests = unanswered("description");
const UNANSWERED = "Not saved: this page was left or loaded again before that.";
const NARROW = matchMedia("(max-width: 40rem)");
const OPEN = "caesura-description"; // of the page of a station, as it was left
const empty = () => ({ task: null, operator: null, note: null, tags: [], success: null, deleted: false });
const asTags = (text) => [...new Set(text.split(",").map((one) => one.trim()).filter(Boolean))];
const asLine = (text) => text.trim() || null;
const READ = { task: asLine, operator: asLine, note: asLine, tags: asTags }; // what is typed, as it is stored
const FIELDS = Object.keys(READ);
const asText = (value) => (Array.isArray(value) ? value.join(", ") : value || "");
const pick = (values, names) => Object.fromEntries(Object.keys(names).map((name) => [name, values[name]]));
const isSame = (one, other) => JSON.stringify(one) === JSON.stringify(other);
const unfilled = () => ({ task: "", operator: "", note: "", tags: "" });

export default {
  mixins: [live, unsaved],
  components: { Conflict, Staying },
  props: { editable: Boolean, live: Boolean },
  emits: ["ask"],
  data: () => ({
    session: "", opened: null, closed: true, tasks: [], stored: empty(), known: empty(), draft: unfilled(), filled: unfilled(),
    last: null, refused: null, asked: [], message: "", failed: false, open: false,
  }),
  template: `
    <details v-if="session" class="description" :open="open" @toggle="toggled($event.target.open)">
      <summary><strong>{{ title }}</strong> {{ stated }}</summary>
      <div v-if="editable" class="fields">
        <label class="is-task">Task <input class="name-task" v-model="draft.task" maxlength="10000" list="known-tasks" placeholder="unnamed"
          @change="saveTyped('task')" autocomplete="off"></label>
        <datalist id="known-tasks"><option v-for="one in tasks" :key="one" :value="one"></option></datalist>
        <label>Operator <input class="name-operator" v-model="draft.operator" maxlength="10000" @change="saveTyped('operator')"></label>
        <label>Tags <input class="name-tags" v-model="draft.tags" maxlength="10000" placeholder="left, new" @change="saveTyped('tags')" autocomplete="off"></label>
        <label class="wide">Note <input class="name-note" v-model="draft.note" maxlength="10000" @change="saveTyped('note')"></label>
        <span class="outcome" role="group" aria-label="Did it succeed?"><span>Success</span>
          <button class="yes" :aria-pressed="String(known.success === true)" @click="judge(true)">Yes</button>
          <button class="no" :aria-pressed="String(known.success === false)" @click="judge(false)">No</button></span>
        <button class="delete" @click="save({ deleted: !known.deleted })">{{ known.deleted ? "Restore" : "Delete" }}</button>
      </div>
      <staying class="saved" :class="{ failed }" :lines="editable ? 1 : 0"><template v-if="!refused && (said || known.deleted)">{{ said || gone }}
        <button v-if="last && !failed && !isOverridden" class="take-back" :aria-disabled="isAsking()" @click="undo">Undo</button></template></staying>
      <conflict v-if="editable && refused" :words="message" :is-met="refused.found !== null" :busy="asked.length > 0"
        @anyway="saveAnyway" @new-value="takeNew"></conflict>
    </details>`,
  mounted() {
    window.addEventListener("pagehide", this.keepTyped);
  },
  unmounted() {
    window.removeEventListener("pagehide", this.keepTyped);
  },
  computed: {
    title() {
      return this.live && this.closed ? "Last demonstration" : "This demonstration";
    },
    isOverridden() { // what was deleted here, another operator has restored, or the other way round
      return this.last !== null && "deleted" in this.last.changes && !this.isAsking() && this.last.changes.deleted !== this.known.deleted;
    },
    said() {
      return this.isOverridden && !this.failed ? "" : this.message;
    },
    gone: () => "Deleted: lists leave it out; its samples stay until the journal's limits remove them.",
    stated() {
      const { task, operator, note, tags, success } = this.known;
      const result = success === null ? "" : success ? "succeeded" : "failed";
      const when = this.opened ? dayAndTime(this.opened) : "";
      const gone = this.known.deleted ? "deleted" : "", named = [task || "unnamed", operator, result, tags.join(", "), note];
      // Of a long line the end is cut: in an open form the fields state what is named.
      return (this.open ? [when, gone, ...named] : [...named, when, gone]).filter(Boolean).join(" · ");
    },
  },
  methods: {
    toggled(open) {
      if (this.live && open !== this.open) localStorage.setItem(OPEN, open ? "yes" : "no");
      this.open = open;
    },
    apply(payload) {
      const isOther = payload.session !== this.session;
      if (isOther) this.leave();
      // Opened at a start or an end it would move the plots. It is folded until it is opened, so that they begin high.
      if (this.live && !this.session && payload.session) this.open = localStorage.getItem(OPEN) === "yes" && !NARROW.matches;
      Object.assign(this, { session: payload.session, opened: payload.opened, closed: payload.closed, tasks: payload.tasks, stored: payload.description });
      if (isOther) for (const name of FIELDS) this.fill(name, payload.description);
      if (!this.isAsking()) this.learn(payload.description);
      if (isOther && this.editable) this.recall();
    },
    keepTyped() { // for this page when it is opened again: what was not asked for, or was refused
      const typed = FIELDS.filter((name) => this.draft[name] !== this.filled[name]);
      if (!this.editable || !typed.length) return;
      const read = (texts) => Object.fromEntries(typed.map((name) => [name, READ[name](texts[name])]));
      const mine = this.asked.filter((one) => one.session === this.session);
      requests.keep([...mine, { session: this.session, changes: read(this.draft), before: read(this.filled), rest: this.known }]);
    },
    recall() { // changes that were not stored before the page was left, as by a lost connection
      const asked = requests.recall(([{ session }]) => session === this.session);
      if (asked === null) return;
      const changes = Object.assign({}, ...asked.map((one) => one.changes));
      const before = Object.assign({}, ...asked.map((one) => one.before).reverse()); // the oldest of each field
      if (isSame(pick(this.stored, changes), changes)) return;
      Object.assign(this, { message: UNANSWERED, failed: true, open: true });
      this.refuse(changes, before, null);
    },
    leave() { // another session takes the place of this one, of which something may be typed still
      if (this.editable && this.session && !this.refused) for (const name of FIELDS) this.saveTyped(name);
      Object.assign(this, { last: null, refused: null, message: "", failed: false });
    },
    learn(description) { // what was typed stays, and what it was typed over
      this.known = description;
      for (const name of FIELDS) if (this.draft[name] === this.filled[name]) this.fill(name, description);
    },
    fill(name, description) {
      this.draft[name] = this.filled[name] = asText(description[name]);
    },
    isUnsaved() {
      return this.editable && (this.asked.length > 0 || this.refused !== null || FIELDS.some((name) => this.draft[name] !== this.filled[name]));
    },
    isAsking() {
      return this.asked.some((one) => one.session === this.session);
    },
    saveTyped(name) {
      const value = READ[name](this.draft[name]), over = READ[name](this.filled[name]);
      if (!isSame(value, over)) return this.save({ [name]: value }, { [name]: over });
      this.fill(name, this.known);
      if (this.refused && name in this.refused.changes) Object.assign(this, { refused: null, message: "", failed: false });
    },
    judge(success) {
      this.save({ success: this.known.success === success ? null : success });
    },
    undo() {
      this.save(this.last.before, this.last.changes);
    },
    // before: what the changed fields were, as they were seen. One change at a time is under way.
    save(changes, before = pick(this.known, changes)) {
      counted();
      this.asked.push({ session: this.session, changes, before, rest: this.known });
      Object.assign(this, { message: "Saving …", failed: false, refused: null, known: { ...this.known, ...changes } });
      for (const name of FIELDS) if (name in changes) this.fill(name, changes);
      requests.keep(this.asked.filter((one) => one.session === this.session));
      if (this.asked.length === 1) this.ask();
    },
    ask() {
      const author = storedAuthor(), { session, changes, before, rest } = this.asked[0];
      this.$emit("ask", { type: "describe", author, session, before: { ...rest, ...before }, description: { ...rest, ...changes } });
    },
    answered(message, failed, found = null) { // found: what another operator has set meanwhile
      const { session, changes, before } = this.asked.shift();
      if (this.asked.length) this.ask();
      else requests.forget();
      if (session !== this.session) return;
      if (!failed) Object.assign(this, { stored: { ...this.stored, ...changes }, last: { changes, before } });
      if (!this.isAsking()) this.learn(this.stored);
      if (!failed && this.refused) return; // one before it was not saved: that is what stands there
      Object.assign(this, { message, failed });
      if (failed) this.refuse(changes, before, found);
    },
    refuse(changes, before, found) { // what was typed stays, unless something else is typed there by now
      for (const name of FIELDS) {
        if (!(name in changes) || this.draft[name] !== this.filled[name]) continue;
        this.draft[name] = asText(changes[name]);
        this.filled[name] = asText(before[name]);
      }
      this.refused = { changes, before, found };
    },
    saveAnyway() {
      const { changes, before, found } = this.refused;
      const typed = Object.fromEntries(Object.keys(changes).map((name) => [name, READ[name] ? READ[name](this.draft[name]) : changes[name]]));
      this.save(typed, { ...before, ...found });
    },
    takeNew() {
      for (const name of FIELDS) if (name in this.refused.changes) this.fill(name, this.stored);
      this.learn(this.stored);
      Object.assign(this, { refused: null, message: "", failed: false });
    },
  },
};
