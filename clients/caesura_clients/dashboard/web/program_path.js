// The path of a program in three dimensions: each app in the colour of its kind, via points, forces, and where the
// robot is at a time. Lengths are to scale (parallel projection), so two views can be compared.
import { contextOf, fontOf, inkOf, Painter, watchLook } from "caesura-dashboard/canvas.js";
import { clock } from "caesura-dashboard/clock.js";
import { placedLabels, ranges, span } from "caesura-dashboard/labels.js";
import { measuredPath } from "caesura-dashboard/measured_path.js";
import { fixed } from "caesura-dashboard/numbers.js";
import { KINDS } from "caesura-dashboard/palette.js";
import Staying from "caesura-dashboard/staying.js";
import { unanswered } from "caesura-dashboard/unanswered.js";

const runs = unanswered("simulation");
const UNANSWERED = "A simulated run ended with the connection, before the page was loaded again: simulate it again.";
const OFFER = "Simulate runs the program on the simulated arm, in a cell that is built from the program.";
const VIEWS = { "3D": [-0.7, 0.5], top: [-Math.PI / 2, Math.PI / 2], front: [-Math.PI / 2, 0], side: [0, 0] };
const MARGIN = 34, LEGEND_PX = 68, LEAST_MM = 60, STEP_RAD = Math.PI / 36, TICK_MS = 50, GROWS_MS = 1000, FORCE_PX_PER_N = 1.5, LONGEST_PX = 60;
const BARS_MM = [1000, 500, 200, 100, 50, 20, 10], BAR_PX = 130, AXES = ["x", "y", "z"];
const SHARED_PX = 12, NUMBERS_PX = 30, FORCES_PX = 70, LINE_PX = 6; // between labels; between points of a line that a label avoids
const MOST_POINTS = 200; // of a line, however much the path is enlarged
const CROWD = 20; // apps
const MOSTS = [5, 3, 2, 1]; // numbers at one place
const between = (low, high, value) => Math.min(Math.max(value, low), high);
const share = (labels, [x, y], what) => { // [x, y, what]; those at one place are written as one
  const shared = labels.find(([x0, y0]) => Math.hypot(x - x0, y - y0) < SHARED_PX);
  if (shared) shared[2].push(what);
  else labels.push([x, y, [what]]);
};
const alongLine = (places) => places.slice(1).flatMap(([x, y], i) => {
  const [x0, y0] = places[i], count = Math.min(Math.ceil(Math.hypot(x - x0, y - y0) / LINE_PX), MOST_POINTS);
  return Array.from({ length: count }, (_, k) => [x0 + ((k + 0.5) / count) * (x - x0), y0 + ((k + 0.5) / count) * (y - y0)]);
});

