// Hints to the teacher, readable from two metres: what to do now is large, what was found stands below it.
import { live } from "caesura-dashboard/live.js";

export default {
  mixins: [live],
  data: () => ({ hints: [] }),
  template: `
    <div class="hints" role="status" aria-label="Hints to the teacher">
      <div v-for="(hint, index) in hints" :key="hint.key" class="hint" :class="{ first: index === 0 }">
        <p class="hint-advice">{{ hint.advice }}</p>
        <p class="hint-text">{{ hint.text }} <a v-if="hint.href" :href="hint.href">{{ hint.link }}</a></p>
      </div>
    </div>`,
  methods: {
    apply(payload) {
      this.hints = payload.hints;
    },
  },
};
