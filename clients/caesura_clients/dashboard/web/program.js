import { isOfAuthor, storeAuthor, storedAuthor } from "caesura-dashboard/author.js";
import { changes } from "caesura-dashboard/clicks.js";
import Conflict from "caesura-dashboard/conflict.js";
import { giveBack } from "caesura-dashboard/focus.js";
import { live } from "caesura-dashboard/live.js";
import { dayAndTime } from "caesura-dashboard/numbers.js";
import NewApp from "caesura-dashboard/new_app.js";
import AppCard from "caesura-dashboard/program_card.js";
import ProgramParts from "caesura-dashboard/program_parts.js";
import ProgramPath from "caesura-dashboard/program_path.js";
import ProgramVersions from "caesura-dashboard/program_versions.js";
import Staying from "caesura-dashboard/staying.js";
import { unanswered } from "caesura-dashboard/unanswered.js";
import { unsaved } from "caesura-dashboard/unsaved.js";

const requests = unanswered("program-edit");
const UNANSWERED = "An edit was asked for before this page was loaded again, and no answer came: make it again if it is not listed below.";
const OUTDATED = "Not done. The program has been edited since: look at the current state.";
const NEAR = 60; // pixels
const LISTED = 100; // apps at a time, as `program_timeline.py` has it
const PLACES = ["move", "insert", "duplicate"]; // edits by which an app beside another gets or changes its place
const gripperKey = () => `caesura-gripper/${location.pathname.split("/")[2]}`; // of the station, which has one gripper

