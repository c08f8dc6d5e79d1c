// Numbers for people. A value that is missing is a dash.

const DASH = "–";
const known = (value) => typeof value === "number" && Number.isFinite(value);

/** Degrees with their sign. */
export const degrees = (value, digits = 2) => (known(value) ? `${fixed(value, digits)}°` : DASH);

/** Fixed decimals with a true minus. */
export function fixed(value, digits) {
  if (!known(value)) return DASH;
  const text = value.toFixed(digits);
  return (Number(text) === 0 ? text.replace("-", "") : text).replace("-", "−");
}

/** Significant digits without an exponent where it can be avoided. */
export function significant(value, digits = 3) {
  if (!known(value)) return DASH;
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size < 1e-4 || size >= 1e7) return value.toExponential(digits - 1).replace("-", "−");
  return fixed(value, Math.max(0, digits - 1 - Math.floor(Math.log10(size))));
}

/** A setting as it was set: no more digits than it has. */
export const plain = (value) => (known(value) ? String(Number(value.toPrecision(6))).replace("-", "−") : DASH);

/** A share of one. */
export function percent(share, digits = 1) {
  if (!known(share)) return DASH;
  const smallest = 10 ** -digits;
  if (share > 0 && 100 * share < smallest) return `< ${smallest} %`;
  return `${fixed(100 * share, digits)} %`;
}

/** A time span. */
export function duration(seconds) {
  if (!known(seconds)) return DASH;
  if (seconds < 0.9995) return `${plain(Number((1000 * seconds).toPrecision(3)))} ms`;
  if (seconds < 99.5) return `${fixed(seconds, seconds < 10 ? 1 : 0)} s`;
  const minutes = Math.round(seconds / 60);
  if (seconds < 3600) return `${Math.floor(seconds / 60)} min ${String(Math.floor(seconds % 60)).padStart(2, "0")} s`;
  return `${Math.floor(minutes / 60)} h ${String(minutes % 60).padStart(2, "0")} min`;
}

/** Bytes in decimal units. */
export function bytes(count) {
  if (!known(count)) return DASH;
  const units = ["B", "kB", "MB", "GB", "TB"];
  const power = Math.min(units.length - 1, count < 1 ? 0 : Math.floor(Math.log10(count) / 3));
  return `${power === 0 ? count : significant(count / 1000 ** power)} ${units[power]}`;
}

/** A moment, in the user's zone, in the order that sorts. */
export function moment(unixSeconds) {
  if (!known(unixSeconds)) return DASH;
  const date = new Date(1000 * unixSeconds);
  const two = (n) => String(n).padStart(2, "0");
  return `${date.getFullYear()}-${two(date.getMonth() + 1)}-${two(date.getDate())} ${two(date.getHours())}:${two(date.getMinutes())}`;
}

/** When something happened, for logs: the time of day, and the date where that is not today's. */
export function happened(unixSeconds, now = new Date()) {
  if (!known(unixSeconds)) return DASH;
  const date = new Date(1000 * unixSeconds);
  const time = date.toTimeString().slice(0, 8);
  return date.toDateString() === now.toDateString() ? time : `${moment(unixSeconds).slice(0, 10)} ${time}`;
}

/** A whole number with thin spaces between thousands. */
export const count = (value) => (known(value) ? String(Math.round(value)).replace(/\B(?=(\d{3})+$)/g, "\u202f") : DASH);

/** A word of the contract as text: `display_black` → `display black`. */
export const words = (name) => String(name ?? "").replaceAll("_", " ");

/** The name of a file, without its folders. */
export const fileName = (/** @type {string} */ path) => path.slice(path.lastIndexOf("/") + 1);
