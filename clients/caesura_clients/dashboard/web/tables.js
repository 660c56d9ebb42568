import { live } from "caesura-dashboard/live.js";

export default {
  mixins: [live],
  data: () => ({ warnings: [], tables: [] }),
  template: `
    <div>
      <div role="alert"><p v-for="one in warnings" :key="one" class="banner">{{ one }}</p></div>
      <section v-for="table in tables" :key="table.title">
        <h2>{{ table.title }}</h2>
        <p v-if="table.rows.length === 0" class="empty">{{ table.empty }}</p>
        <div v-else class="scroll" tabindex="0" role="region" :aria-label="table.title">
          <table><thead><tr><th v-for="[key, title] in table.columns" :key="key" scope="col">{{ title }}</th></tr></thead>
          <tbody><tr v-for="(row, i) in table.rows" :key="i">
            <td v-for="[key] in table.columns" :key="key" :class="{ alarm: alarming(key, row[key]) }">{{ row[key] }}</td>
          </tr></tbody></table>
        </div>
      </section>
    </div>`,
  methods: {
    apply(payload) {
      this.warnings = payload.warnings;
      this.tables = payload.tables;
    },
    alarming(key, value) {
      return ["overloaded", "gone", "stale"].includes(value) || (["gaps", "lost", "dropped"].includes(key) && value !== "0");
    },
  },
};
