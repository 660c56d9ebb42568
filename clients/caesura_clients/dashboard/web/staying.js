// Words in a place of so many lines. Longer ones lie upon what is below, so that nothing moves, until they are closed or
// something else is pressed. `upon`: no place is kept, and all words lie there.
const ROUNDED = 2; // pixels

export default {
  inheritAttrs: false,
  props: { lines: { type: Number, default: 1 }, upon: Boolean }, // 0: as many as there are
  data: () => ({ isLong: false, closed: false }),
  template: `
    <div class="staying" :class="{ long: isLong, closed, free: !lines && !upon, upon }" :style="{ '--lines': lines }">
      <p ref="words" role="status" v-bind="$attrs"><slot></slot></p>
      <button v-if="isLong" type="button" class="staying-close" :aria-expanded="String(!closed)" :aria-label="closed ? 'Show the whole message' : 'Close the message'"
        @click="closed = !closed">{{ closed ? "…" : "×" }}</button>
    </div>`,
  mounted() {
    this.look = new ResizeObserver(([{ contentRect: { width } }]) => width !== this.width && this.measure(width));
    this.look.observe(this.$el);
    document.addEventListener("pointerdown", this.fold, true);
  },
  unmounted() {
    this.look.disconnect();
    document.removeEventListener("pointerdown", this.fold, true);
  },
  updated() {
    const words = this.$refs.words.textContent;
    if (words === this.said) return;
    this.said = words;
    this.closed = false;
    this.measure();
  },
  methods: {
    fold({ target }) {
      if (this.isLong && !this.$el.contains(target)) this.closed = true;
    },
    measure(width = this.width) {
      Object.assign(this, { isLong: false, width });
      this.$nextTick(() => (this.isLong = (this.lines > 0 || this.upon) && this.$refs.words.offsetHeight > this.$el.clientHeight + ROUNDED));
    },
  },
};
