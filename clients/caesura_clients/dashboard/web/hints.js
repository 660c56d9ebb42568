// Hints to the teacher, readable from two metres: what to do now is large, what was found stands below it. A cause may be
// over within a second: the newest such hint stays, marked, for as long as it takes to read it.
import { live } from "caesura-dashboard/live.js";

const READ_MS = 4000;

export default {
  mixins: [live],
  data: () => ({ hints: [] }),
  template: `
    <div class="hints" role="status" aria-label="Hints to the teacher">
      <div v-for="(hint, index) in hints" :key="hint.key" class="hint" :class="{ first: index === 0, over: hint.isOver }">
        <p class="hint-advice">{{ hint.isOver ? "Over: " : "" }}{{ hint.advice }}</p>
        <p class="hint-text">{{ hint.text }} <a v-if="hint.href" :href="hint.href">{{ hint.link }}</a></p>
      </div>
    </div>`,
  methods: {
    apply(payload) {
      const isActive = new Set(payload.hints.map(({ key }) => key)), before = this.hints.filter(({ key }) => !isActive.has(key));
      const over = before.find(({ isOver }) => !isOver) ?? before[0]; // the newest alone: many would cover the plots
      this.hints = over ? [...payload.hints, { ...over, isOver: true }] : payload.hints;
      if (over && !over.isOver) setTimeout(() => this.drop(over.key), READ_MS);
    },
    drop(key) {
      this.hints = this.hints.filter((hint) => hint.key !== key || !hint.isOver);
    },
  },
};
