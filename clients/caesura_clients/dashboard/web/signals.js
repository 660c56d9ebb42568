// Which signals there are, and their points: fetched for a range of time at the width of the plots, and never made up.
export const PANELS = [
  { name: "position", title: "position from the start", unit: "mm", factor: 1000, columns: ["px", "py", "pz"], least: 0.02, fromStart: true, digits: 1 },
  { name: "speed", title: "speed", unit: "mm/s", factor: 1000, columns: ["speed"], least: 0.05, zero: true, digits: 0 },
  { name: "force", title: "force", unit: "N", columns: ["fx", "fy", "fz"], least: 2, tared: true, digits: 2 },
  { name: "torque", title: "torque as measured", unit: "Nm", columns: ["mx", "my", "mz"], least: 0.2, digits: 3 },
  { name: "orientation", title: "orientation from the start", unit: "°", factor: 180 / Math.PI, columns: ["rotation_x", "rotation_y", "rotation_z"], least: 0.1, wraps: true, digits: 1 },
  { name: "joints", title: "joints", unit: "rad", columns: ["q1", "q2", "q3", "q4", "q5", "q6", "q7", "q8"], anyOf: true, least: 0.1, digits: 3 },
  { name: "joint torques", title: "external joint torques", unit: "Nm", columns: ["tau1", "tau2", "tau3", "tau4", "tau5", "tau6", "tau7", "tau8"], anyOf: true, least: 1, digits: 2 },
  { name: "gripper", title: "gripper", unit: "mm", factor: 1000, columns: ["gripper"], least: 0.01, zero: true, digits: 1 },
  { name: "load", title: "load as inferred", unit: "kg", columns: ["load"], least: 0.2, zero: true, inferred: true, digits: 3 },
  { name: "changepoints", title: "probability of a changepoint", unit: "", columns: ["probability"], inferred: true, digits: 2 },
];
// A panel with the columns that this arm has: not every one has seven joints.
export const ofArm = (panel, available) => (panel.anyOf ? { ...panel, columns: panel.columns.filter((name) => available.includes(name)) } : panel);
// The column of a gripper is its opening, or a flag that is 1 while it is closed. Only zeros leave that open.
export const ofGripper = (panel, greatest) => {
  if (greatest === 0) return { ...panel, unit: "mm, or 1 closed" };
  return greatest === 1 ? { ...panel, unit: "1 closed", factor: 1, digits: 0 } : panel;
};
export const greatest = (points = []) => points.reduce((most, value, i) => (i % 2 ? Math.max(most, value) : most), 0);
export const SHOWN_AT_FIRST = ["position", "speed", "force", "joints"];
const NAMES = { px: "x", py: "y", pz: "z", fx: "x", fy: "y", fz: "z", mx: "x", my: "y", mz: "z", rotation_x: "x", rotation_y: "y", rotation_z: "z" };
export const nameOf = (column) => NAMES[column] || column;
const MAX_BINS = 4096;
const RING = "dashboard"; // who answers for the newest minute of a station, in bins of one width
const ROUNDING = 1e-6; // of a bin, as of `bins_of`
const bin = (t, bin_s) => Math.floor(t / bin_s + ROUNDING);

// exact: samples of the journal in such bins, also where the newest minute is held in others.
// What there is of a range: {from, to, points: {column: Float64Array of t, v, t, v, …}, holes, available, first, last}.
export async function load(station, session, { from, to, bins, columns, exact }, abort) {
  const query = new URLSearchParams({ from, to, bins: Math.min(Math.max(Math.ceil(bins), 1), MAX_BINS) });
  if (columns.length) query.set("columns", columns.join(","));
  if (exact) query.set("exact", "1");
  const answer = await fetch(`/samples/${station}/${session}?${query}`, { signal: abort }).catch(() => {
    throw new Error("the dashboard does not answer"); // each browser has other words
  });
  if (!answer.ok) throw new Error(await answer.text());
  const bytes = await answer.arrayBuffer();
  const length = new DataView(bytes).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 4, length)));
  const points = {};
  let at = 4 + length;
  header.columns.forEach((name, i) => {
    points[name] = new Float64Array(bytes, at, 2 * header.counts[i]);
    at += points[name].byteLength;
  });
  return { ...header, from, to, points };
}

