// What every drawing on a canvas needs: its colours by the theme, its pixels, and when to draw again.

// The colours of the theme that is shown.
export function inkOf() {
  const style = getComputedStyle(document.documentElement);
  const value = (name) => style.getPropertyValue(`--${name}`).trim();
  const names = { text: "ink", faint: "faint", paper: "paper", rule: "rule", accent: "accent", alarm: "alarm", quiet: "quiet-ground" };
  const ink = Object.fromEntries(Object.entries(names).map(([key, name]) => [key, value(name)]));
  return { ...ink, onAccent: value("on-accent"), lines: ["x", "y", "z", "4", "5", "6", "7"].map((name) => value(`line-${name}`)) };
}

// The font of text, on a canvas whose pixels are so many to one of CSS. 15 px are those of --text.
export const fontOf = (pixel = 1) => `${15 * pixel}px system-ui, sans-serif`;

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

// One drawing, and how often it is made: at once where a person asks for it, and while results arrive at most every
// LIVE_MS, or every HIDDEN_MS where it is scrolled out of sight. The last request is always drawn.
const LIVE_MS = 150, HIDDEN_MS = 1000;
export class Painter {
  constructor(element, paint) {
    Object.assign(this, { paint, frame: 0, timer: 0, painted: -HIDDEN_MS, inSight: true });
    this.observer = new IntersectionObserver((found) => {
      this.inSight = found.at(-1).isIntersecting;
      if (this.inSight && this.timer) this.now();
    });
    this.observer.observe(element);
  }
  now() {
    clearTimeout(this.timer);
    this.timer = 0;
    this.frame ||= requestAnimationFrame(() => {
      Object.assign(this, { frame: 0, painted: performance.now() });
      this.paint();
    });
  }
  soon(every = LIVE_MS) { // every: [ms] between two drawings, if it is more
    if (this.frame || this.timer) return;
    const wait = Math.max(LIVE_MS, Math.min(every, HIDDEN_MS), this.inSight ? 0 : HIDDEN_MS);
    this.timer = setTimeout(() => this.now(), Math.max(this.painted + wait - performance.now(), 0));
  }
  close() {
    this.observer.disconnect();
    clearTimeout(this.timer);
    cancelAnimationFrame(this.frame);
  }
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
