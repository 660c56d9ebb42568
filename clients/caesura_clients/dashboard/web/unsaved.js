// A page that is left is asked for first while something is typed in it that was not saved: a field is saved when the
// cursor leaves it, and going back or loading the page again does not make it leave.
export const unsaved = {
  mounted() {
    window.addEventListener("beforeunload", this.holdUnsaved);
  },
  unmounted() {
    window.removeEventListener("beforeunload", this.holdUnsaved);
  },
  methods: {
    holdUnsaved(event) { // the browser asks
      if (this.isUnsaved()) event.preventDefault();
    },
  },
};
