// Which apps of a long program are listed: the page has cards of a part of them, and leads to every other one.
const FOUND = 5; // apps with findings that are named

export default {
  props: { before: Number, count: Number, after: Number, found: Array }, // before, after: apps that are not listed
  emits: ["list", "seek"],
  data: () => ({ number: "" }),
  template: `
    <nav class="parts" aria-label="Apps that are listed">
      <p role="status">Apps {{ before + 1 }} to {{ before + count }} of {{ total }}</p>
      <button :aria-disabled="String(!before)" @click="before && $emit('list', count)">First</button>
      <button :aria-disabled="String(!before)" aria-label="Earlier apps" @click="before && $emit('list', before)">◀</button>
      <button :aria-disabled="String(!after)" aria-label="Later apps" @click="after && $emit('list', before + 2 * count)">▶</button>
      <button :aria-disabled="String(!after)" @click="after && $emit('list', null)">Newest</button>
      <form @submit.prevent="$emit('seek', number)"><input class="part-number" aria-label="App to go to" placeholder="app" type="number" min="1"
        :max="total" v-model.number="number" required> <button>Go</button></form>
      <p v-if="elsewhere.length">Findings also at app <template v-for="one in elsewhere.slice(0, most)" :key="one">
        <button :aria-label="'Go to app ' + one" @click="$emit('seek', one)">{{ one }}</button>{{ " " }}</template>
        <template v-if="elsewhere.length > most">and {{ elsewhere.length - most }} more</template></p>
    </nav>`,
  computed: {
    most: () => FOUND,
    total() {
      return this.before + this.count + this.after;
    },
    elsewhere() {
      return this.found.filter((number) => number <= this.before || number > this.before + this.count);
    },
  },
};
