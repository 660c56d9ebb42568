// What every component of ours has in common: it takes payloads, says that it saw them, and what it is ready for.
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
    if (this.initial) this.apply(this.initial);
    this.$emit("ready", null);
  },
};
