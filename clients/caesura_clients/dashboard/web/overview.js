import { live } from "caesura-dashboard/live.js";
import { KINDS, percent } from "caesura-dashboard/palette.js";

export default {
  mixins: [live],
  data: () => ({ stations: null, summary: "", answers: true }),
  template: `
    <div>
      <p class="summary" role="status">{{ offline ? "The connection to the dashboard is lost: what is shown is old." : summary }}</p>
      <ul class="cards" aria-label="Stations">
        <li v-for="one in stations" :key="one.station" class="card" :class="'is-' + stateOf(one)">
          <h2><a :href="'/station/' + one.station">{{ one.station }}</a></h2>
          <p class="state"><span class="badge badge-said" :class="'badge-' + stateOf(one)">{{ badge(one) }}</span>
            <span v-if="one.overloaded" class="badge badge-stale">overloaded</span></p>
          <p class="why" v-if="one.why">{{ one.why }}{{ one.state === "stale" ? "; what is shown is old" : "" }}</p>
          <p class="now"><template v-if="one.kind"><i class="swatch" :class="'kind-' + one.kind"></i>
            <strong>{{ one.kind }}</strong> {{ percent(one.probability) }}</template>
            <template v-else>{{ one.segments ? "last demonstration" : "no segment yet" }}</template></p>
          <div class="strip" aria-hidden="true"><i v-for="(row, i) in one.kinds" :key="i" :class="'kind-' + row[2]"
            :style="{ flexGrow: Math.max(row[1] - row[0], 0.05), opacity: 0.35 + 0.65 * row[3] }"></i></div>
          <dl>
            <div><dt>{{ one.task ? "task" : "session" }}</dt><dd>{{ one.task || one.session || "–" }}</dd></div>
            <div><dt>time</dt><dd>{{ one.t.toFixed(1) }} s</dd></div>
            <div><dt>segments</dt><dd>{{ one.segments }}</dd></div>
            <div><dt>apps</dt><dd>{{ one.apps }}</dd></div>
            <div><dt>gaps</dt><dd :class="{ alarm: one.gaps > 0 }">{{ one.gaps }}</dd></div>
            <div><dt>sample</dt><dd :class="{ alarm: one.state === 'stale' }">{{ age(one) }}</dd></div>
          </dl>
        </li>
      </ul>
      <p v-if="stations && stations.length === 0 && !answers" class="empty">No service answers. Start one with <code>caesura serve</code>: this page
        shows its stations as soon as it runs.</p>
      <p v-else-if="stations && stations.length === 0" class="empty">No station yet. Connect one with
        <code>caesura bridge --station cell-1</code>.</p>
    </div>`,
  methods: {
    percent,
    apply(payload) {
      this.stations = payload.stations;
      this.summary = payload.summary;
      this.answers = payload.answers;
    },
    stateOf(one) {
      return this.offline ? "stale" : one.state;
    },
    badge(one) {
      return this.offline ? "stale" : one.said;
    },
    age(one) {
      if (this.offline) return "–";
      if (one.age_s) return `${one.age_s} ago`;
      return one.state === "teaching" ? "just now" : "–";
    },
    known: (kind) => kind in KINDS,
  },
};
