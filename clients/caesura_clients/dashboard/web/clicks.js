// A double click presses one button. Where a click has changed something, another button may stand at its place at once,
// such as Restore in the place of Delete: for half a second a click there presses none. The same button, pressed again,
// would do it again, such as Copy, or take it back, such as Yes. Only one of class `repeats` counts twice, such as Undo,
// and Stop, which names what it ends.
const AGAIN_MS = 500, NEAR = 16; // pixels
const UNDER_WAY_MS = 100; // so soon after a click is handled what it changes is asked for
let last = null, counted = null; // clicks, the latter the last one that has changed something

const buttonOf = ({ target }) => target.closest?.("button, summary, a") ?? null;
const labelOf = (button) => button.textContent.trim();

const isAnother = (event) => {
  if (counted === null || event.timeStamp - counted.at >= AGAIN_MS) return false;
  if (Math.hypot(event.clientX - counted.x, event.clientY - counted.y) > NEAR) return false;
  const button = buttonOf(event);
  if (button === null) return false;
  return !(button === counted.button && button.matches(".repeats") && labelOf(button) === counted.label);
};

document.addEventListener("click", (event) => {
  if (event.detail === 0) return (last = null); // of the keyboard
  if (isAnother(event)) {
    event.preventDefault();
    return event.stopPropagation();
  }
  const button = buttonOf(event);
  last = { x: event.clientX, y: event.clientY, at: event.timeStamp, handledAt: performance.now(), button, label: button && labelOf(button) };
}, true);

// A key that is held down repeats itself: once it has changed something, it does nothing more until it is pressed anew.
let isHeld = false;

document.addEventListener("keydown", (event) => {
  if (!event.repeat) return (isHeld = false);
  if (!isHeld) return;
  event.preventDefault();
  event.stopPropagation();
}, true);

// Something is changed: by the last click, if one is under way, or by a key that is held.
export const changes = () => {
  if (last !== null && performance.now() - last.handledAt < UNDER_WAY_MS) counted = last;
  isHeld = true;
};
