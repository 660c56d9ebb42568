// A recording is dropped or chosen, sent, looked at; what it leaves open is a form; then it is played as a session.
import { storedAuthor } from "caesura-dashboard/author.js";
import { live } from "caesura-dashboard/live.js";

const ANSWERS = "caesura-recording-answers";
const WORDS = {
  t: "time", pos: "flange position", quat: "flange orientation", rotation_vector: "orientation as axis times angle",
  roll_pitch_yaw: "orientation as roll, pitch, yaw", q: "joints", force: "force", torque: "moment",
  tau: "external joint torques", gripper: "gripper opening",
};
const HANDS = { yes: "yes", no: "no: replayed or remote", unknown: "not known" };
const STATED = ["wrench_source", "hand_on_robot", "force_frame", "robot", "up"]; // by a file, which goes before what is remembered
const newUpload = () => `u-${Date.now().toString(36)}-${Math.random().toString(36).slice(2, 12)}`;
const remembered = () => {
  try {
    return JSON.parse(localStorage.getItem(ANSWERS)) || {};
  } catch {
    return {};
  }
};

// Files of what was dropped, with their paths: a rosbag2 is a folder.
async function filesOf(entry, path = "") {
  if (entry.isFile) {
    const file = await new Promise((done, fail) => entry.file(done, fail));
    return [[path + file.name, file]];
  }
  const reader = entry.createReader(), found = [];
  for (;;) {
    const some = await new Promise((done, fail) => reader.readEntries(done, fail));
    if (!some.length) break;
    for (const one of some) found.push(...(await filesOf(one, `${path}${entry.name}/`)));
  }
  return found;
}

function send(url, file, progress) {
  return new Promise((done, fail) => {
    const request = new XMLHttpRequest();
    request.open("PUT", url);
    request.upload.onprogress = (event) => progress(event.loaded);
    request.onload = () => (request.status < 300 ? done() : fail(new Error(request.responseText || `The dashboard answered ${request.status}.`)));
    request.onerror = () => fail(new Error("The dashboard cannot be reached."));
    request.send(file);
  });
}

