// Kinds of segment: Okabe and Ito's colours, and a pattern and a letter each, so that colour is not the only sign.
export const KINDS = {
  motion: { colour: "#56b4e9", letter: "M", pattern: null },
  steady: { colour: "#999999", letter: "S", pattern: "dots" },
  contact: { colour: "#d55e00", letter: "C", pattern: "rising" },
  sliding: { colour: "#e69f00", letter: "L", pattern: "falling" },
  transport: { colour: "#009e73", letter: "T", pattern: "rows" },
  hold: { colour: "#cc79a7", letter: "H", pattern: "columns" },
  turning: { colour: "#f0e442", letter: "R", pattern: "crossed" },
};

const TILE = 8;
const STROKES = {
  rising: [[0, TILE, TILE, 0], [-1, 1, 1, -1], [TILE - 1, TILE + 1, TILE + 1, TILE - 1]],
  falling: [[0, 0, TILE, TILE], [-1, TILE - 1, 1, TILE + 1], [TILE - 1, -1, TILE + 1, 1]],
  rows: [[0, TILE / 2, TILE, TILE / 2]],
  columns: [[TILE / 2, 0, TILE / 2, TILE]],
  crossed: [[0, 0, TILE, TILE], [0, TILE, TILE, 0]],
};
const made = new Map();

export function patternOf(context, kind) {
  const look = KINDS[kind];
  if (!look || !look.pattern) return null;
  if (!made.has(kind)) made.set(kind, context.createPattern(tile(look), "repeat"));
  return made.get(kind);
}

function tile({ colour, pattern }) {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = TILE;
  const context = canvas.getContext("2d");
  context.strokeStyle = context.fillStyle = colour;
  if (pattern === "dots") {
    context.arc(TILE / 2, TILE / 2, 1.1, 0, 7);
    context.fill();
    return canvas;
  }
  for (const [x0, y0, x1, y1] of STROKES[pattern]) {
    context.moveTo(x0, y0);
    context.lineTo(x1, y1);
  }
  context.stroke();
  return canvas;
}

export const percent = (probability) => `${Math.round(100 * probability)} %`;

// A phase has the colour of the segments that it is made of, and its name stands in it: its kind until it is given one.
const KIND_OF_PHASE = { free: "motion", contact: "contact", transport: "transport", cycle: "motion" };
export const kindOfPhase = (kind) => KIND_OF_PHASE[kind] || "steady";
export const phaseName = ([, , kind, , , strokes, name]) => {
  const what = strokes > 1 ? `${kind} × ${strokes}` : kind;
  return name ? `${name} (${what})` : what;
};
