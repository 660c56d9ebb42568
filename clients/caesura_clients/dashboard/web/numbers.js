// A number as the page writes it.

// With so many digits; a zero has no sign.
export function fixed(value, digits) {
  const words = value.toFixed(digits);
  return Number(words) === 0 ? words.replace("-", "") : words;
}

// A time [s since 1970] of the place where the page is read: "Nov 26, 2026, 1:34 PM". An hour that the clocks have twice,
// as summer time ends, has its zone: "Oct 25, 2026, 2:30:00 AM GMT+2".
export function dayAndTime(at) {
  const when = new Date(1000 * at), minutes = (hours) => new Date(1000 * (at + 3600 * hours)).getTimezoneOffset();
  const isTwice = minutes(1) > minutes(0) || minutes(0) > minutes(-1);
  return when.toLocaleString([], { dateStyle: "medium", timeStyle: isTwice ? "long" : "short" });
}