// [s] From where on points have to be asked for that go on with those held: the beginning of the last bin, which was
// not complete. null: everything has to be asked for.
export function reach(held, { from, to, shown, session }) {
  if (!held || held.instance !== RING || held.session !== session || held.shown !== shown) return null;
  const t = bin(Math.min(held.last, held.to), held.bin_s) * held.bin_s;
  return from >= held.from && from < t && t < to ? t : null;
}

// The points held up to t and those found from t on, without those before `from`: what one answer for the whole range
// has. null where they do not go on with each other.
export function continued(held, found, from, t) {
  const isSame = found.instance === RING && found.bin_s === held.bin_s && found.columns.join() === held.columns.join();
  if (!isSame) return null;
  const points = {};
  for (const name of held.columns) {
    const before = held.points[name], first = bin(from, held.bin_s), end = bin(t, held.bin_s);
    let [i, j] = [0, before.length];
    while (i < j && bin(before[i], held.bin_s) < first) i += 2;
    while (j > i && bin(before[j - 2], held.bin_s) >= end) j -= 2;
    points[name] = new Float64Array(j - i + found.points[name].length);
    points[name].set(before.subarray(i, j));
    points[name].set(found.points[name], j - i);
  }
  const holes = [...held.holes.filter(([, tn]) => tn > from && tn <= t), ...found.holes];
  return { ...found, points, holes };
}

// One axis of time for all columns of a panel, as uPlot wants it: undefined where another column has a point, and
// null in a hole, across which no line is drawn. off: what is taken off each column.
export function aligned(points, columns, holes, off = []) {
  const middles = holes.map(([t0, tn]) => (t0 + tn) / 2);
  const all = new Float64Array(columns.reduce((sum, name) => sum + points[name].length / 2, middles.length));
  let count = 0;
  for (const name of columns) for (let i = 0; i < points[name].length; i += 2) all[count++] = points[name][i];
  for (const t of middles) all[count++] = t;
  all.sort();
  const times = all.filter((t, i) => i === 0 || t !== all[i - 1]);
  const isHole = new Set(middles);
  const values = columns.map((name, k) => {
    const own = points[name], less = off[k] || 0;
    let i = 0;
    return Array.from(times, (t) => {
      if (own[i] === t) {
        i += 2;
        return own[i - 1] - less;
      }
      return isHole.has(t) ? null : undefined;
    });
  });
  return [times, ...values];
}

// Where a rotation vector jumps from one end of a half turn to the other, as holes: no line is drawn across. Of a bin
// with a jump the least and the greatest differ by more than a half turn in one column at least, however far apart.
export function wraps(points, columns) {
  return columns.flatMap((name) => {
    const own = points[name], found = [];
    for (let i = 3; i < own.length; i += 2) {
      if (Math.abs(own[i] - own[i - 2]) > Math.PI) found.push([own[i - 3], own[i - 1]]);
    }
    return found;
  });
}

// The point of a column that is nearest to a time; null where that time lies in a hole or outside of the samples.
export function nearest(points, t, holes, reach) {
  if (!points || !points.length || holes.some(([t0, tn]) => t > t0 && t < tn)) return null;
  let low = 0, high = points.length / 2 - 1;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (points[2 * middle] < t) low = middle + 1;
    else high = middle;
  }
  const after = 2 * low, before = Math.max(after - 2, 0);
  const at = Math.abs(points[before] - t) < Math.abs(points[after] - t) ? before : after;
  return Math.abs(points[at] - t) <= reach ? [points[at], points[at + 1]] : null;
}
