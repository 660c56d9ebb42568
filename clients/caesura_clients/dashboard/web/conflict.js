// What another operator has set meanwhile, beside what was typed here: saved anyway, or given up.
export default {
  props: { words: String, busy: Boolean, isMet: { type: Boolean, default: true } },
  emits: ["anyway", "new-value"],
  mounted() { // also where it stands below what is in sight
    this.$el.scrollIntoView({ block: "nearest" });
  },
  template: `
    <div class="conflict" role="group" aria-label="Changed by another operator">
      <p role="alert">{{ words }}</p>
      <div class="row"><button type="button" class="save-anyway" :aria-disabled="busy" @click="$emit('anyway')">{{ isMet ? "Save anyway" : "Try again" }}</button>
        <button type="button" class="take-new" :aria-disabled="busy" @click="$emit('new-value')">{{ isMet ? "Take the new value" : "Give up" }}</button></div>
    </div>`,
};
