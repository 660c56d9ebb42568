// An app of the program in words, drawn anew only where it changed.
import { clock } from "caesura-dashboard/clock.js";
import { percent } from "caesura-dashboard/palette.js";
import AppEdit from "caesura-dashboard/program_edit.js";

export default {
  mixins: [clock],
  components: { AppEdit },
  props: { app: Object, start: Number, editable: Boolean, sessions: Array, kinds: Array, busy: Boolean },
  emits: ["edit"],
  template: `
    <li class="app" :class="{ changed: app.changes.length }">
      <h3>{{ app.number }} · {{ app.name || app.title }}</h3>
      <p class="when"><template v-if="app.name">{{ app.title }}, </template>{{ shownTime(app.t0, 1) }}–{{ shownTime(app.tn, 1) }} s</p>
      <p v-if="app.note" class="app-said">{{ app.note }}</p>
      <div v-if="app.drawing" class="app-way" v-html="app.drawing"></div>
      <dl><div v-for="[name, value] in app.lines" :key="name"><dt>{{ name }}</dt><dd>{{ value }}</dd></div></dl>
      <p v-if="app.limited" class="limited">force limited</p>
      <p class="confidence"><span aria-hidden="true" class="bar"><i :style="{ width: 100 * app.confidence + '%' }"></i></span>
        confidence {{ percent(app.confidence) }}</p>
      <ul v-if="app.changes.length" class="marks" aria-label="Edits"><li v-for="one in app.changes" :key="one">{{ one }}</li></ul>
      <ul v-if="app.findings.length" class="findings" aria-label="Findings">
        <li v-for="[severity, reason] in app.findings" :key="reason" :class="severity">{{ severity }}: {{ reason }}</li>
      </ul>
      <app-edit v-if="editable" :app="app" :sessions="sessions" :kinds="kinds" :busy="busy" @edit="(...asked) => $emit('edit', ...asked)"></app-edit>
    </li>`,
  methods: { percent },
};
