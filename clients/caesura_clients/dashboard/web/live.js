// The common part of every component: it receives payloads, acknowledges them, and states what it is ready for.
// `offline`: the page is not connected to the dashboard, so what it shows is old. NiceGUI shows its popup meanwhile,
// but only where a connection is lost: a page may also have had none at all.
import "caesura-dashboard/focus.js";

const CONNECTS_MS = 10000;

export const live = {
  props: { initial: Object },
  emits: ["ready", "seen"],
  data: () => ({ offline: false }),
  methods: {
    take(number, payload) {
      this.apply(payload);
      this.$emit("seen", number);
    },
  },
  mounted() {
    if (this.initial) this.$nextTick(() => this.apply(this.initial)); // once the component itself is mounted
    this.$emit("ready", null);
    const popup = document.getElementById("popup");
    this.connection = new MutationObserver(() => (this.offline = popup.ariaHidden === "false"));
    this.connection.observe(popup, { attributeFilter: ["aria-hidden"] });
    this.unconnected = setTimeout(() => (this.offline ||= !window.did_handshake), CONNECTS_MS);
  },
  unmounted() {
    this.connection.disconnect();
    clearTimeout(this.unconnected);
  },
};
