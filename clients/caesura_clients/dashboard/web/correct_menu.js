// What can be corrected at a time, beside that time. A right click, a long press, R or the menu key opens it.
const WIDTH = 288, NEAR = 0.005; // pixels; [s] up to which a time is that of a changepoint

export default {
  props: { t: Number, selected: Number, segment: Object, kinds: Object, author: String, x: Number, y: Number, width: Number },
  emits: ["edit", "close", "rename", "time"],
  data: () => ({ newton: 10 }),
  template: `
    <div class="correct-menu" role="dialog" :aria-label="'Correct at ' + t.toFixed(2) + ' s'" :style="place" @keydown.esc.stop="$emit('close')">
      <label class="menu-time">Time [s] <input class="time" type="number" step="any" :value="t.toFixed(2)"
        @change="$event.target.value && $emit('time', Number($event.target.value))"></label>
      <button v-if="isAtPoint" class="remove" title="The two segments that meet here become one" @click="$emit('edit', { do: 'remove', t: selected })">
        Remove the changepoint <kbd>Delete</kbd></button>
      <button v-else class="insert" title="A segment ends here, and the next one begins" @click="$emit('edit', { do: 'insert', t })">
        Insert a changepoint <kbd>Enter</kbd></button>
      <button v-if="selected !== null && !isAtPoint" class="move" title="A changepoint can be dragged too" @click="$emit('edit', { do: 'move', t: selected, to: t })">
        Move {{ selected.toFixed(2) }} s here <kbd>M</kbd></button>
      <fieldset v-if="segment"><legend>The segment is</legend>
        <button v-for="(look, name) in kinds" :key="name" class="is-kind" :aria-pressed="String(name === segment[2])"
          @click="$emit('edit', { do: 'relabel', t, kind: name })"><i class="swatch" :class="'kind-' + name"></i>{{ name }}</button></fieldset>
      <form class="row" @submit.prevent="$emit('edit', { do: 'limit_force', t, newton })">
        <label>Force at most [N] <input class="newton" type="number" min="0" step="any" required v-model.number="newton"></label>
        <button class="limit" title="The app here exerts no more than that">Limit</button>
        <button type="button" class="unlimit" title="The app here exerts what was taught" @click="$emit('edit', { do: 'limit_force', t, newton: null })">No limit</button></form>
      <p v-if="author" class="by">by {{ author }} <button class="rename" @click="$emit('rename')">Another name</button></p>
    </div>`,
  mounted() {
    this.$el.querySelector("button").focus({ preventScroll: true });
    this.leave = (event) => this.$el.contains(event.target) || this.$emit("close");
    window.addEventListener("pointerdown", this.leave);
  },
  unmounted() {
    window.removeEventListener("pointerdown", this.leave);
  },
  computed: {
    isAtPoint() {
      return this.selected !== null && Math.abs(this.selected - this.t) < NEAR;
    },
    place() {
      return { left: `${Math.max(0, Math.min(this.x + 10, this.width - WIDTH))}px`, top: `${this.y}px` };
    },
  },
};
