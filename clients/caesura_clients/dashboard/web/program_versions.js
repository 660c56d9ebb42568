// Two versions of the program: which apps differ, and in which values. A version is the program up to one of its edits.
const AGAIN_MS = 5000; // after which a comparison that failed is asked for again: the service was busy or away

export default {
  props: { edits: Array },
  emits: ["compare"],
  data: () => ({ open: false, from: 0, to: null, found: null, asking: false, message: "" }),
  template: `
    <details class="versions" @toggle="toggled($event.target.open)"><summary>Compare versions</summary>
      <template v-if="open">
        <label>Before <select class="version-from" v-model.number="from">
          <option v-for="[number, words] in versions" :key="number" :value="number">{{ words }}</option></select></label>
        <label>After <select class="version-to" :value="last" @change="to = Number($event.target.value)">
          <option v-for="[number, words] in versions" :key="number" :value="number">{{ words }}</option></select></label>
        <p role="status" class="versions-said" :class="{ failed: message }">{{ message || (found ? found.said : "Comparing…") }}</p>
        <ul v-if="found && found.rows.length" aria-label="Apps that differ">
          <li v-for="{ app, was, changes } in found.rows" :key="app + was"><strong>{{ app }}</strong><template v-if="was"> is {{ was }}</template>
            <dl v-if="changes.length"><div v-for="[what, before, after] in changes" :key="what"><dt>{{ what }}</dt>
              <dd>{{ before ? before + " → " + after : after }}</dd></div></dl></li></ul>
      </template></details>`,
  computed: {
    versions() { // one that was undone is none
      const counting = this.edits.filter(([, , , state]) => state !== "undone");
      return [[0, "as inferred"], ...counting.map(([number, words, author]) => [number, `edit ${number}: ${words} – ${author}`])];
    },
    newest() {
      return this.versions.at(-1)[0];
    },
    has() {
      return (number) => this.versions.some(([one]) => one === number);
    },
    last() { // the newest one until another is chosen
      return this.to !== null && this.has(this.to) ? this.to : this.newest;
    },
    wanted() {
      return JSON.stringify({ from: this.has(this.from) ? this.from : 0, to: this.last });
    },
  },
  watch: {
    wanted: "ask",
    edits(now, before) { // an edit that was undone and made again has the same number
      if (JSON.stringify(now) !== JSON.stringify(before)) this.ask();
    },
  },
  unmounted() {
    clearTimeout(this.again);
  },
  methods: {
    toggled(open) {
      this.open = open;
      if (open) this.ask();
    },
    ask() { // one question at a time, then one for what is chosen by then
      clearTimeout(this.again);
      if (!this.has(this.from)) this.from = 0;
      if (!this.open || this.asking) {
        this.isLate = this.asking;
        return;
      }
      Object.assign(this, { asking: true, isLate: false });
      this.$emit("compare", JSON.parse(this.wanted));
    },
    compared(found) {
      this.asking = false;
      if (this.isLate) return this.ask();
      if (found.failed) this.again = setTimeout(() => this.ask(), AGAIN_MS);
      Object.assign(this, found.failed ? { found: null, message: found.said } : { found: Object.freeze(found), message: "" });
    },
  },
};
