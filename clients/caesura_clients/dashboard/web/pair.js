// Two sessions on one page that move together: each view states its range from the beginning of its own session.
// Apart, each moves alone; together again, they keep the distance that they have by then.
import { YScales } from "caesura-dashboard/y_scales.js";

export const SHARED = new YScales(); // of the values of both
const RANGE = "caesura-range", TOGETHER = "caesura-together", SIGNAL = "caesura-signal";
const NARROW = matchMedia("(max-width: 40rem)"); // the second lies below the first
let views = 0;

export const pair = {
  props: { linked: Boolean },
  data: () => ({ partnerLength: 0 }),
  created() {
    Object.assign(this, { number: (views += 1), together: true, shift: 0, partnerEnd: 0, stated: "" });
  },
  mounted() {
    if (!this.linked) return;
    window.addEventListener(RANGE, this.receiveRange);
    window.addEventListener(TOGETHER, this.receiveTogether);
    window.addEventListener(SIGNAL, this.receiveSignal);
    if (this.isStacked()) this.chosen = this.chosen.slice(0, 1);
  },
  unmounted() {
    window.removeEventListener(RANGE, this.receiveRange);
    window.removeEventListener(TOGETHER, this.receiveTogether);
    window.removeEventListener(SIGNAL, this.receiveSignal);
  },
  watch: {
    span: "stateRange", end: "stateRange", cursor: "stateRange", newest: "stateRange",
    partnerLength() {
      if (this.fitted) this.all();
    },
  },
  methods: {
    sided(name) { // of a tool that the other side has too
      return this.linked ? `${name}: ${this.station}/${this.session}` : name;
    },
    isStacked() { // both are in sight at once with one signal only: each button chooses that of both
      return this.linked && NARROW.matches;
    },
    chooseForBoth(name) {
      window.dispatchEvent(new CustomEvent(SIGNAL, { detail: name }));
    },
    receiveSignal({ detail }) {
      this.chosen = [detail];
    },
    ownRange() {
      return { span: this.span, end: this.shownEnd - this.begin, cursor: this.cursor === null ? null : this.cursor - this.begin };
    },
    stateRange() {
      if (!this.linked || this.session === "") return;
      const own = { ...this.ownRange(), length: this.newest - this.begin }, key = JSON.stringify(own);
      if (key === this.stated) return;
      this.stated = key;
      window.dispatchEvent(new CustomEvent(RANGE, { detail: { by: this.number, ...own } }));
    },
    receiveRange({ detail }) {
      if (detail.by === this.number) return;
      this.partnerEnd = detail.end;
      const isFirst = this.partnerLength === 0;
      this.partnerLength = detail.length;
      if (isFirst) { // the other view was there first: it has not received this one's range
        this.stated = "";
        this.$nextTick(this.stateRange);
        return;
      }
      if (!this.together || this.session === "") return;
      const cursor = detail.cursor === null ? null : this.begin + detail.cursor + this.shift;
      Object.assign(this, { span: detail.span, end: this.begin + detail.end + this.shift, cursor });
      this.stated = JSON.stringify({ ...this.ownRange(), length: this.newest - this.begin });
    },
    receiveTogether({ detail }) {
      this.together = detail;
      if (detail) this.shift = this.shownEnd - this.begin - this.partnerEnd;
    },
  },
};
