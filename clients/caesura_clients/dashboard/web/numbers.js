// A number as the page writes it.

// With so many digits; a zero has no sign.
export function fixed(value, digits) {
  const words = value.toFixed(digits);
  return Number(words) === 0 ? words.replace("-", "") : words;
}

// A time [s since 1970] of the place where the page is read: "Nov 26, 2026, 1:34 PM".
export const dayAndTime = (at) => new Date(1000 * at).toLocaleString([], { dateStyle: "medium", timeStyle: "short" });
