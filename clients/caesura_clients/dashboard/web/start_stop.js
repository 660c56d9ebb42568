// Start and Stop of a station: two large buttons, and the reason beside one that cannot be pressed.
import { changes } from "caesura-dashboard/clicks.js";
import { live } from "caesura-dashboard/live.js";
import Staying from "caesura-dashboard/staying.js";

const OPERATOR = "caesura-author";
const WORDS = { ready: "Ready", starting: "Starting …", teaching: "Teaching", stopping: "Storing …", failed: "Not ready" };
const newId = () => `press-${Date.now().toString(36)}-${Math.random().toString(36).slice(2, 10)}`;

export default {
  mixins: [live],
  components: { Staying },
  emits: ["ask"],
  data: () => ({
    station: "", state: "", session: "", canStart: false, canStop: false, seen: "", said: "", why: "", outcome: "", tasks: [], t: 0, offers: false,
    task: "", operator: localStorage.getItem(OPERATOR) || "", typed: false, busy: "", message: "", failed: false,
  }),
  template: `
    <section class="desk" :class="'desk-' + shown" aria-label="Start and stop">
      <div class="desk-words"><p class="desk-state" role="status">{{ words }}</p>
        <staying id="desk-why" class="desk-why" :class="{ failed }" :lines="offers ? 2 : 0">{{ message || why || outcome }}</staying></div>
      <form v-if="offers" @submit.prevent="start">
        <label class="wide">{{ canStop ? "Next task" : "Task" }} <input class="task" v-model="task" @input="typed = true" maxlength="120" list="desk-tasks"
          placeholder="optional" autocomplete="off"></label>
        <datalist id="desk-tasks"><option v-for="one in tasks" :key="one" :value="one"></option></datalist>
        <label>Operator <input class="operator" v-model="operator" maxlength="64" placeholder="optional" autocomplete="name"></label>
        <button class="start large" type="submit" :disabled="!canStart || busy !== ''" aria-describedby="desk-why">Start</button>
        <button class="stop large repeats" type="button" :disabled="!canStop || busy !== ''" @click="stop" aria-describedby="desk-why">Stop</button>
      </form>
    </section>`,
  computed: {
    words() {
      const word = this.seen === "stale" ? "Stale" : WORDS[this.state] || this.said.charAt(0).toUpperCase() + this.said.slice(1);
      return this.shown === "teaching" ? `${word} ${this.t} s` : word;
    },
    shown() {
      return this.seen === "stale" ? "stale" : this.state || this.seen;
    },
  },
  watch: {
    operator(name) { // who teaches also corrects, unless another name stands there
      localStorage.setItem(OPERATOR, name);
      window.dispatchEvent(new CustomEvent(OPERATOR, { detail: name }));
    },
  },
  methods: {
    apply(payload) {
      if (payload.session !== this.session || payload.state !== this.state) this.message = "";
      for (const name of ["station", "state", "session", "canStart", "canStop", "why", "outcome", "tasks", "t", "seen", "said"]) {
        if (name in payload) this[name] = payload[name];
      }
      this.offers ||= Boolean(this.state); // a bridge or a service that goes moves no plots
      if (!this.typed && payload.task) this.task = payload.task; // what was taught last, as a suggestion
    },
    ask(busy, command) {
      changes();
      Object.assign(this, { busy, message: `${busy} …`, failed: false });
      this.$emit("ask", command);
    },
    start() {
      if (!this.canStart || this.busy) return;
      const description = { task: this.task.trim() || null, operator: this.operator.trim() || null };
      this.ask("Starting", { type: "start", id: newId(), description });
    },
    stop() {
      if (this.canStop && !this.busy) this.ask("Storing", { type: "stop", session: this.session });
    },
    answered(message, failed) {
      Object.assign(this, { message: failed ? message : "", failed, busy: "", typed: false });
    },
  },
};
