import { live } from "caesura-dashboard/live.js";
import { dayAndTime } from "caesura-dashboard/numbers.js";

export default {
  mixins: [live],
  data: () => ({ warnings: [], tables: [] }),
  template: `
    <div>
      <div role="alert"><p v-for="one in warnings" :key="one" class="banner">{{ one }}</p></div>
      <section v-for="table in tables" :key="table.title">
        <h2>{{ table.title }}</h2>
        <p v-if="table.words">{{ table.words }}</p>
        <p v-if="table.rows.length === 0" class="empty">{{ table.empty }}</p>
        <div v-else class="scroll" tabindex="0" role="region" :aria-label="table.title">
          <table class="facts"><thead><tr><th v-for="[key, title] in table.columns" :key="key" scope="col">{{ title }}</th></tr></thead>
          <tbody><tr v-for="(row, i) in table.rows" :key="i">
            <td v-for="[key, title] in table.columns" :key="key" :data-title="title" :class="{ alarm: alarming(key, row[key]) }">{{ shown(key, row[key]) }}</td>
          </tr></tbody></table>
        </div>
      </section>
    </div>`,
  methods: {
    apply(payload) {
      this.warnings = payload.warnings;
      this.tables = payload.tables;
    },
    shown(key, value) {
      return key === "since" && value !== null ? dayAndTime(value) : value ?? "–";
    },
    alarming(key, value) {
      return ["overloaded", "gone", "stale"].includes(value) || (["gaps", "lost", "dropped"].includes(key) && value !== "0");
    },
  },
};
