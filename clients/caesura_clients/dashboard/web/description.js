// What people state about a session. Each field is stored when it is left; the last change can be undone.
import { live } from "caesura-dashboard/live.js";
import { dayAndTime } from "caesura-dashboard/numbers.js";

const AUTHOR = "caesura-author";
const empty = () => ({ task: null, operator: null, note: null, tags: [], success: null, deleted: false });
const TEXTS = ["task", "operator", "note"];

export default {
  mixins: [live],
  props: { editable: Boolean, live: Boolean },
  emits: ["ask"],
  data: () => ({
    session: "", opened: null, closed: true, tasks: [], known: empty(), draft: { task: "", operator: "", note: "", tags: "" },
    before: null, asked: [], message: "", failed: false, open: false,
  }),
  template: `
    <details v-if="session" class="description" :open="open" @toggle="open = $event.target.open">
      <summary><strong>{{ title }}</strong> {{ stated }}</summary>
      <div v-if="editable" class="fields">
        <label>Task <input class="name-task" v-model="draft.task" maxlength="120" list="known-tasks" placeholder="unnamed"
          @change="saveText('task')" autocomplete="off"></label>
        <datalist id="known-tasks"><option v-for="one in tasks" :key="one" :value="one"></option></datalist>
        <label>Operator <input class="name-operator" v-model="draft.operator" maxlength="64" @change="saveText('operator')"></label>
        <label>Tags <input class="name-tags" v-model="draft.tags" maxlength="300" placeholder="left, new" @change="saveTags" autocomplete="off"></label>
        <label class="wide">Note <input class="name-note" v-model="draft.note" maxlength="1000" @change="saveText('note')"></label>
        <span class="outcome" role="group" aria-label="Did it succeed?"><span>Success</span>
          <button class="yes" :aria-pressed="String(known.success === true)" @click="judge(true)">Yes</button>
          <button class="no" :aria-pressed="String(known.success === false)" @click="judge(false)">No</button></span>
        <button class="delete" @click="save({ deleted: !known.deleted })">{{ known.deleted ? "Restore" : "Delete" }}</button>
      </div>
      <p class="saved" role="status" :class="{ failed }"><template v-if="message || known.deleted">{{ message || gone }}
        <button v-if="before && !failed" class="take-back" @click="undo">Undo</button></template></p>
    </details>`,
  computed: {
    title() {
      return this.live && this.closed ? "Last demonstration" : "This demonstration";
    },
    gone: () => "Deleted: lists leave it out; its samples stay until the journal's limits remove them.",
    stated() {
      const { task, operator, note, tags, success } = this.known;
      const result = success === null ? "" : success ? "succeeded" : "failed";
      const when = this.opened ? dayAndTime(this.opened) : "";
      const gone = this.known.deleted ? "deleted" : "";
      return [task || "unnamed", operator, result, tags.join(", "), note, when, gone].filter(Boolean).join(" · ");
    },
  },
  methods: {
    apply(payload) {
      if (payload.session !== this.session) Object.assign(this, { before: null, message: "", failed: false });
      const isOver = payload.closed && !this.closed && payload.session === this.session;
      if (isOver) this.open = true; // now is the time to name it, and to state whether it succeeded
      Object.assign(this, { session: payload.session, opened: payload.opened, closed: payload.closed, tasks: payload.tasks });
      if (!this.asked.some((one) => one.session === this.session)) this.learn(payload.description);
    },
    learn(description) { // fields that are being typed in stay as they are
      const typing = document.activeElement && this.$el && this.$el.contains && this.$el.contains(document.activeElement) ? document.activeElement.className : "";
      this.known = description;
      for (const name of TEXTS) if (typing !== `name-${name}`) this.draft[name] = description[name] || "";
      if (typing !== "name-tags") this.draft.tags = description.tags.join(", ");
    },
    saveText(name) {
      this.save({ [name]: this.draft[name].trim() || null });
    },
    saveTags() {
      const tags = this.draft.tags.split(",").map((one) => one.trim()).filter(Boolean);
      this.save({ tags: [...new Set(tags)] });
    },
    judge(success) {
      this.save({ success: this.known.success === success ? null : success });
    },
    save(changes) {
      this.replace(this.known, { ...this.known, ...changes });
    },
    undo() {
      this.replace(this.known, this.before);
    },
    replace(before, description) { // one change at a time is under way: the next one builds on it
      if (JSON.stringify(before) === JSON.stringify(description)) return;
      this.asked.push({ session: this.session, before, description });
      Object.assign(this, { message: "Saving …", failed: false });
      this.learn(description);
      if (this.asked.length === 1) this.ask();
    },
    ask() {
      const author = (localStorage.getItem(AUTHOR) || "").trim();
      this.$emit("ask", { type: "describe", author, ...this.asked[0] });
    },
    answered(message, failed) {
      const { session, before } = this.asked.shift();
      if (failed) this.asked = this.asked.filter((one) => one.session !== session); // they built on what was refused
      if (this.asked.length) this.ask();
      if (session !== this.session || this.asked.some((one) => one.session === session)) return;
      if (failed) this.learn(before);
      Object.assign(this, { message, failed, before: failed ? this.before : before });
    },
  },
};
