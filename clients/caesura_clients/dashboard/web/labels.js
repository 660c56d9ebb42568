// Where the labels of a drawing stand: at their anchors, inside of it, none upon another one. Of a crowd as many are
// written as leave the drawing to be seen.
const LINE_PX = 17, STEP_PX = 8, RINGS = 2, MOST = 5;
const COVERED = 40, CROSSED = 4; // so many pixels further away rather than upon a mark, or upon a point of a line
const LINES = 4; // points of lines that a label may cover, unless it has to stand: about one line
const WAYS = [[1, -1], [1, 1], [-1, -1], [-1, 1], [1, 0], [-1, 0], [0, -1], [0, 1]]; // of the text from its anchor

const overlap = (a, b) => a.x < b.x + b.width && b.x < a.x + a.width && a.y < b.y + b.height && b.y < a.y + a.height;
const inside = (box, { width, height }) => box.x >= 0 && box.y >= 0 && box.x + box.width <= width && box.y + box.height <= height;
const holds = (box, [x, y]) => x > box.x && x < box.x + box.width && y > box.y && y < box.y + box.height;
// Points in bands as high as a label, so that only those near to a box are looked at.
const banded = (points) => {
  const bands = new Map();
  for (const point of points) {
    const band = Math.floor(point[1] / LINE_PX);
    if (bands.has(band)) bands.get(band).push(point);
    else bands.set(band, [point]);
  }
  return bands;
};
const held = (box, bands) => {
  let count = 0;
  for (let band = Math.floor(box.y / LINE_PX); band <= (box.y + box.height) / LINE_PX; band += 1) {
    for (const point of bands.get(band) || []) count += holds(box, point);
  }
  return count;
};

// Boxes {x, y, width, height, anchor, one, words}, of those that have a place; wanted: {x, y, words, apart, sort, must, chosen},
// the first choose first: words are what may be written, the first that fits; apart: from the anchors of labels of the
// same sort [px]; must: it may cover the drawing. size: {width, height}; taken: boxes that hold something else; marks,
// lines: their points [x, y]; widthOf: pixels of some words, and of those of the chosen one.
export function placedLabels(wanted, size, taken, { marks, lines }, widthOf) {
  const placed = [], drawn = [marks, lines].map(banded);
  for (const one of wanted) {
    const { x, y, sort, apart, must } = one;
    if (!inside({ x, y, width: 0, height: 0 }, size)) continue;
    const isNear = (other) => other.one.sort === sort && Math.hypot(other.anchor[0] - x, other.anchor[1] - y) < apart;
    if (!must && placed.some(isNear)) continue;
    const box = one.words.reduce((found, words) => found || best({ ...one, words }, widthOf(words, one.chosen), [...taken, ...placed]), null);
    if (box) placed.push({ ...box, one });
  }
  return placed;

  function best({ x, y, words, must }, width, others) {
    let found = null, least = Infinity;
    for (let away = STEP_PX; away <= (must ? 2 : 1) * RINGS * STEP_PX && away < least; away += STEP_PX) {
      for (const [right, down] of WAYS) {
        const box = {
          x: x + right * away + (right - 1) * width / 2,
          y: y + down * away + (down - 1) * LINE_PX / 2,
          width, height: LINE_PX, words, anchor: [x, y],
        };
        if (!inside(box, size) || others.some((other) => overlap(box, other))) continue;
        const [upon, across] = drawn.map((points) => held(box, points));
        const cost = away + COVERED * upon + CROSSED * across;
        if ((must || (!upon && across <= LINES)) && cost < least) [found, least] = [box, cost];
      }
    }
    return found;
  }
}

// The least and the greatest of some sizes in words: 12.0–17.3.
export function span(sizes) {
  const ends = [Math.min(...sizes), Math.max(...sizes)].map((size) => size.toFixed(1));
  return [...new Set(ends)].join("–");
}

// Whole numbers in words, those that follow each other as a range: 1, 3–6; of many the first ones.
export function ranges(numbers, most = MOST) {
  const found = [];
  for (const number of numbers) {
    const last = found.at(-1);
    if (last && number === last[1] + 1) last[1] = number;
    else found.push([number, number]);
  }
  const words = found.map(([first, last]) => first === last ? first : `${first}${last === first + 1 ? ", " : "–"}${last}`);
  return words.length > most ? `${words.slice(0, most).join(", ")}, …` : words.join(", ");
}
