// Where the labels of a drawing stand: inside of it, none upon another one, off the marks where there is room.
const LINE_PX = 17, STEP_PX = 8, RINGS = 4, COVERED = 40, MOST = 5; // COVERED: so many pixels further away rather than upon a mark
const WAYS = [[1, -1], [1, 1], [-1, -1], [-1, 1], [1, 0], [-1, 0], [0, -1], [0, 1]]; // of the text from its anchor

const overlap = (a, b) => a.x < b.x + b.width && b.x < a.x + a.width && a.y < b.y + b.height && b.y < a.y + a.height;
const inside = (box, { width, height }) => box.x >= 0 && box.y >= 0 && box.x + box.width <= width && box.y + box.height <= height;
const holds = (box, [x, y]) => x > box.x && x < box.x + box.width && y > box.y && y < box.y + box.height;

// Boxes {x, y, width, height, words, anchor}, of those that have a place; wanted: [x, y, words], the first choose first.
// size: {width, height}; taken: boxes that hold something else; marks: [x, y]; widthOf: pixels of some words.
export function placedLabels(wanted, size, taken, marks, widthOf) {
  const placed = [];
  for (const [x, y, words] of wanted) {
    if (!inside({ x, y, width: 0, height: 0 }, size)) continue;
    const width = widthOf(words);
    let best = null, least = Infinity;
    for (let away = STEP_PX; away <= RINGS * STEP_PX && away < least; away += STEP_PX) {
      for (const [right, down] of WAYS) {
        const box = {
          x: x + right * away + (right - 1) * width / 2,
          y: y + down * away + (down - 1) * LINE_PX / 2,
          width, height: LINE_PX, words, anchor: [x, y],
        };
        if (!inside(box, size) || [...taken, ...placed].some((other) => overlap(box, other))) continue;
        const cost = away + COVERED * marks.filter((mark) => holds(box, mark)).length;
        if (cost < least) [best, least] = [box, cost];
      }
    }
    if (best) placed.push(best);
  }
  return placed;
}

// The least and the greatest of some sizes in words: 12.0–17.3.
export function span(sizes) {
  const ends = [Math.min(...sizes), Math.max(...sizes)].map((size) => size.toFixed(1));
  return [...new Set(ends)].join("–");
}

// Whole numbers in words, those that follow each other as a range: 1, 3–6; of many the first ones.
export function ranges(numbers) {
  const found = [];
  for (const number of numbers) {
    const last = found.at(-1);
    if (last && number === last[1] + 1) last[1] = number;
    else found.push([number, number]);
  }
  const words = found.map(([first, last]) => first === last ? first : `${first}${last === first + 1 ? ", " : "–"}${last}`);
  return words.length > MOST ? `${words.slice(0, MOST).join(", ")}, …` : words.join(", ");
}
