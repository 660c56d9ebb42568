// The keys go on where they were. A button that cannot be pressed now is `aria-disabled`: it keeps the focus, and a click
// on it does nothing. What has the focus and goes, such as Delete with its app, leaves it to what follows in the same list.
const FOCUSABLE = "a[href], button, input, select, textarea, summary, [tabindex='0']";
const SETTLES_MS = 50; // until then a page that changes may set the focus itself
const AGAIN_MS = 500; // a second press is meant for what is gone, as in clicks.js
let held = null, around = [], others = [], due = 0; // held: what has the focus; around: what contains it; others: on the page
let passed = null, passedAt = 0; // to what the focus was passed on, and when [ms]

export const isUsable = (one) => one !== null && one.isConnected && !one.disabled && one.checkVisibility({ visibilityProperty: true });

export const giveBack = (opener, otherwise) => { // of a dialog that closes; called once the page is drawn anew
  (isUsable(opener) && opener !== document.body ? opener : otherwise).focus({ preventScroll: true });
};

document.addEventListener("click", (event) => {
  const button = event.target.closest?.("button") ?? null; // a summary opens or folds a form, which harms nothing
  const isAgain = event.detail === 0 && button !== null && button === passed && performance.now() - passedAt < AGAIN_MS;
  if (!isAgain && button?.ariaDisabled !== "true") return;
  event.preventDefault();
  event.stopImmediatePropagation();
}, true);

document.addEventListener("focusin", ({ target }) => {
  [held, around, others] = [target, [], [...document.querySelectorAll(FOCUSABLE)]];
  for (let one = target.parentElement; one && one !== document.body; one = one.parentElement) around.push(one);
});

let byKeys = false; // a finger or a mouse needs no focus: passed on, it would show what the next button does
document.addEventListener("pointerdown", () => { // the operator leaves it; otherwise the page has taken the focus from it
  [held, byKeys] = [null, false];
}, true);
document.addEventListener("keydown", ({ key }) => {
  if (key === "Tab") held = null;
  byKeys = true;
}, true);

// The browser takes the focus from what is hidden only once it draws the page.
const isLost = () => byKeys && held !== null && (document.activeElement === document.body || (document.activeElement === held && !isUsable(held)));

const pass = () => {
  due = 0;
  if (!isLost()) return;
  if (isUsable(held)) return held.focus({ preventScroll: true }); // it was put to another place
  const at = others.indexOf(held), near = [...others.slice(at + 1), ...others.slice(0, Math.max(at, 0)).reverse()];
  const within = around.find((one) => isUsable(one) && near.some((other) => one.contains(other) && isUsable(other)));
  passed = near.find((one) => within?.contains(one) && isUsable(one)) ?? null;
  [held, passedAt] = [null, performance.now()];
  passed?.focus({ preventScroll: true });
};

new MutationObserver(() => {
  if (!due && byKeys && held !== null) due = setTimeout(pass, SETTLES_MS);
}).observe(document, { childList: true, subtree: true, attributes: true, attributeFilter: ["class", "disabled", "hidden", "open", "style"] });
