// The ranges of values that the panels of a page show. Two views side by side share one range for each signal and unit.
const ROOM = 0.58, ABOVE_ZERO = 1.12; // of the extent, on both sides of its middle; of the greatest value above 0
const WIDEST = 2.5; // a held range may be so many times as wide as what is drawn

export class YScales {
  constructor() {
    this.held = new Map(); // by signal and unit: {extents: by view, range}
  }
  // view: who draws, with redraw(); low, high: of what it draws, null where that is nothing. A range stays while values
  // change a little.
  range(view, panel, low, high) {
    const key = `${panel.name} ${panel.unit}`, one = this.held.get(key) || { extents: new Map(), range: null };
    this.held.set(key, one);
    if (low === null || high === null || !isFinite(low)) one.extents.delete(view);
    else one.extents.set(view, [low, high]);
    if (!one.extents.size) return panel.zero ? [0, panel.least] : [-panel.least, panel.least];
    const found = held(one.range, panel, [...one.extents.values()]), before = one.range;
    one.range = found;
    if (before !== found) for (const other of one.extents.keys()) if (other !== view) other.redraw();
    return found;
  }
  forget(view) { // its panels are closed
    for (const [key, { extents }] of this.held) {
      extents.delete(view);
      if (!extents.size) this.held.delete(key);
    }
  }
}

function held(range, panel, extents) {
  const low = Math.min(...extents.map(([least]) => least)), high = Math.max(...extents.map(([, most]) => most));
  const room = Math.max(high - low, panel.least), middle = (low + high) / 2;
  if (range && low >= range[0] && high <= range[1] && range[1] - range[0] < WIDEST * room) return range;
  return panel.zero && low >= 0 ? [0, Math.max(high, panel.least) * ABOVE_ZERO] : [middle - room * ROOM, middle + room * ROOM];
}
