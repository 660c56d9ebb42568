// Which range of time is shown, how it is moved, and what of it is loaded.
import { continued, load, reach } from "caesura-dashboard/signals.js";

const LEAST_S = 0.05, AT_FIRST_S = 30, MARGIN = 0.25; // a share of the view that is loaded on both sides
const TAIL_S = 1; // by which the last samples of a session may lie behind what was found in it
const WAIT_MS = 40, LIVE_MS = 150, SLOW_MS = 1000, RING_S = 55; // so long the dashboard itself holds what is live

export const view = {
  methods: {
    // [s] from and to. Without a chosen end it follows what is newest.
    view() {
      const end = this.shownEnd, begin = this.begin;
      const span = this.closed && this.end === null ? Math.min(this.span, this.longest()) : this.span; // no empty axis
      const from = Math.max(begin, end - span);
      return [from, from + span];
    },
    longest() { // [s] that can be shown: the session, or the longer one of two that are compared
      return Math.max(this.newest - this.begin, this.partnerLength, this.replay || this.closed ? 1 : AT_FIRST_S);
    },
    latest() {
      return Math.max(this.newest, this.begin + this.partnerLength);
    },
    show(from, to) {
      const span = Math.min(Math.max(to - from, LEAST_S), this.longest());
      const start = Math.max(this.begin, Math.min(from, Math.max(this.latest() - span, this.begin)));
      this.span = span;
      this.end = Math.min(start + span, this.latest());
      if (!this.closed && !this.replay && this.end >= this.newest - 1e-9 && span >= AT_FIRST_S) this.end = null;
    },
    zoom(factor, around = null) {
      const [from, to] = this.view();
      const t = around ?? (this.cursor !== null && this.cursor >= from && this.cursor <= to ? this.cursor : (from + to) / 2);
      const span = Math.min(Math.max((to - from) * factor, LEAST_S), this.longest());
      const scale = span / (to - from);
      this.show(t - (t - from) * scale, t - (t - from) * scale + span);
    },
    pan(share) {
      const [from, to] = this.view(), by = (to - from) * share;
      this.show(from + by, to + by);
    },
    all() {
      this.show(this.begin, this.begin + this.longest());
    },
    wheeled(event) {
      const [from] = this.view();
      if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY)) {
        return this.pan((event.deltaX || event.deltaY) / 800);
      }
      this.zoom(Math.exp(Math.max(-1, Math.min(1, event.deltaY / 300))), Math.max(from, this.scale().t(this.offset(event))));
    },

    // --- what is loaded: one request at a time, then one for what is shown by then ---
    want(after = 0) {
      if (this.waiting || this.loading) return;
      this.waiting = setTimeout(() => {
        this.waiting = 0;
        if (this.lacksData()) this.load();
      }, after);
    },
    lacksData() {
      if (this.session === "" || !this.$refs.panels) return false;
      const [from, to] = this.view(), held = this.data;
      if (!held || held.shown !== this.shownColumns() || held.closed !== this.closed) return true; // ended: the journal has all
      if (from < held.from - 1e-9 || Math.min(to, this.newest) > held.upTo + 1e-9) return true;
      return held.to - held.from > 2 * (1 + 2 * MARGIN) * (to - from);
    },
    async load() {
      const [from, to] = this.view(), { newest } = this;
      const margin = this.end !== null ? MARGIN * (to - from) : this.closed ? TAIL_S : 0;
      const range = { from: Math.max(this.begin, from - margin), to: to + margin };
      const bins = (this.scale().x1 - this.scale().x0) * (range.to - range.from) / (to - from);
      const asked = { ...range, shown: this.shownColumns(), session: this.session, closed: this.closed };
      this.loading = true;
      try {
        const found = await this.found(asked, bins);
        const upTo = Math.min(range.to, Math.max(newest, found.last ?? newest));
        if (asked.session === this.session) this.take_data({ ...found, ...asked, upTo });
        this.trouble = "";
      } catch (error) {
        this.trouble = `Signals cannot be shown: ${error.message}`;
      }
      this.loading = false;
      const isRing = this.newest - this.view()[0] < RING_S;
      this.want(this.trouble ? SLOW_MS : this.end !== null ? WAIT_MS : isRing ? LIVE_MS : Math.max(SLOW_MS, this.pixelMs()));
    },
    async found(asked, bins) { // while a session goes on, only what is new in it
      const ask = (range) => load(this.station, asked.session, { ...range, bins, columns: asked.shown.split(",").filter(Boolean) });
      const held = this.data, t = reach(held, asked);
      const whole = t === null ? null : continued(held, await ask({ from: t, to: asked.to }), asked.from, t);
      return whole || ask(asked);
    },
    pixelMs() { // by so much time a drawing moves by a pixel
      const [from, to] = this.view(), { x0, x1 } = this.scale();
      return (1000 * (to - from)) / (x1 - x0);
    },
  },
};
