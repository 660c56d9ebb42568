// What the session view consists of. Tab goes through it from the top: signals, corrections, plot, time, table.
const legend = `
  <ul v-if="session" class="legend" :aria-label="sided('Legend')">
    <li v-for="(look, name) in kinds" :key="name"><i class="swatch" :class="'kind-' + name"></i>{{ name }}</li>
    <li><i class="stroke stroke-final"></i>final</li>
    <li><i class="stroke stroke-provisional"></i>provisional</li>
  </ul>`;

const correcting = `
  <div v-if="!linked" class="at-time" :class="{ quiet: !trouble && !doubt && (inList || !message), chosen: cursor !== null }"><div class="at-time-box">
    <p class="selection" role="status" :aria-live="playing ? 'off' : 'polite'" :title="selection">{{ selection }}</p>
    <template v-if="editable">
      <button v-if="cursor !== null" class="correct" :title="'What can be corrected at this time (R, or ' + opens + ')'" @click="openMenu()">Correct …</button>
      <button class="undo repeats" :class="{ absent: !canUndo }" :disabled="!canUndo" :title="undoTitle" v-on="pointing(undoAction)" @click="undo">Undo</button>
      <button class="redo repeats" :class="{ absent: !canRedo }" :disabled="!canRedo" title="Redo what was undone last (Ctrl Y)" v-on="pointing(redoAction)" @click="redo">Redo</button>
    </template>
    <staying class="message" :class="{ failed: failed || trouble }">{{ trouble || (inList ? "" : message) }}<span v-if="doubt" class="doubt">{{ " " + doubt }}</span></staying>
  </div></div>
  <p v-if="!editable && !linked" class="empty only-read">{{ why }}</p>`;

const floating = `
  <correct-menu v-if="menu && cursor !== null" v-bind="menu" :t="cursor" :start="start" :begin="begin" :newest="newest" :selected="selected" :segment="segmentAtCursor" :phase="phaseAtCursor" :kinds="kinds" :author="author" :effect="effect"
    @edit="chosenInMenu" @close="closeMenu" @leave="leaveMenu" @rename="rename" @time="goto"
    @preview="(action) => preview(action, 'menu')"></correct-menu>
  <p v-if="pointedInBand && !menu" class="band-tip" :style="bandStyle" aria-hidden="true">{{ bandWords }}</p>
  <effect-words v-if="effectAt === 'tip' && (effect || ghost !== null)" class="effect-tip" :style="tipStyle" :effect="effect"
    :more="effect && !effect.waits ? '' : dragWords"></effect-words>
  <form v-if="asked" class="who" aria-label="Who corrects" @submit.prevent="name" @keydown.esc.stop="leaveName">
    <label>Your name <input ref="author" class="author" v-model="draft" maxlength="10000" autocomplete="name" required></label>
    <button class="save-name">{{ asked.do ? "Correct" : "Save" }}</button><button type="button" @click="leaveName">Cancel</button>
    <p>It stands at each of your corrections. This browser keeps it.</p>
  </form>`;

const signals = `
  <div v-if="session" class="signals" :class="{ absent: !available.length }" role="group" :aria-label="sided('Signals')"><span>Signals</span>
    <button v-for="one in offered" :key="one.name" :aria-pressed="String(chosen.includes(one.name))" :aria-label="sided(one.name)" @click="toggle(one.name)">{{ one.name }}</button>
    <button class="run-lengths" :aria-label="sided('run lengths')" :aria-pressed="String(columns !== null)" @click="toggleRunLengths">run lengths</button>
  </div>`;