export default {
  mixins: [live, unsaved],
  components: { AppCard, Conflict, NewApp, ProgramParts, ProgramPath, ProgramVersions, Staying },
  props: { editable: Boolean, speeds: Array, answers: { type: Boolean, default: true } },
  emits: ["edit", "simulate", "cancel", "compare", "part"],
  provide() {
    return { appsShown: () => this.program.apps, keyOf: this.key, typed: new Map(), lost: this.lost, cameBack: this.cameBack };
  },
  data: () => ({ program: null, message: "", failed: false, refusedAt: null, busy: false, name: "", nameSeen: "", nameConflict: null, afterwards: null, sought: null, soughtIn: 0, holds: false, gripper: localStorage.getItem(gripperKey()) || "", asked: null, draft: "", sent: {}, made: {}, inserts: false }),
  template: `
    <div class="program">
    <section class="program-column" aria-labelledby="program-title">
      <staying v-if="program" class="program-said" :class="{ failed }" :lines="0" upon>{{ message }}</staying>
      <h2 id="program-title" ref="title" tabindex="-1">Program <small v-if="program">{{ program.name }} version <span class="version">{{ program.version }}</span>{{
        program.complete ? ", complete" : ", being taught" }}{{ edited }}</small></h2>
      <div v-if="program" class="program-tools">
        <template v-if="editable">
          <label>Program name <input class="program-name" v-model="name" maxlength="10000" placeholder="unnamed" autocomplete="off"
            @change="rename"></label>
          <conflict v-if="nameConflict" :words="nameConflict.words" :busy="busy" @anyway="renameAnyway" @new-value="takeNewName"></conflict>
          <button v-show="program.undoable" class="undo-edit repeats" :aria-disabled="busy" @click="say({ do: 'undo' })">Undo edit</button>
          <button v-show="program.redoable" class="redo-edit repeats" :aria-disabled="busy" @click="say({ do: 'redo' })">Redo edit</button>
        </template>
        <label v-if="program.grippers.length">Gripper <select class="gripper" v-model="gripper"><option value="">not stated</option>
          <option v-for="[one, title] in program.grippers" :key="one" :value="one">{{ title }}</option></select></label>
        <span v-if="program.apps.length" class="exports">Export <a v-for="[title, href] in program.exports" :key="href" :href="exported(href)">{{ title }}</a>
          <a v-if="program.dataset" class="dataset" :href="program.dataset">LeRobot dataset</a></span>
        <form v-if="asked" class="who-edits" aria-label="Who edits" @submit.prevent="sign" @keydown.esc.stop="cancelName">
          <label>Your name <input ref="author" class="author" v-model="draft" maxlength="10000" autocomplete="name" required></label>
          <button class="save-name">Save</button> <button type="button" @click="cancelName">Cancel</button></form>
      </div>
      <div v-if="program" class="unfolded">
      <details v-if="program.notes.length" class="program-notes"><summary>Notes: {{ program.notes.length }}</summary>
        <ul class="notes" aria-label="Notes"><li v-for="note in program.notes" :key="note">{{ note }}</li></ul></details>
      <program-versions v-if="program.edits.length" :key="program.session" :edits="program.edits" ref="versions"
        @compare="$emit('compare', $event)"></program-versions>
      </div>
      <program-parts v-if="program && (program.before || program.after)" :before="program.before" :count="program.apps.length" :after="program.after"
        :found="program.found" @list="list" @seek="seek"></program-parts>
      <ol v-if="program && program.apps.length" ref="apps" class="apps" tabindex="0" aria-label="Apps in order">
        <app-card v-for="app in program.apps" :key="key(app)" :app="app" :start="program.start" :editable="editable" :sessions="program.sessions" :kinds="program.kinds"
          :busy="busy" @edit="(...asked) => sayAt(app.number, ...asked)"></app-card>
      </ol>
      <p v-else class="empty">{{ answers ? "Nothing taught yet." : "The service does not answer: what was taught is not known." }}</p>
      <ul v-if="program && program.findings.length" class="findings" aria-label="Check of the program">
        <li v-for="[severity, reason] in program.findings" :key="reason" :class="severity">{{ severity }}: {{ reason }}</li>
      </ul>
      <div v-if="program" class="unfolded">
      <details v-if="editable" class="app-edit first-app" @toggle="inserts = $event.target.open"><summary>New first app</summary>
        <new-app v-if="inserts" :near="program.before ? null : program.apps[0]" :kinds="program.kinds" :busy="busy" @edit="(...asked) => sayAt(0, ...asked)"></new-app></details>
      <details v-if="program.edits.length" class="edits"><summary>Edits: {{ program.edits.length }}</summary>
        <ol><li v-for="[number, words, author, state, reason] in program.edits" :key="number" :value="number" :class="{ failed: reason }">
          {{ words }} – {{ author }}, {{ state }}{{ reason ? ": " + reason : "" }}</li></ol></details>
      </div>
    </section>
    <program-path v-if="program && program.path.length" :rows="program.path" :start="program.start" :part="program.pathBefore + program.pathAfter > 0" :speeds="speeds" :elsewhere="program.elsewhere" ref="path"
      @simulate="(speed) => $emit('simulate', speed)" @cancel="$emit('cancel')"></program-path>
    </div>`,
  computed: {
    listed() { // the numbers of the first and the last app that have cards
      return [this.program.before + 1, this.program.before + this.program.apps.length];
    },
    edited() {
      if (!this.program.author) return "";
      const at = this.program.edited ? `, ${dayAndTime(this.program.edited)}` : "";
      return `, ${this.program.changed} by ${this.program.author}${at}`;
    },
  },
  watch: {
    gripper(name) {
      localStorage.setItem(gripperKey(), name);
    },
  },
  methods: {
    isUnsaved() {
      return this.editable && this.program !== null && (this.asked !== null || this.name.trim() !== this.nameSeen.trim());
    },
    key: (app) => Object.values(app.reference).slice(0, 2).concat(app.reference.added).join(),
    apply(payload) { // what changed: values by their names, rows from a number on
      if (payload.gone) return Object.assign(this, { program: null, message: "" }); // its session is held no longer
      const held = this.program || {}, now = { ...held, ...payload };
      for (const [name, before] of Object.entries({ apps: now.before, path: now.pathBefore })) {
        if (payload[name]) now[name] = this.rows(held[name] || [], payload[name], before);
      }
      const isOther = now.session !== held.session, typed = this.name.trim();
      if (isOther || typed === this.nameSeen || typed === now.name) this.fillName(now.name); // else what was typed stays
      if (isOther) Object.assign(this, { message: "", refusedAt: null, sought: null });
      else if (this.refusedAt !== null && now.editRevision > this.refusedAt) Object.assign(this, { message: OUTDATED, failed: false, refusedAt: null });
      if (isOther && this.editable) this.recall(now.session);
      const grows = isOther ? !now.complete : !held.complete; // also at its end, when findings come below the list
      const follows = grows && !now.after && !held.after && this.isAtEnd();
      this.program = Object.freeze(now); // Vue compares cards and rows by their identity, and looks into none
      if (this.sought !== null && now.editRevision >= this.soughtIn) this.$nextTick(this.find);
      else if (follows) this.$nextTick(this.goToEnd);
    },
    recall(session) { // an edit whose answer was lost with the connection
      if (requests.recall((asked) => asked.session === session)) Object.assign(this, { message: UNANSWERED, failed: true });
    },
    rows(held, { first, rows }, before) {
      return Object.freeze([...held.filter(({ number }) => number > before && number < first), ...rows.map(Object.freeze)]);
    },
    lost({ number, name, title }) { // a form with something typed into it went with its app
      const app = `App ${number} (${name || title})`;
      Object.assign(this, { message: `${app} is no longer shown. What was typed into its form is not saved, and comes back with it.`, failed: true, refusedAt: null });
    },
    cameBack({ number, name, title }) {
      Object.assign(this, { message: `App ${number} (${name || title}) is shown again. What was typed into its form is not saved yet.`, failed: false, refusedAt: null });
    },
    isAtEnd() { // the newest app is in sight: what is taught next comes into sight too
      const list = this.$refs.apps;
      return !list || list.scrollHeight - list.clientHeight - list.scrollTop + list.scrollWidth - list.clientWidth - list.scrollLeft < NEAR;
    },
    goToEnd() {
      const list = this.$refs.apps;
      if (list) list.scrollTo(list.scrollWidth, list.scrollHeight);
    },
    list(last) { // the part that ends with this app; null: the newest apps
      this.seek(last === null ? Infinity : Math.max(1, last - LISTED + 1), last, false);
    },
    // Bring an app into sight, in the middle of its part, and its tools under the keys.
    seek(number, last = number + LISTED / 2, holds = true) {
      const [from, to] = this.listed, total = to + this.program.after;
      Object.assign(this, { sought: Math.min(number, total), soughtIn: 0, holds });
      if (this.sought >= from && this.sought <= to) this.find();
      else this.$emit("part", last === null || last >= total ? null : last);
    },
    find() { // once its part is there
      const [from, to] = this.listed, card = this.sought >= from && this.sought <= to && this.$refs.apps.children[this.sought - from];
      if (!card) return;
      this.sought = null;
      card.scrollIntoView({ block: "nearest", inline: "nearest" });
      if (this.holds) (card.querySelector("summary") || this.$refs.apps).focus();
    },
    awaitApp(number, revision) { // a new one comes into sight once its program is there
      Object.assign(this, { sought: number, soughtIn: revision, holds: true });
      if (this.program.editRevision >= revision) this.$nextTick(this.find);
    },
    exported(href) {
      return this.program.grippers.some(([name]) => name === this.gripper) ? `${href}?gripper=${encodeURIComponent(this.gripper)}` : href;
    },
    compared(found) {
      this.$refs.versions?.compared(found);
    },
    simulated(found) {
      this.$refs.path?.simulated(found);
    },
    rename() {
      const name = this.name.trim();
      if (!name) this.fillName(this.program.name);
      else if (name !== this.nameSeen) this.say({ do: "name", name }, { name: this.nameSeen }, this.renamed);
    },
    renamed(words, failed, found) {
      this.nameConflict = found ? { words, name: found.name } : null;
    },
    renameAnyway() {
      this.nameSeen = this.nameConflict.name;
      this.rename();
    },
    takeNewName() {
      this.fillName(this.nameConflict.name);
    },
    fillName(name) {
      Object.assign(this, { name, nameSeen: name, nameConflict: null });
    },
    say(action, seen = null, answered = null) { // with the name that corrections have too. seen: of which a form was filled
      const author = storedAuthor();
      if (!author) return this.askName([action, seen, answered]);
      changes();
      Object.assign(this, { busy: true, message: "", failed: false, refusedAt: null, afterwards: answered });
      const { session, editRevision } = this.program, { made } = this; // an edit of this page may be there before its program
      const revision = made.session === session ? Math.max(editRevision, made.revision) : editRevision;
      this.sent = { session, revision: revision + 1 };
      this.lastAsked = [action, seen, answered];
      requests.keep({ session });
      this.$emit("edit", { session, revision, author, action, ...(seen && { seen }) });
    },
    sayAt(number, action, ...asked) { // at the edge of a part, the next apps are listed first: what is moved stays in sight
      const { before, after } = this.program, [from, to] = this.listed, total = to + after;
      const isAtEdge = (before && number - from < 2) || (after && to - number < 2);
      const last = number + LISTED / 2;
      if (isAtEdge && PLACES.includes(action.do)) this.$emit("part", last < total ? last : null);
      this.say(action, ...asked);
      this.inserted = { insert: number + 1, replace_part: number }[action.do] ?? null;
    },
    askName(action) { // of who edits, at the first edit; then it is made
      Object.assign(this, { asked: action, draft: "" });
      this.opener = document.activeElement;
      this.$nextTick(() => this.$refs.author.focus());
    },
    askAgain() { // for another name
      const name = storedAuthor();
      storeAuthor("");
      this.askName(this.lastAsked);
      this.draft = name;
    },
    cancelName() {
      this.inserted = null;
      this.leaveName();
    },
    leaveName() {
      this.asked = null;
      this.$nextTick(() => giveBack(this.opener, this.$refs.title));
    },
    sign() {
      const [action, name] = [this.asked, this.draft.trim()];
      if (!name) return;
      storeAuthor(name);
      this.leaveName();
      this.say(...action);
    },
    answered(message, failed, found = null, refusedAt = null) { // found: what another operator has set meanwhile; the form states it
      requests.forget();
      Object.assign(this, { message: found ? "" : message, failed, refusedAt, busy: false, made: failed ? {} : this.sent });
      this.afterwards?.(message, failed, found);
      this.afterwards = null;
      if (failed && isOfAuthor(message)) return this.askAgain();
      if (this.inserted && !failed) this.awaitApp(this.inserted, this.sent.revision);
      this.inserted = null;
    },
  },
};
