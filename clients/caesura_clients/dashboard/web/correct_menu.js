// What can be corrected at a time, beside that time. A right click, a long press, R or the menu key opens it.
import { clock } from "caesura-dashboard/clock.js";
import { pointing } from "caesura-dashboard/effect.js";
import EffectWords from "caesura-dashboard/effect_words.js";

const WIDTH = 288, BAND = 58, BESIDE = 10, MARGIN = 8, EFFECT = 170; // pixels; the last: what a preview adds to the height
const NEAR = 0.005; // [s] up to which a time is that of a changepoint

export default {
  mixins: [clock],
  components: { EffectWords },
  props: { t: Number, start: Number, begin: Number, newest: Number, selected: Number, segment: Object, phase: Object, kinds: Object, author: String, x: Number, y: Number, width: Number, room: Number, kept: Array, effect: Object },
  emits: ["edit", "preview", "close", "leave", "rename", "time"],
  data: () => ({ newton: 10, outside: "", tapped: "", name: "", raised: 0, bottom: "auto", most: "none", apart: false }), // apart: the preview is at the lower edge of the window
  template: `
    <div class="correct-menu" :class="{ apart }" role="dialog" :aria-label="'Correct at ' + shownTime(t) + ' s'" :style="place" @keydown.esc.stop="$emit('close')" @focusout="left">
      <label class="menu-time">Time [s] <input ref="time" class="time" type="number" step="any" :aria-invalid="String(outside !== '')" @change="setTime($event.target.value)"></label>
      <button v-if="isAtPoint" class="remove" title="The two segments that meet here become one" v-on="making({ do: 'remove', t: selected })">
        Remove the changepoint <kbd>Delete</kbd></button>
      <button v-else class="insert" title="A segment ends here, and the next one begins" v-on="making({ do: 'insert', t })">
        Insert a changepoint <kbd>Enter</kbd></button>
      <button v-if="selected !== null && !isAtPoint" class="move" title="A changepoint can be dragged too" v-on="making({ do: 'move', t: selected, to: t })">
        Move {{ shownTime(selected) }} s here <kbd>M</kbd></button>
      <fieldset v-if="segment"><legend>The segment is</legend>
        <button v-for="(look, name) in kinds" :key="name" class="is-kind" :aria-pressed="String(name === segment[2])"
          v-on="making({ do: 'relabel', t, kind: name })"><i class="swatch" :class="'kind-' + name"></i>{{ name }}</button></fieldset>
      <form class="row" @submit.prevent="make({ do: 'limit_force', t, newton })">
        <label>Force at most [N] <input class="newton" type="number" min="0" step="any" required v-model.number="newton"></label>
        <button class="limit" title="The app here exerts no more than that" v-on="pointing({ do: 'limit_force', t, newton })">Limit</button>
        <button type="button" class="unlimit" title="The app here exerts what was taught" v-on="making({ do: 'limit_force', t, newton: null })">No limit</button></form>
      <form v-if="phase" class="row" @submit.prevent="make({ do: 'name_phase', t, name })">
        <label>Name the phase {{ phase[2] }} <input class="phase-name" maxlength="10000" required v-model.trim="name"></label>
        <button class="name-phase" title="Its apps are a group of this name; nothing else changes"
          v-on="name ? pointing({ do: 'name_phase', t, name }) : {}">Name</button></form>
      <p v-if="author" class="by">by {{ author }} <button class="rename" @click="$emit('rename')">Another name</button></p>
      <p v-if="outside" class="outside" role="alert">{{ outside }}</p>
      <effect-words v-else :effect="effect" :more="tapped && 'Tap again to correct.'"></effect-words>
    </div>`,
  watch: {
    t() {
      this.outside = "";
      if (document.activeElement !== this.$refs.time) this.writeTime();
    },
    phase: {
      immediate: true,
      handler(now, before) { // a phase that goes on is another row of the same beginning
        if (!before || !now || now[0] !== before[0]) this.name = (now && now[6]) || "";
      },
    },
  },
  mounted() {
    this.writeTime();
    this.fit();
    this.$el.querySelector("button").focus({ preventScroll: true });
    this.leave = (event) => this.$el.contains(event.target) || this.$emit("close");
    window.addEventListener("pointerdown", this.leave);
  },
  unmounted() {
    window.removeEventListener("pointerdown", this.leave);
  },
  methods: {
    fit() { // into the window, once: it would move under the pointer whenever a preview comes
      if (this.beside === null) return this.leaveBand();
      const { top, bottom } = this.$el.getBoundingClientRect();
      this.raised = Math.max(0, Math.min(bottom + EFFECT + MARGIN - window.innerHeight, top - MARGIN));
      this.most = `${window.innerHeight - MARGIN - top + this.raised}px`; // a longer preview is scrolled
    },
    left({ relatedTarget }) { // by Tab: it would lie upon what has the focus, where Esc does not close it
      if (relatedTarget && !this.$el.contains(relatedTarget)) this.$emit("leave");
    },
    leaveBand() { // no room beside the segment: the band shows it, and the menu is above or below that
      const frame = this.$el.parentElement.getBoundingClientRect().top;
      const header = Math.max(0, document.querySelector("header")?.getBoundingClientRect().bottom ?? 0); // it takes every tap
      const low = Math.ceil(Math.max(frame + BAND, header + MARGIN)), below = window.innerHeight - MARGIN - EFFECT - low, above = frame - header - 2 * MARGIN;
      Object.assign(this, { apart: true, most: `${Math.max(below, above)}px` });
      if (below >= above) this.raised = this.y - (low - frame);
      else this.bottom = `calc(100% + ${MARGIN}px)`;
    },
    writeTime() { // once: a binding would undo what is being typed whenever the menu is drawn anew
      if (this.$refs.time) this.$refs.time.value = this.shownTime(this.t);
    },
    setTime(typed) { // one outside the session stays as it was typed, and nothing is corrected until it is another one
      const t = typed ? this.readTime(Number(typed)) : this.t, brief = (time) => String(Number(this.shownTime(time)));
      const [from, to] = [this.begin, this.newest].map(brief);
      const isInside = Number(brief(t)) >= Number(from) && Number(brief(t)) <= Number(to);
      this.outside = isInside ? "" : `Time ${brief(t)} s is outside the session (${from} to ${to} s): type a time in it.`;
      if (!isInside) return this.$emit("preview", null);
      this.$emit("time", t);
      this.$nextTick(this.writeTime);
    },
    make(action) {
      if (this.outside) this.$refs.time.select();
      else this.$emit("edit", action);
    },
    pointing(action) { // listeners of a button: what it would change is shown while it is pointed at
      return pointing(() => this.outside || this.$emit("preview", action), () => {
        this.tapped = "";
        this.$emit("preview", null);
      });
    },
    making(action) { // and it makes the correction: at the second tap of a finger, which points at nothing before
      return { ...this.pointing(action), click: (event) => this.choose(event, action) };
    },
    choose(event, action) {
      const tap = JSON.stringify(action);
      if (event.pointerType !== "touch" || this.tapped === tap || this.outside) return this.make(action);
      this.tapped = tap;
      this.$emit("preview", action);
    },
  },
  computed: {
    isAtPoint() {
      return this.selected !== null && Math.abs(this.selected - this.t) < NEAR;
    },
    beside() { // [px] the place nearest to the time where it covers nothing that is previewed; null: there is none
      const [from, to] = this.kept || [this.x, this.x];
      const free = [to + BESIDE, from - BESIDE - WIDTH, this.width + BESIDE].filter((left) => left >= 0 && left + WIDTH + MARGIN <= this.room);
      const away = (left) => Math.max(left - this.x, this.x - left - WIDTH);
      return free.length ? free.reduce((one, other) => (away(other) < away(one) ? other : one)) : null;
    },
    place() {
      const left = this.beside ?? Math.max(0, Math.min(this.x + BESIDE, this.width - WIDTH));
      const top = this.bottom === "auto" ? `${this.y - this.raised}px` : "auto";
      return { left: `${left}px`, top, bottom: this.bottom, maxHeight: this.most };
    },
  },
};