const time = `
  <div v-if="session" class="scrub">
    <button class="play" :disabled="!replay && !closed" :title="replay || closed ? null : 'Once the demonstration is over'" :aria-label="sided(playing ? 'Pause' : 'Play')" @click="play">{{ playing ? "Pause" : "Play" }}</button>
    <label class="slider">Show until <input type="range" :min="begin" :max="latest().toFixed(1)" step="0.1" :value="shownEnd"
      :aria-label="sided('Show until')" :aria-valuetext="shownTime(shownEnd, 1) + ' seconds'" @input="scrub"></label>
    <output aria-live="off">{{ shownTime(Math.min(shownEnd, newest), 1) }} of {{ shownTime(newest, 1) }} s</output>
    <span class="moves" role="group" :aria-label="sided('Range of time')">
      <button :aria-label="sided('Earlier')" @click="pan(-0.5)">◀</button><button :aria-label="sided('Later')" @click="pan(0.5)">▶</button>
      <button :aria-label="sided('Zoom in')" @click="zoom(0.5)">+</button><button :aria-label="sided('Zoom out')" @click="zoom(2)">−</button>
      <button :aria-label="sided('All')" @click="all">All</button>
      <button class="follow" :aria-pressed="String(end === null)" :aria-label="sided(closed ? 'End' : 'Live')" @click="follow">{{ closed ? "End" : "Live" }}</button></span>
  </div>`;

const corrections = `
  <corrections v-if="!linked && session" :rows="corrections" :revision="revision" :editable="editable" :busy="busy" :message="inList ? message : ''" :failed="failed"
    :effect="effectAt === 'list' ? effect : null" @edit="edit" @preview="(action) => preview(action, 'list')"></corrections>`;

const table = `
  <details v-if="session" class="table" @toggle="listed = $event.target.open"><summary :aria-label="sided('Segments as a table')">Segments as a table</summary>
    <div v-if="listed" class="scroll" tabindex="0" role="region" :aria-label="sided('Segments as a table')"><table><thead><tr><th scope="col">from</th><th scope="col">to</th><th scope="col">kind</th><th scope="col">probability</th>
      <th scope="col">else</th><th scope="col">state</th><th scope="col">select</th></tr></thead>
    <tbody><tr v-for="one in newestFirst" :key="one[0]">
      <td>{{ shownTime(one[0]) }} s</td><td>{{ shownTime(one[1]) }} s</td>
      <td><i class="swatch" :class="'kind-' + one[2]"></i>{{ one[2] }}</td><td>{{ percent(one[3]) }}</td>
      <td>{{ one[6] || "–" }}</td><td>{{ one[5] ? "corrected" : one[4] ? "final" : "provisional" }}</td>
      <td><button @click="choose(one)" :aria-label="sided('select the segment from ' + shownTime(one[0]) + ' s')">select</button></td>
    </tr></tbody></table></div>
  </details>`;

export const template = `
  <section class="session-view" :aria-label="linked ? null : 'Signals and segments'">
    ${signals}
    ${correcting}
    <p v-if="linked && trouble" class="trouble" role="status">{{ trouble }}</p>
    <div v-show="session" class="plots-frame">
    <div ref="plots" class="plots" :class="{ takes: canTake }" tabindex="0" role="application" :aria-describedby="linked ? null : 'plot-help'"
      :aria-label="sided('Signals against time, with segments and changepoints')" @pointerdown="pressed" @pointermove="dragged"
      @pointerup="released" @pointercancel="released" @pointerleave="pointedInBand = null" @touchend="lifted" @wheel.prevent="wheeled" @keydown="key"
      @contextmenu="pointedAt">
      <canvas ref="band" class="band"></canvas>
      <div ref="panels" class="panels" :style="{ '--count': chosen.length }"></div>
      <div v-show="columns !== null" class="panel run-lengths-panel"><p class="panel-title"><strong>run length [s]</strong></p>
        <canvas ref="lengths" class="lengths"></canvas></div>
      <i v-if="marked" class="marked" :style="markedStyle"></i>
    </div>
    ${floating}
    </div>
    ${time}
    ${legend}
    ${corrections}
    <details v-if="!linked && session" class="help"><summary>Keys and pointer</summary>
    <p id="plot-help">In the plot: ← → move the time (⇧ by 1 s), Page ↑ ↓ go from changepoint to changepoint,
      Enter inserts, Delete removes, M moves the selected one to the time, R or a right click shows what can be corrected there,
      Ctrl Z and Ctrl Y undo and redo, L follows. + and − zoom, comma and full stop go back and forth, 0 shows everything. The
      wheel zooms; a drag marks the range to zoom to, with ⇧ it moves the view, and from a changepoint it moves that. A finger
      moves the view, and a long press corrects.</p></details>
    ${table}
  </section>`;
