// What every drawing on a canvas needs: its colours by the theme, its pixels, and when to draw again.

// The colours of the theme that is shown.
export function inkOf() {
  const style = getComputedStyle(document.documentElement);
  const value = (name) => style.getPropertyValue(`--${name}`).trim();
  const names = { text: "ink", faint: "faint", paper: "paper", rule: "rule", accent: "accent", alarm: "alarm", quiet: "quiet-ground" };
  const ink = Object.fromEntries(Object.entries(names).map(([key, name]) => [key, value(name)]));
  return { ...ink, onAccent: value("on-accent"), lines: ["x", "y", "z", "4", "5", "6", "7"].map((name) => value(`line-${name}`)) };
}

// The context of a canvas whose pixels fit the screen; lengths are pixels of CSS.
export function contextOf(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth * ratio, canvas.clientHeight * ratio].map(Math.round);
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, canvas.clientWidth, canvas.clientHeight);
  return context;
}

// Call `resized` when an element has another size, and `themed` when the theme changes; returns what ends that.
export function watchLook(element, resized, themed) {
  const observers = [new ResizeObserver(() => resized()), new MutationObserver(() => themed())];
  observers[0].observe(element);
  observers[1].observe(document.documentElement, { attributes: true });
  const scheme = matchMedia("(prefers-color-scheme: dark)"), changed = () => themed();
  scheme.addEventListener("change", changed);
  return () => {
    observers.forEach((one) => one.disconnect());
    scheme.removeEventListener("change", changed);
  };
}
