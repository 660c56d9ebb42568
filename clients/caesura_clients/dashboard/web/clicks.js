// A double click counts once. A click that has changed something is followed by none at the same place for half a second:
// another button may stand there by then, such as Undo. What only looks, such as a zoom, takes every click.
const AGAIN_MS = 500, NEAR = 16; // pixels
const UNDER_WAY_MS = 100; // so soon after a click what it changes is asked for
let last = null, counted = null; // clicks, the latter the last one that has changed something

const isAgain = ({ clientX, clientY, timeStamp }) => counted !== null && timeStamp - counted.at < AGAIN_MS &&
  Math.hypot(clientX - counted.x, clientY - counted.y) <= NEAR;

document.addEventListener("click", (event) => {
  if (event.detail === 0) return (last = null); // of the keyboard
  if (isAgain(event)) {
    event.preventDefault();
    return event.stopPropagation();
  }
  last = { x: event.clientX, y: event.clientY, at: event.timeStamp };
}, true);

// Something is changed: by the last click, if one is under way.
export const changes = () => {
  if (last !== null && performance.now() - last.at < UNDER_WAY_MS) counted = last;
};
