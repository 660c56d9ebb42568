// The common part of every component: it receives payloads, acknowledges them, and states what it is ready for.
export const live = {
  props: { initial: Object },
  emits: ["ready", "seen"],
  methods: {
    take(number, payload) {
      this.apply(payload);
      this.$emit("seen", number);
    },
  },
  mounted() {
    if (this.initial) this.$nextTick(() => this.apply(this.initial)); // once the component itself is mounted
    this.$emit("ready", null);
  },
};
