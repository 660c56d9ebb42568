// All corrections of a session, the newest first, with an undo at each.
import { pointing } from "caesura-dashboard/effect.js";
import EffectWords from "caesura-dashboard/effect_words.js";
import { dayAndTime } from "caesura-dashboard/numbers.js";

const OPEN_UP_TO = 8; // corrections, of a list that shows itself

export default {
  components: { EffectWords },
  props: { rows: Array, revision: Number, editable: Boolean, busy: Boolean, message: String, failed: Boolean, effect: Object },
  emits: ["edit", "preview"],
  data: () => ({ chosen: null, since: "" }),
  template: `
    <details class="corrections" :open="isOpen" @toggle="toggled($event.target.open)"><summary>Corrections: {{ rows.length || !revision ? rows.length : "not listed" }}</summary>
      <p v-if="!rows.length" class="empty">{{ revision ? unlisted : "Nothing has been corrected." }}</p>
      <ol v-if="rows.length" tabindex="0" aria-label="Corrections, the newest first">
        <li v-for="[number, words, at, state, reason] in newestFirst" :key="number" :class="state">
          <span class="number">{{ number }}</span><span class="words">{{ words }}<span v-if="reason" class="reason">. Not applied: {{ reason }}</span></span>
          <time :datetime="date(at).toISOString()">{{ dayAndTime(at) }}</time>
          <span v-if="state === 'undone'" class="state">undone</span>
          <button v-else-if="editable" class="take-back" :aria-disabled="busy" :aria-label="'Undo correction ' + number + ': ' + words"
            title="Take this correction back; the others stay" v-on="pointing(number)"
            @click="$emit('edit', { do: 'take_back', number })">Undo</button>
        </li>
      </ol>
      <p v-if="message" class="message" role="status" :class="{ failed }">{{ message }}</p>
      <label v-if="rows.length && editable" class="since">What has changed since <select v-model="since" @change="rest"><option value="">choose</option>
        <option :value="0">all that was inferred</option>
        <option v-for="[number, words] in earlier" :key="number" :value="number">correction {{ number }}: {{ words }}</option></select></label>
      <effect-words v-if="rows.length" :effect="effect"></effect-words>
    </details>`,
  computed: {
    unlisted() { // as `no_corrections` of the command line
      return `Revision ${this.revision}: its corrections, made under an older version of the service, are not listed.`;
    },
    newestFirst() {
      return [...this.rows].reverse();
    },
    earlier() { // those that count, without the newest: since that nothing has changed
      return this.rows.filter(([, , , state]) => state !== "undone").slice(0, -1);
    },
    isOpen() {
      return this.chosen ?? (this.rows.length > 0 && this.rows.length <= OPEN_UP_TO);
    },
  },
  watch: {
    revision() {
      this.since = "";
    },
  },
  methods: {
    toggled(open) { // by an operator: a list that shows itself is not chosen
      if (open !== this.isOpen) this.chosen = open;
    },
    pointing(number) {
      return pointing(() => this.$emit("preview", { do: "take_back", number }), this.rest);
    },
    rest() { // what is shown while no button is pointed at
      this.$emit("preview", this.since === "" ? null : { do: "since", number: this.since });
    },
    date: (at) => new Date(1000 * at),
    dayAndTime,
  },
};
