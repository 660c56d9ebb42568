// What the page consists of, and the keys that edit. Each has a button of its own.
export const keys = [
  { key: "q", name: "start", title: "start" },
  { key: "w", name: "stop", title: "stop" },
  { key: "e", name: "contact_on", title: "contact on" },
  { key: "r", name: "contact_off", title: "contact off" },
  { key: "c", name: "corner", title: "corner" },
  { key: "d", name: "dip", title: "dip (optional)" },
  { key: "o", name: "level", title: "optional or major" },
  { key: "+", alias: "=", name: "wider", title: "wider" },
  { key: "-", name: "narrower", title: "narrower" },
  { key: "a", name: "second", title: "second time" },
  { key: "x", alias: "Delete", name: "remove", title: "remove" },
  { key: "1", name: "steady", title: "steady", kind: "steady" },
  { key: "2", name: "motion", title: "motion", kind: "motion" },
  { key: "3", name: "contact", title: "contact", kind: "contact" },
  { key: "4", name: "sliding", title: "sliding", kind: "sliding" },
  { key: "5", name: "transport", title: "transport", kind: "transport" },
  { key: "6", name: "hold", title: "hold", kind: "hold" },
  { key: "7", name: "turning", title: "turning", kind: "turning" },
  { key: "0", name: "no class", title: "no class" },
  { key: "z", name: "undo", title: "undo" },
  { key: "s", name: "save", title: "save" },
];

export const template = `
  <section class="annotation" aria-label="Signals and marks">
    <fieldset class="tools">
      <legend>At the cursor</legend>
      <button v-for="one in keys" :key="one.key" :data-command="one.name" @click="command(one.name)" tabindex="-1">
        <kbd>{{ one.key }}</kbd> <i v-if="one.kind" class="swatch" :class="'kind-' + one.kind"></i>{{ one.title }}</button>
    </fieldset>
    <p class="message" role="status" :class="{ failed }">{{ message || standing }}</p>
    <ul class="legend" aria-label="Legend">
      <li v-for="{ axis, dash, name } in lines" :key="axis"><svg width="30" height="10" aria-hidden="true">
        <line x1="0" y1="5" x2="30" y2="5" :style="{ stroke: 'var(--line-' + axis + ')' }" stroke-width="1.5" :stroke-dasharray="dash" /></svg> {{ name }}</li>
      <li v-if="signals.force"><svg width="30" height="10" aria-hidden="true">
        <line x1="0" y1="5" x2="30" y2="5" style="stroke: var(--ink)" stroke-width="2.5" /></svg> magnitude of the force</li>
    </ul>
    <canvas ref="canvas" class="plot" style="height: max(30rem, calc(100vh - 21rem))" tabindex="0" role="application"
      aria-label="Speed, position and force against time, with changepoints and classes" aria-describedby="plot-help"
      @pointerdown="pressed" @wheel.prevent="wheeled" @keydown="key"></canvas>
    <p class="selection" role="status">Time {{ cursor.toFixed(3) }} s: {{ here }}; {{ near }}. {{ points.length }}
      {{ points.length === 1 ? "changepoint" : "changepoints" }}, {{ standing }}.</p>
    <p id="plot-help" class="help">In the plot: ← → move the cursor (⇧ finely), ↑ ↓ or the wheel zoom, Page ↑ ↓ go on,
      V shows 4 s or everything, [ and ] go from changepoint to changepoint. A click sets the cursor.</p>
  </section>`;