export default {
  mixins: [clock, measuredPath],
  components: { Staying },
  props: { rows: Array, part: Boolean, start: Number, speeds: Array, elsewhere: Boolean }, // elsewhere: another page simulates
  emits: ["simulate", "cancel"],
  data: () => ({
    angles: VIEWS["3D"], zoom: 1, t: null, playing: false, views: Object.keys(VIEWS),
    run: null, follows: false, speed: "taught", said: "", stopped: false, busy: false,
  }),
  template: `
    <details class="program-path" open><summary>Path in 3D<template v-if="part">, apps {{ rows[0].number }} to {{ rows.at(-1).number }}</template></summary>
      <div class="path-tools">
        <span class="moves" role="group" aria-label="View of the path">
          <button v-for="name in views" :key="name" :aria-pressed="String(isView(name))" @click="look(name)">{{ name }}</button>
          <button aria-label="Enlarge the path" @click="zoom *= 1.25">+</button><button aria-label="Shrink the path" @click="zoom /= 1.25">−</button></span>
        <span v-if="speeds.length" class="group"><label>Speed <select class="simulated-speed" v-model="speed">
          <option v-for="name in speeds" :key="name" :value="name">{{ name }}</option></select></label>
        <button ref="simulate" class="simulate" :aria-disabled="Boolean(busy || elsewhere)" @click="simulate">{{ busy ? "Simulating…" : "Simulate" }}</button>
        <button ref="cancel" class="cancel-simulation" :class="{ absent: !busy }" aria-label="Cancel simulation" @click="$emit('cancel')">Cancel</button></span>
        <button v-if="speeds.length" class="follow-run" :aria-disabled="Boolean(!run)" :aria-pressed="String(follows)" @click="followRun(!follows)">Simulated run</button>
        <button class="show-measured" :aria-disabled="Boolean(!measured)" :aria-pressed="String(showsMeasured)" @click="showsMeasured = !showsMeasured">Measured</button>
        <button class="play-path" @click="play">{{ playing ? "Pause" : "Play" }}</button>
        <label class="path-time">Time in the program <input type="range" :min="range[0]" :max="range[1]" step="0.05" :value="shown"
          @input="go(Number($event.target.value))" :aria-valuetext="words"></label>
        <output aria-live="off">{{ words }}</output>
      </div>
      <staying v-if="speeds.length" class="simulated" :class="{ failed: stopped }" :lines="2">{{ stands }}</staying>
      <canvas ref="canvas" tabindex="0" role="img" :aria-label="'Path of the program in three dimensions, ' + rows.length + ' apps. Arrow keys turn it.'"
        @pointerdown="grasp" @pointermove="drag" @pointerup="held = null" @pointercancel="held = null" @keydown="key"></canvas>
      <p class="measured-said">{{ measuredWords }}</p>
    </details>`,
  computed: {
    range() {
      if (this.follows) return [this.run[0][0], this.run.at(-1)[0]];
      return [this.rows[0].points[0][0], this.rows.at(-1).points.at(-1)[0]];
    },
    shown() {
      return between(...this.range, this.t ?? this.range[1]);
    },
    at() { // the app that is run at the time, or that was run last before it
      return this.rows.findLast(({ points }) => points[0][0] <= this.shown) || this.rows[0];
    },
    chosen() { // the app that is marked; while a simulated run is followed its time is none of the program
      return this.follows ? null : this.at;
    },
    stands() {
      return this.said || (this.elsewhere ? "Another simulation is under way on this dashboard." : this.busy ? "" : OFFER);
    },
    words() {
      const [x, y, z] = this.place().map((value) => fixed(value, 0));
      const what = this.follows ? "simulated run" : `${this.at.number} ${this.at.words}`;
      return `${this.follows ? fixed(this.shown, 1) : this.shownTime(this.shown, 1)} s · ${what} · (${x}, ${y}, ${z}) mm`;
    },
  },
  watch: { rows: "changed", run: "draw", follows: "draw", angles: "draw", zoom: "draw", t: "draw" },
  mounted() {
    this.painter = new Painter(this.$refs.canvas, () => this.$refs.canvas.clientWidth && this.paint());
    this.unwatch = watchLook(this.$refs.canvas, this.draw, this.draw);
    this.$refs.canvas.path = this; // for who looks at the page from outside
    if (runs.recall(({ page }) => page === location.pathname)) Object.assign(this, { said: UNANSWERED, stopped: true });
  },
  unmounted() {
    clearInterval(this.player);
    this.unwatch();
    this.painter.close();
  },
  methods: {
    isView(name) {
      return VIEWS[name].every((angle, i) => Math.abs(angle - this.angles[i]) < 1e-6);
    },
    look(name) {
      Object.assign(this, { angles: VIEWS[name], zoom: 1 });
    },
    rotate(around, over) {
      this.angles = [this.angles[0] + around, between(-Math.PI / 2, Math.PI / 2, this.angles[1] + over)];
    },
    grasp(event) {
      this.held = [event.clientX, event.clientY];
      event.target.setPointerCapture(event.pointerId);
    },
    drag(event) {
      if (!this.held) return;
      const [x, y] = this.held;
      this.held = [event.clientX, event.clientY];
      this.rotate((x - event.clientX) / 150, (event.clientY - y) / 150);
    },
    key(event) {
      const way = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
      if (!way) return;
      event.preventDefault();
      this.rotate(...way.map((step) => step * STEP_RAD));
    },

    // --- the simulated run ---
    simulate() {
      Object.assign(this, { busy: true, said: "", stopped: false });
      this.asked = JSON.stringify(this.rows);
      runs.keep({ page: location.pathname });
      this.$emit("simulate", this.speed);
      this.$nextTick(() => this.$refs.cancel?.focus()); // a disabled button has no focus
    },
    simulated({ said, stopped, points }) {
      runs.forget();
      const held = document.activeElement === this.$refs.cancel;
      Object.assign(this, { busy: false, said, stopped, run: null });
      if (held) this.$nextTick(() => this.$refs.simulate.focus());
      if (this.asked !== JSON.stringify(this.rows)) this.said = "The program has changed meanwhile: simulate it again.";
      else if (points.length) this.run = Object.freeze(points);
      this.followRun(this.run !== null);
    },
    changed(now, before) { // a run of another program is none of this one
      if (!this.run || JSON.stringify(now) !== JSON.stringify(before)) {
        this.followRun(false);
        Object.assign(this, { run: null, said: this.run ? "The program has changed: simulate it again." : this.said, stopped: false });
      }
      if (now.length === before.length) this.painter.soon(GROWS_MS);
      else this.draw(); // the words name the new app
    },
    followRun(follows) {
      if (this.playing) this.play();
      Object.assign(this, { follows, t: null });
    },

    // --- time ---
    go(t) {
      this.t = t;
    },
    play() {
      clearInterval(this.player);
      this.playing = !this.playing;
      if (!this.playing) return;
      if (this.shown >= this.range[1]) this.t = this.range[0];
      let before = performance.now();
      this.player = setInterval(() => {
        const now = performance.now();
        this.t = Math.min(this.shown + (now - before) / 1000, this.range[1]);
        before = now;
        if (this.t >= this.range[1]) this.play();
      }, TICK_MS);
    },
    place() { // [mm] where the robot is at the time
      const points = this.follows ? this.run : this.at.points, t = this.shown;
      const i = Math.max(1, points.findIndex(([at]) => at >= t));
      const [[t0, ...from], [tn, ...to]] = t >= points.at(-1)[0] ? [points.at(-1), points.at(-1)] : [points[i - 1], points[i]];
      const share = tn > t0 ? between(0, 1, (t - t0) / (tn - t0)) : 0;
      return from.map((value, axis) => value + share * (to[axis] - value));
    },

    // --- drawing ---
    draw() {
      this.painter.now();
    },
    directions() { // of the picture's right and up, in the base frame
      const [around, over] = this.angles, [s, c] = [Math.sin(around), Math.cos(around)];
      return [[-s, c, 0], [-c * Math.sin(over), -s * Math.sin(over), Math.cos(over)]];
    },
    projection(width, height) { // as large as the picture allows
      const [right, up] = this.directions(), along = (axis, place) => axis.reduce((sum, share, i) => sum + share * place[i], 0);
      const all = [...this.rows.flatMap(({ points }) => points), ...this.runs.flatMap(({ places }) => places)];
      const ends = (axis) => {
        let [least, most] = [Infinity, -Infinity];
        for (const [, ...place] of all) {
          const at = along(axis, place);
          [least, most] = [Math.min(least, at), Math.max(most, at)];
        }
        return [least, most];
      };
      const [[left, rightmost], [low, high]] = [ends(right), ends(up)];
      const room = (pixels, mm) => pixels / Math.max(mm, LEAST_MM), bottom = height - LEGEND_PX - MARGIN / 2;
      const scale = this.zoom * Math.min(room(width - 2 * MARGIN, rightmost - left), room(bottom - MARGIN, high - low));
      const [x, y, middle] = [(left + rightmost) / 2, (low + high) / 2, (MARGIN + bottom) / 2];
      return { scale, of: (place) => [width / 2 + scale * (along(right, place) - x), middle - scale * (along(up, place) - y)] };
    },
    paint() {
      const canvas = this.$refs.canvas, context = contextOf(canvas), { text: ink, faint, paper } = inkOf();
      const [width, height] = [canvas.clientWidth, canvas.clientHeight], { scale, of } = this.projection(width, height);
      Object.assign(context, { lineCap: "round", lineJoin: "round", font: fontOf(), textBaseline: "middle" });
      const legend = this.frame(context, height, scale, faint);
      const line = (places, colour, width) => {
        context.beginPath();
        places.forEach((place, i) => context[i ? "lineTo" : "moveTo"](...of(place)));
        Object.assign(context, { strokeStyle: colour, lineWidth: width });
        context.stroke();
      };
      const dot = (place, radius, fill) => {
        context.beginPath();
        context.arc(...of(place), radius, 0, 7);
        Object.assign(context, { fillStyle: fill, strokeStyle: ink, lineWidth: 1 });
        context.fill();
        context.stroke();
      };
      for (const { kind, places } of this.runs) {
        const measured = places.map(([, ...place]) => place);
        line(measured, ink, 5.5); // an edge in ink: yellow and white paper have little contrast
        line(measured, kind ? KINDS[kind].colour : paper, 4);
      }
      for (const row of this.rows) {
        const places = row.points.map(([, ...place]) => place);
        const isAt = row === this.chosen;
        if (this.runs.length) line(places, ink, isAt ? 2.5 : 1); // upon the colours of what was measured
        else {
          line(places, ink, isAt ? 6 : 4);
          line(places, KINDS[row.kind].colour, isAt ? 4 : 2);
        }
        row.via.forEach(([, ...place]) => dot(place, 2.5, paper));
      }
      if (this.run) {
        context.setLineDash([5, 4]);
        line(this.run.map(([, ...place]) => place), ink, 1.5);
        context.setLineDash([]);
      }
      const forces = [];
      for (const row of this.rows) {
        const target = row.points.at(-1).slice(1);
        dot(target, 3.5, KINDS[row.kind].colour);
        const tip = row.force && this.arrow(context, of(target), row.force, ink);
        if (tip) share(forces, tip, Math.hypot(...row.force));
      }
      dot(this.place(), 6, ink);
      const marks = this.rows.flatMap(({ points, via }) => [points[0], ...via, points.at(-1)].map(([, ...place]) => of(place)));
      const lines = this.rows.flatMap(({ points }) => alongLine(points.map(([, ...place]) => of(place))));
      const fontFor = (chosen) => (chosen ? `bold ${fontOf()}` : fontOf());
      const widthOf = (words, chosen) => Object.assign(context, { font: fontFor(chosen) }).measureText(words).width;
      Object.assign(context, { fillStyle: ink, strokeStyle: paper, lineWidth: 3 });
      const labels = [...this.numbers(of), ...forces.map(([x, y, all]) => ({ x, y, words: [`${span(all)} N`], sort: "force", ...this.room(FORCES_PX) }))];
      for (const { x, y, height: high, words, one } of placedLabels(labels, { width, height }, legend, { marks, lines }, widthOf)) {
        context.font = fontFor(one.chosen);
        context.strokeText(words, x, y + high / 2); // it can be read upon a line
        context.fillText(words, x, y + high / 2);
      }
    },
    room(apart) { // of few apps all labels are written, also upon the path
      return this.rows.length > CROWD ? { apart } : { apart: 0, must: true };
    },
    numbers(of) { // of the apps, at their targets: the chosen one always, then those by which the others are found
      const rank = ({ number }) => (number === this.rows[0].number || number === this.rows.at(-1).number ? 0 : number % 10 === 0 ? 1 : number % 5 === 0 ? 2 : 3);
      const labels = [];
      for (const row of this.rows) {
        if (row !== this.chosen) share(labels, of(row.points.at(-1).slice(1)), row);
      }
      const least = (rows) => Math.min(...rows.map(rank));
      const others = labels.map(([x, y, rows]) => ({ x, y, rank: least(rows), words: MOSTS.map((most) => ranges(rows.map(({ number }) => number), most)), sort: "number", ...this.room(NUMBERS_PX) }));
      others.sort((one, other) => one.rank - other.rank);
      if (!this.chosen) return others;
      const [x, y] = of(this.chosen.points.at(-1).slice(1));
      return [{ x, y, words: [`${this.chosen.number}`], sort: "number", apart: 0, must: true, chosen: true }, ...others];
    },
    arrow(context, [x, y], force, ink) { // what the robot exerts; its tip, if it can be seen
      const [right, up] = this.directions(), newton = Math.hypot(...force);
      const way = [right, up].map((axis) => axis.reduce((sum, share, i) => sum + share * force[i], 0));
      const length = newton ? Math.min(LONGEST_PX, FORCE_PX_PER_N * newton) / newton : 0, [dx, dy] = [way[0] * length, -way[1] * length];
      const size = Math.hypot(dx, dy);
      if (size < 2) return null;
      const [ux, uy] = [dx / size, dy / size];
      context.beginPath();
      context.moveTo(x, y);
      context.lineTo(x + dx, y + dy);
      context.lineTo(x + dx - 5 * ux - 4 * uy, y + dy - 5 * uy + 4 * ux);
      context.moveTo(x + dx, y + dy);
      context.lineTo(x + dx - 5 * ux + 4 * uy, y + dy - 5 * uy - 4 * ux);
      Object.assign(context, { strokeStyle: ink, lineWidth: 1.5 });
      context.stroke();
      return [x + dx, y + dy];
    },
    frame(context, height, scale, faint) { // the base's axes, and a bar that says how long things are; the boxes of both
      const [right, up] = this.directions(), [x0, y0] = [LEGEND_PX / 2, height - LEGEND_PX / 2];
      Object.assign(context, { strokeStyle: faint, fillStyle: faint, lineWidth: 1.5 });
      AXES.forEach((name, i) => {
        const [x, y] = [x0 + 20 * right[i], y0 - 20 * up[i]];
        if (Math.hypot(right[i], up[i]) < 0.15) return;
        context.beginPath();
        context.moveTo(x0, y0);
        context.lineTo(x, y);
        context.stroke();
        context.fillText(name, x0 + 27 * right[i] - 3, y0 - 27 * up[i]);
      });
      const bar = BARS_MM.find((mm) => mm * scale <= BAR_PX) || BARS_MM.at(-1), y = height - 12;
      context.beginPath();
      context.moveTo(LEGEND_PX, y);
      context.lineTo(LEGEND_PX + bar * scale, y);
      context.stroke();
      context.fillText(`${bar} mm`, LEGEND_PX + bar * scale + 6, y);
      const words = 6 + context.measureText(`${bar} mm`).width;
      return [
        { x: 0, y: height - LEGEND_PX, width: LEGEND_PX, height: LEGEND_PX },
        { x: LEGEND_PX, y: y - 8, width: bar * scale + words, height: 16 },
      ];
    },
  },
};
