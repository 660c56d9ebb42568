// A double click presses one button. Where a click has changed something, another button may stand at its place at once,
// such as Restore in the place of Delete: for half a second a click there is none. A second click on the same button counts.
const AGAIN_MS = 500, NEAR = 16; // pixels
const UNDER_WAY_MS = 100; // so soon after a click what it changes is asked for
let last = null, counted = null; // clicks, the latter the last one that has changed something

const labelOf = ({ target }) => target.closest?.("button, summary, a")?.textContent.trim() ?? null;

const isAnother = (event) => counted !== null && event.timeStamp - counted.at < AGAIN_MS &&
  Math.hypot(event.clientX - counted.x, event.clientY - counted.y) <= NEAR && ![null, counted.label].includes(labelOf(event));

document.addEventListener("click", (event) => {
  if (event.detail === 0) return (last = null); // of the keyboard
  if (isAnother(event)) {
    event.preventDefault();
    return event.stopPropagation();
  }
  last = { x: event.clientX, y: event.clientY, at: event.timeStamp, label: labelOf(event) };
}, true);

// Something is changed: by the last click, if one is under way.
export const changes = () => {
  if (last !== null && performance.now() - last.at < UNDER_WAY_MS) counted = last;
};
