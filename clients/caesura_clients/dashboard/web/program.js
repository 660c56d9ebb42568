import { live } from "caesura-dashboard/live.js";
import { percent } from "caesura-dashboard/palette.js";

export default {
  mixins: [live],
  data: () => ({ program: null }),
  template: `
    <section aria-labelledby="program-title">
      <h2 id="program-title">Program <small v-if="program">version <span class="version">{{ program.version }}</span>{{
        program.complete ? ", complete" : ", being taught" }}{{ edited }}</small></h2>
      <ul v-if="program && program.notes.length" class="notes" aria-label="Notes">
        <li v-for="note in program.notes" :key="note">{{ note }}</li>
      </ul>
      <p v-if="program && program.before" class="empty">The newest {{ program.apps.length }} apps; {{ program.before }} come
        before them.</p>
      <ol v-if="program && program.apps.length" class="apps" tabindex="0" aria-label="Apps in order">
        <li v-for="app in program.apps" :key="app.number" class="app">
          <h3>{{ app.number }} · {{ app.title }}</h3>
          <p class="when">{{ app.t0.toFixed(1) }}–{{ app.tn.toFixed(1) }} s</p>
          <div v-if="app.drawing" v-html="app.drawing"></div>
          <dl><div v-for="[name, value] in app.lines" :key="name"><dt>{{ name }}</dt><dd>{{ value }}</dd></div></dl>
          <p v-if="app.limited" class="limited">force limited</p>
          <p class="confidence"><span aria-hidden="true" class="bar"><i :style="{ width: 100 * app.confidence + '%' }"></i></span>
            confidence {{ percent(app.confidence) }}</p>
        </li>
      </ol>
      <p v-else class="empty">Nothing taught yet.</p>
    </section>`,
  computed: {
    edited() {
      if (!this.program.author) return "";
      const at = this.program.edited ? new Date(1000 * this.program.edited).toLocaleTimeString() : "";
      return `, corrected by ${this.program.author} ${at}`;
    },
  },
  methods: {
    percent,
    apply(payload) {
      this.program = payload;
    },
  },
};
