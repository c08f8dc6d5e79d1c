// Values of maps for people: units, digits, and names.

import { fixed, significant } from "./format.js";

const TITLES = { orientation: "Orientation", smoothed: "Smoothed", period: "Period", sigma: "σ", dolp: "DoLP", mask: "Mask", s0: "S0", aolp: "AoLP", period_sigma: "σ of the period", sigma_dolp: "σ of DoLP" };

/** What a map is called. */
export const titleOf = (/** @type {MapInfo} */ info) => TITLES[info.name] ?? info.name.replace(".", " ");

/**
 * Factor from stored to shown values, and the unit that follows them.
 * @param {MapInfo} info
 * @returns {{ factor: number, unit: string }}
 */
export function shownIn({ unit }) {
  if (unit.startsWith("rad") && !unit.startsWith("radiance")) return { factor: 180 / Math.PI, unit: "°" };
  if (unit.startsWith("um")) return { factor: 1, unit: ` µm${unit.slice(2)}` };
  return { factor: 1, unit: unit ? ` ${unit}` : "" };
}

/** Decimals at which a standard deviation has two digits. */
const decimals = (sigma) => Math.min(8, Math.max(0, 1 - Math.floor(Math.log10(sigma))));

/**
 * A value with its unit, and with its standard deviation where that is known.
 * @param {MapInfo} info
 * @param {number | null} value
 * @param {number | null} [sigma]
 */
export function valueText(info, value, sigma = null) {
  if (value === null || !Number.isFinite(value)) return "masked";
  const { factor, unit } = shownIn(info);
  if (info.kind === "mask") return value > 0.5 ? "valid" : "masked";
  const shown = value * factor;
  if (sigma === null || !(sigma > 0) || !Number.isFinite(sigma)) return `${unit === "°" ? fixed(shown, 2) : significant(shown, 4)}${unit}`;
  const digits = decimals(sigma * factor);
  const both = `${fixed(shown, digits)} ± ${fixed(sigma * factor, digits)}`;
  return unit === "°" ? `${both}°` : `${both}${unit}`;
}

/** A number of the map without σ, for axes. */
export const plainValue = (/** @type {MapInfo} */ info, /** @type {number} */ value) => significant(value * shownIn(info).factor, 3);

/** "every 2nd row and column", for statistics of a sample. */
export const everyNth = (/** @type {number} */ step) => `every ${step === 2 ? "2nd" : step === 3 ? "3rd" : `${step}th`} row and column`;

/** Round values between two ends, about `wanted` of them. */
export function ticks(/** @type {number} */ low, /** @type {number} */ high, /** @type {number} */ wanted) {
  const rough = (high - low) / wanted;
  if (!(rough > 0) || !Number.isFinite(rough)) return [low];
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= rough * 0.999) ?? 10 * power;
  const first = Math.ceil(low / step - 1e-6);
  return Array.from({ length: Math.floor(high / step + 1e-6) - first + 1 }, (_, i) => (first + i) * step);
}

/**
 * The longest round length below `most` pixels, in pixels and in words; without a pitch it counts pixels.
 * @param {number | null} pixelUm
 * @param {number} most
 */
export function roundLength(pixelUm, most) {
  const longest = most * (pixelUm ?? 1);
  const power = 10 ** Math.floor(Math.log10(longest));
  const length = ([5, 2, 1].find((m) => m * power <= longest) ?? 1) * power;
  if (pixelUm === null) return { pixels: Math.max(1, length), words: `${Math.max(1, Math.round(length))} px` };
  const [value, unit] = length >= 1000 ? [length / 1000, "mm"] : length >= 1 ? [length, "µm"] : [1000 * length, "nm"];
  return { pixels: length / pixelUm, words: `${Number(value.toPrecision(3))} ${unit}` };
}