export default {
  mixins: [live],
  props: {
    suffixes: Array, megabytes: Number, columns: Object, units: Object, quantities: Object, sources: Object, hands: Array,
    frames: Array, robots: Array, station: String,
  },
  emits: ["ask"],
  data: () => ({
    played: null, plays: [], stations: [], trouble: "", over: false, state: "idle", sent: 0, message: "", failed: false, found: null,
    form: {}, chosen: {}, chosenUnits: {}, declared: {}, more: false, words: WORDS, handWords: HANDS,
  }),
  template: `
    <div class="recordings">
      <div role="alert"><p v-if="trouble" class="banner">{{ trouble }}</p></div>
      <section class="drop" :class="{ over }" aria-label="Drop a recording" @dragover.prevent="over = true" @dragleave="over = false"
        @drop.prevent="dropped">
        <p><strong>Drop a recording here</strong>: npz, csv, MCAP, or the folder of a rosbag2; at most {{ megabytes }} MB.</p>
        <label class="button choose-file">Choose a file <input class="file" type="file" :accept="suffixes.join(',')" @change="picked"></label>
        <progress v-if="state === 'sending'" :value="sent" max="1" aria-label="Sent"></progress>
      </section>
      <form v-if="found" class="questions" @submit.prevent="play" aria-label="Questions about the recording">
        <h2>{{ found.name }}</h2>
        <p v-if="found.samples" class="summary">{{ found.samples }} {{ found.samples === 1 ? "sample" : "samples" }}, {{ found.length }} s: {{ found.signals.map((one) => words[one]).join(", ") }}{{
          found.ignored.length ? "; not read: " + found.ignored.join(", ") : "" }}.</p>
        <p v-for="note in found.notes" :key="note" class="recording-note">{{ note }}</p>
        <p v-if="found.wrong" class="alarm">{{ found.wrong }} The likely unit is chosen below.</p>
        <template v-if="found.header">
          <div class="scroll" tabindex="0" role="region" aria-label="First rows"><table><thead><tr>
            <th v-for="name in found.header" :key="name" scope="col">{{ name }}</th></tr></thead>
            <tbody><tr v-for="(row, i) in found.rows" :key="i"><td v-for="(cell, k) in row" :key="k">{{ cell }}</td></tr></tbody></table></div>
          <div class="columns"><fieldset v-for="signal in signals" :key="signal"><legend>{{ words[signal] }}</legend>
            <label v-for="column in columns[signal]" :key="column">{{ column }}
              <select :class="'column-' + column" v-model="chosen[column]" :required="column === 't'"><option value="">–</option>
                <option v-for="name in found.header" :key="name" :value="name">{{ name }}</option></select></label>
            <label v-if="units[signal].length > 1">unit <select :class="'unit-' + signal" v-model="chosenUnits[signal]">
              <option v-for="unit in units[signal]" :key="unit">{{ unit }}</option></select></label>
          </fieldset></div>
          <button type="button" class="more" :aria-pressed="String(more)" @click="more = !more">Orientation, joints, moments</button>
          <p v-if="notRead.length" class="not-read">Not read: {{ notRead.join(", ") }}.</p>
        </template>
        <fieldset v-else><legend>units</legend>
          <label v-for="(known, quantity) in quantities" :key="quantity">{{ quantity }}
            <select :class="'declared-' + quantity" v-model="declared[quantity]"><option value="">as in the file</option>
              <option v-for="unit in known" :key="unit">{{ unit }}</option></select></label>
        </fieldset>
        <fieldset><legend>wrench, hand and robot</legend>
          <label v-if="hasWrench" class="wide">Where was the wrench measured?
            <select class="wrench-source" v-model="form.wrench_source" required><option value="" disabled>choose</option>
              <option v-for="(said, one) in sources" :key="one" :value="one">{{ one }}: {{ said }}</option></select></label>
          <label>Was it guided by hand? <select class="hand" v-model="form.hand_on_robot">
            <option v-for="one in hands" :key="one" :value="one">{{ handWords[one] }}</option></select></label>
          <label v-if="found.header && hasWrench">Whose force is it? <select class="force-of" v-model="form.force_of">
            <option value="environment">the environment's on the robot: up while it presses on a table</option>
            <option value="robot">the robot's on the environment: down while it presses on a table</option></select></label>
          <label v-if="(found.header || found.bag || !found.stated.force_frame) && hasWrench">Its frame <select class="frame" v-model="form.force_frame">
            <option v-if="!found.header" value="">{{ found.bag ? "as in the bag" : "not stated: base is assumed" }}</option>
            <option v-for="one in frames" :key="one">{{ one }}</option></select></label>
          <label>Robot <select class="robot" v-model="form.robot"><option value="">another, or as in the file</option>
            <option v-for="one in robots" :key="one">{{ one }}</option></select></label>
          <label>Up, in its base frame <input class="up" v-model.trim="form.up" list="mountings" placeholder="z, or as in the file" maxlength="10000"></label>
          <datalist id="mountings"><option value="z">on a table</option><option value="-z">from a ceiling</option>
            <option v-for="one in ['x', '-x', 'y', '-y']" :key="one" :value="one">on a wall</option></datalist>
        </fieldset>
        <fieldset><legend>as a session</legend>
          <label>Station <input class="station" v-model="form.station" required pattern="[a-z0-9][a-z0-9_\\-]{0,63}" list="known-stations"></label>
          <datalist id="known-stations"><option v-for="one in stations" :key="one" :value="one"></option></datalist>
          <label>Session <input class="session" v-model="form.session" required pattern="[a-z0-9][a-z0-9_\\-]{0,63}"></label>
          <label class="wide">Task <input class="task" v-model="form.task" maxlength="10000" placeholder="optional"></label>
        </fieldset>
        <label class="check"><input class="sure" type="checkbox" v-model="form.sure"> The units are right, even where values look implausible</label>
        <p><button ref="play" class="play-recording large" type="submit" :aria-disabled="Boolean(state !== 'form')">Play</button>
          <button type="button" class="forget" @click="forget">Cancel</button></p>
      </form>
      <p class="drop-state" role="status" :class="{ failed }">{{ shownState }}</p>
      <section v-if="plays.length" aria-label="Played"><h2>Played</h2>
        <ul class="plays"><li v-for="one in plays" :key="one.station + '/' + one.session">
          <a v-if="one.opened" :href="'/sessions/' + one.station + '/' + one.session">{{ one.station }}/{{ one.session }}</a>
          <span v-else>{{ one.station }}/{{ one.session }}</span> {{ one.name }}
          <progress v-if="!one.done && !one.error" :value="one.share" max="1" :aria-label="'Played of ' + one.name"></progress>
          <span class="play-state" :class="{ alarm: one.error }">{{ one.error || (one.done ? "done" : Math.round(100 * one.share) + " %") }}</span>
          <p v-if="one.warning" class="alarm">{{ one.warning }}</p>
          <details v-if="one.mapping"><summary>Mapping for the next time</summary><pre>{{ one.mapping }}</pre></details>
        </li></ul>
      </section>
    </div>`,
  computed: {
    signals() {
      const always = ["t", "pos", "force", "gripper"], shown = Object.keys(this.columns);
      return shown.filter((one) => always.includes(one) || this.more || this.columns[one].some((column) => this.found.guess.columns[column]));
    },
    hasWrench() {
      return this.found.header ? this.columns.force.some((one) => this.chosen[one]) || !!this.chosen.tau1 : this.found.hasWrench;
    },
    notRead() { // columns of a csv that nothing is chosen for
      const read = Object.values(this.chosen);
      return this.found.header.filter((name) => !read.includes(name));
    },
    shownState() {
      const states = { sending: `Sending: ${Math.round(100 * this.sent)} %`, looking: "Reading …", asking: "Starting …" };
      states.form = "Answer the questions about the recording, then press Play.";
      return this.message || states[this.state] || "";
    },
  },
  methods: {
    apply({ plays, stations, trouble }) {
      Object.assign(this, { plays, stations, trouble });
      const refused = this.played && plays.find((one) => one.upload === this.upload && one.error);
      if (refused) { // its answers can be changed
        Object.assign(this, { found: this.played, played: null, state: "form", message: refused.error, failed: true });
        const { activeElement } = document, wasPassed = activeElement === document.body || activeElement.matches(".file"); // with the form
        if (wasPassed) this.$nextTick(() => this.$refs.play.focus());
      }
    },
    async dropped(event) {
      this.over = false;
      const entries = [...event.dataTransfer.items].map((one) => one.webkitGetAsEntry && one.webkitGetAsEntry()).filter(Boolean);
      const files = entries.length ? (await Promise.all(entries.map((one) => filesOf(one)))).flat() : [...event.dataTransfer.files].map((one) => [one.name, one]);
      this.sendAll(files);
    },
    picked(event) {
      this.sendAll([...event.target.files].map((one) => [one.name, one]));
      event.target.value = "";
    },
    async sendAll(files) {
      if (!files.length || ["sending", "looking"].includes(this.state)) return;
      const all = files.reduce((sum, [, file]) => sum + file.size, 0);
      if (all > this.megabytes * 1048576) {
        return this.answered(`${(all / 1048576).toFixed(0)} MB, at most ${this.megabytes} MB: play it with caesura bridge --file.`, true);
      }
      this.coming = newUpload(); // until it has been looked at, the form of the one before stays
      Object.assign(this, { state: "sending", played: null, sent: 0, message: "", failed: false });
      let before = 0;
      try {
        for (const [path, file] of files) {
          await send(`/uploads/${this.coming}/${path.split("/").map(encodeURIComponent).join("/")}`, file, (now) => { this.sent = (before + now) / Math.max(all, 1); });
          before += file.size;
        }
      } catch (error) {
        this.$emit("ask", { do: "drop", upload: this.coming });
        return this.answered(error.message, true);
      }
      this.state = "looking";
      this.$emit("ask", { do: "look", upload: this.coming });
    },
    looked(found) {
      if (found.upload !== this.coming) return;
      this.forget();
      this.upload = found.upload;
      const stated = found.stated || {}, key = (found.header || []).join("|");
      const old = (found.header && remembered()[key]) || {}; // of the last file with these columns
      const guess = found.guess || { columns: {}, units: {} };
      const units = Object.fromEntries(Object.entries(this.units).map(([signal, known]) => [signal, known[0]]));
      Object.assign(this, {
        found, state: "form", message: "", more: false,
        chosen: { ...Object.fromEntries(Object.values(this.columns).flat().map((one) => [one, ""])), ...guess.columns, ...old.columns },
        chosenUnits: { ...units, ...guess.units, ...old.units },
        declared: { ...Object.fromEntries(Object.keys(this.quantities).map((one) => [one, ""])), ...found.likely },
        form: {
          wrench_source: stated.wrench_source || "", hand_on_robot: stated.hand_on_robot || "unknown", force_frame: stated.force_frame || (found.header ? "base" : ""),
          force_of: "environment", robot: stated.robot || "", up: stated.up || "", ...old.form,
          ...Object.fromEntries(STATED.filter((one) => stated[one]).map((one) => [one, stated[one]])), station: this.station, session: found.session, task: "", sure: false,
        },
      });
    },
    play() {
      const { station, session, task, sure, ...form } = this.form, filled = (table) => Object.fromEntries(Object.entries(table).filter(([, value]) => value));
      const columns = this.found.header ? filled(this.chosen) : {};
      const units = this.found.header ? filled(this.chosenUnits) : {};
      if (this.found.header) {
        const key = this.found.header.join("|");
        localStorage.setItem(ANSWERS, JSON.stringify({ [key]: { columns, units, form } }));
      }
      const answers = {
        ...form, force_frame: form.force_frame || null, wrench_source: this.hasWrench ? form.wrench_source || null : null, robot: form.robot || null, up: form.up || null, columns, units, sure,
        declared: this.found.header ? {} : filled(this.declared), delimiter: this.found.delimiter || ",", decimal: this.found.decimal || ".",
      };
      const operator = storedAuthor();
      Object.assign(this, { state: "asking", message: "", failed: false });
      this.$emit("ask", { do: "play", upload: this.upload, station, session, task: task.trim(), operator, answers });
    },
    forget() {
      if (this.found) this.$emit("ask", { do: "drop", upload: this.upload });
      Object.assign(this, { found: null, played: null, state: this.state === "form" ? "idle" : this.state, message: "" });
    },
    answered(message, failed) {
      const state = this.found && failed ? "form" : "idle";
      if (!failed) this.played = this.found;
      Object.assign(this, { message, failed, state, found: failed ? this.found : null });
    },
  },
};
