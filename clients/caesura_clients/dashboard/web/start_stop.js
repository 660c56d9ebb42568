// Start and Stop of a station: two large buttons, and the reason beside one that cannot be pressed.
import { AUTHOR, storeAuthor } from "caesura-dashboard/author.js";
import { changes } from "caesura-dashboard/clicks.js";
import { live } from "caesura-dashboard/live.js";
import Staying from "caesura-dashboard/staying.js";
import { unanswered } from "caesura-dashboard/unanswered.js";

const WORDS = { ready: "Ready", starting: "Starting …", teaching: "Teaching", stopping: "Storing …", failed: "Not ready" };
// States of the bridge in which the refusal of a press has nothing to say any more.
const PAST = { start: ["stopping", "failed"], stop: ["ready", "failed"] };
const presses = unanswered("press");
const SETTLED = ["ready", "teaching", "failed"]; // states in which it is seen what became of it
const WIDE = matchMedia("(min-width: 48rem)"); // the reason has a whole row
const newId = () => `press-${Date.now().toString(36)}-${Math.random().toString(36).slice(2, 10)}`;

export default {
  mixins: [live],
  components: { Staying },
  emits: ["ask"],
  data: () => ({
    station: "", state: "", session: "", canStart: false, canStop: false, seen: "", said: "", why: "", outcome: "", tasks: [], t: 0, offers: false, wide: WIDE.matches,
    task: "", operator: localStorage.getItem(AUTHOR) || "", typed: false, message: "", failed: false,
    pressed: "", unanswered: [], refusedIn: "", // the last press, those without an answer, and the session of the refusal
    held: null, // the session on which a pointer has pressed Stop, until it is released
  }),
  template: `
    <section class="desk" :class="'desk-' + shown" aria-label="Start and stop">
      <div class="desk-words"><p class="desk-state"><span role="status">{{ words }}</span>{{ age }}</p>
        <staying id="desk-why" class="desk-why" :class="{ failed }" :lines="offers ? (wide ? 1 : 2) : 0">{{ reason }}</staying></div>
      <form v-if="offers" @submit.prevent="start">
        <label class="wide">{{ canStop ? "Next task" : "Task" }} <input class="task" v-model="task" @input="typed = true" maxlength="10000" list="desk-tasks"
          placeholder="optional" autocomplete="off"></label>
        <datalist id="desk-tasks"><option v-for="one in tasks" :key="one" :value="one"></option></datalist>
        <label>Operator <input class="operator" v-model="operator" maxlength="10000" placeholder="optional" autocomplete="name"></label>
        <button class="start large" type="submit" :aria-disabled="Boolean(!canStart || unanswered.length > 0)" aria-describedby="desk-why">Start</button>
        <button class="stop large repeats" type="button" :aria-disabled="Boolean(!canStop || unanswered.includes('stop'))" @pointerdown="held = session" @click="release" @keydown="held = null"
          @keydown.space.prevent="stop(session)" @keyup.space.prevent aria-describedby="desk-why">Stop</button>
      </form>
    </section>`,
  mounted() {
    WIDE.addEventListener("change", this.measure);
  },
  unmounted() {
    WIDE.removeEventListener("change", this.measure);
  },
  computed: {
    words() {
      return this.shown === "stale" ? "Stale" : WORDS[this.state] || this.said.charAt(0).toUpperCase() + this.said.slice(1);
    },
    age() { // not announced: it changes every second
      return this.shown === "teaching" && this.t ? ` ${this.t} s` : "";
    },
    reason() { // where the state of the bridge is not known, the message waits until it is
      if (this.offline) return "The connection to the dashboard is lost: what is shown is old.";
      return (this.state && this.message) || this.why || this.outcome;
    },
    shown() {
      return this.offline || this.seen === "stale" ? "stale" : this.state || this.seen;
    },
  },
  watch: {
    operator(name) { // who teaches also corrects, unless another name stands there
      storeAuthor(name);
    },
  },
  methods: {
    measure() {
      this.wide = WIDE.matches;
    },
    apply(payload) {
      if (this.isPast(payload)) Object.assign(this, { message: "", failed: false });
      for (const name of ["station", "state", "session", "canStart", "canStop", "why", "outcome", "tasks", "t", "seen", "said"]) {
        if (name in payload) this[name] = payload[name];
      }
      this.offers ||= Boolean(this.state); // a bridge or a service that goes moves no plots
      if (!this.typed && payload.task) this.task = payload.task; // what was taught last, as a suggestion
      if (!this.unanswered.length && SETTLED.includes(this.state)) this.recall();
    },
    recall() { // a press whose answer was lost because the page was loaded again, as after a lost connection
      const press = presses.recall(({ station }) => station === this.station);
      if (press === null) return;
      const [button, isPossible] = press.type === "start" ? ["Start", this.canStart] : ["Stop", this.canStop && press.session === this.session];
      const message = `${button} was pressed before this page was loaded again, and no answer came: press it again if it is still needed.`;
      if (isPossible) Object.assign(this, { pressed: "", failed: true, message });
    },
    isPast({ session, state, why }) { // the message; a refusal stands although the refused start came and goes as a state
      if (!this.failed || !this.pressed) return session !== this.session || state !== this.state;
      this.refusedIn ||= session;
      const isAnother = this.pressed === "start" && session !== "" && session !== this.refusedIn;
      return isAnother || PAST[this.pressed].includes(state) || (state === "ready" && why !== "");
    },
    ask(message, command) {
      changes();
      Object.assign(this, { pressed: command.type, unanswered: [...this.unanswered, command.type], message, failed: false });
      presses.keep({ station: this.station, type: command.type, session: command.session });
      this.$emit("ask", command);
    },
    start() {
      if (!this.canStart || this.unanswered.length) return;
      const description = { task: this.task.trim() || null, operator: this.operator.trim() || null };
      this.ask("Starting …", { type: "start", id: newId(), description });
    },
    release() { // of Stop: another session may have begun since it was pressed
      const session = this.held ?? this.session;
      this.held = null;
      this.stop(session);
    },
    stop(session) { // also while the answer to a start has not come; "": it was pressed where nothing could be stopped
      if (session && this.canStop && !this.unanswered.includes("stop")) this.ask("Stopping …", { type: "stop", session });
    },
    answered(type, message, failed) {
      this.unanswered = this.unanswered.filter((one) => one !== type);
      if (type === "start" && !failed) this.typed = false;
      if (!this.unanswered.length) presses.forget();
      if (type === this.pressed) Object.assign(this, { message: failed ? message : "", failed, refusedIn: this.session });
    },
  },
};
