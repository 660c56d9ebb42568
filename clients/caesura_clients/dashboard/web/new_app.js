// The form of a new app, after another one or first: what is not typed is that of the app beside it.
import { unsaved } from "caesura-dashboard/unsaved.js";

const MM = 1000;
const NEW = { name: "", target: ["", "", ""], force: [0, 0, ""], gripper_width: "", seconds: 2 }; // until others are typed

export default {
  mixins: [unsaved],
  props: { previous: Object, near: Object, kinds: Array, busy: Boolean }, // near: whose target it has where none is typed
  emits: ["edit"],
  data: () => ({ kind: "", fresh: structuredClone(NEW), added: JSON.stringify(NEW) }), // added: what is there already
  template: `
    <form class="new-app" :aria-label="previous ? 'New app after app ' + previous.number : 'New first app'" @submit.prevent="insert">
      <label>{{ previous ? "New app after it" : "Kind" }} <select v-model="kind"><option value="">choose</option>
        <option v-for="[kind, title] in kinds" :key="kind" :value="kind">{{ title }}</option></select></label>
      <template v-if="kind">
        <label>Name <input class="new-name" v-model="fresh.name" maxlength="10000" autocomplete="off"></label>
        <fieldset v-if="states('target')"><legend>Target [mm]</legend>
          <input v-for="(axis, i) in ['x', 'y', 'z']" :key="axis" :aria-label="'New target ' + axis + ' in mm'" type="number" step="any"
            v-model.number="fresh.target[i]" :placeholder="before[i]" :required="isMoved && before[i] === undefined"></fieldset>
        <fieldset v-if="states('force')"><legend>Force that the robot exerts [N], base frame</legend>
          <input v-for="(axis, i) in ['x', 'y', 'z']" :key="axis" :aria-label="'New force ' + axis + ' in N'" type="number" step="any"
            v-model.number="fresh.force[i]" :placeholder="axis" required></fieldset>
        <label v-if="states('gripper_width')">Gripper width [mm]
          <input class="new-gripper_width" type="number" step="any" min="0" v-model.number="fresh.gripper_width"></label>
        <label v-if="states('seconds')">Duration [s] <input class="new-seconds" type="number" step="any" v-model.number="fresh.seconds" required></label>
        <div class="row"><button class="insert-app" :aria-disabled="busy" :aria-label="previous ? 'Insert after app ' + previous.number : 'Insert as the first app'">Insert</button></div>
      </template>
    </form>`,
  computed: {
    stated() { // the values that a new app of this kind may have
      return (this.kinds.find(([kind]) => kind === this.kind) || [])[2] || [];
    },
    before() { // [mm] where the flange is, and a new app stays
      return ((this.near && this.near.target) || []).map((value) => +(MM * value).toFixed(1));
    },
    isMoved() {
      return this.fresh.target.some((value) => value !== "");
    },
  },
  methods: {
    states(name) {
      return this.stated.includes(name);
    },
    isUnsaved() {
      return this.kind !== "" && ![JSON.stringify(NEW), this.added].includes(JSON.stringify(this.fresh));
    },
    insert() {
      this.added = JSON.stringify(this.fresh);
      const { fresh, near, previous } = this, name = fresh.name.trim();
      const given = {
        target: this.isMoved && fresh.target.map((value, i) => (value === "" ? near.target[i] : value / MM)),
        force: [...fresh.force],
        gripper_width: fresh.gripper_width !== "" && fresh.gripper_width / MM,
        seconds: fresh.seconds,
      };
      const values = Object.fromEntries(Object.entries(given).filter(([one, value]) => this.states(one) && value !== false));
      const action = { do: "insert", after: previous ? previous.reference : null, kind: this.kind, ...(name && { name }), ...values };
      this.$emit("edit", action, null, (words, failed) => failed || (this.kind = "")); // else another press would insert it once more
    },
  },
  watch: {
    kind() {
      this.fresh = structuredClone(NEW);
    },
  },
};
