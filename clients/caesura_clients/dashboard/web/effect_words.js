// What a correction would change, in sentences; nothing while that is not known. more: a sentence behind them.
export default {
  props: { effect: Object, more: String },
  template: `
    <p class="effect" role="status" :class="{ failed: effect && effect.failed }">
      <template v-if="effect"><span v-if="!effect.failed" class="lead">{{ effect.lead }}</span>
        <span v-for="words in effect.words" :key="words">{{ words }}</span></template>
      <span v-if="more" class="more">{{ more }}</span></p>`,
};
