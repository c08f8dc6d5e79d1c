// The colours of a map with the histogram of its values: their ends are dragged, typed, or set to percentiles.

import { field, h, number, select, svg } from "./dom.js";
import { plain } from "./format.js";
import { plainValue, shownIn, ticks, titleOf } from "./mapvalues.js";
import { colorAt } from "./palettes.js";

const [WIDTH, TALL, BAR, LABELS] = [320, 64, 12, 16];
/** Room at both sides, so that handles at the ends can be gripped. */
const EDGE = 12;

/** Ends by percentiles. */
const PRESETS = [["", "As set"], ["0.1,99.9", "0.1 to 99.9 %"], ["1,99", "1 to 99 %"], ["5,95", "5 to 95 %"], ["0,100", "Least to most"], ["z,99", "0 to 99 %"]];

/** Maps whose colours begin at 0, so that they can be compared. */
const fromZero = (/** @type {MapInfo} */ info) => /sigma|dolp|correlation|coverage/.test(info.name);

/** The preset that a map begins with. */
const usual = (/** @type {MapInfo} */ info) => (fromZero(info) ? "z,99" : "1,99");

/**
 * Ends of the colours by a preset.
 * @param {MapStatistics} statistics
 * @param {string} preset
 */
function endsBy({ percentiles, min, max }, preset) {
  const at = (percent) => (percent === "z" ? 0 : percent === "0" ? min : percent === "100" ? max : percentiles.find((p) => p.percent === Number(percent))?.value);
  const [low, high] = preset.split(",").map((part) => at(part) ?? 0);
  return high > low ? [low, high] : [low, low + (Math.abs(low) * 1e-3 || 1)];
}

/** Ends of the colours that a map begins with. */
export const usualEnds = (/** @type {MapInfo} */ info, /** @type {MapStatistics} */ statistics) => (info.kind === "mask" ? [0, 1] : endsBy(statistics, usual(info)));

/**
 * The panel; `changed(low, high)` gets the new ends.
 * @param {{ changed: (low: number, high: number) => void, signal: AbortSignal }} options
 */
export function contrast({ changed, signal }) {
  const back = svg("g");
  const front = svg("g");
  const chart = svg("svg", { class: "contrast", viewBox: `0 0 ${WIDTH} ${TALL + BAR + LABELS}` }, back, front);
  const low = number({ id: "range-low", onchange: typed });
  const high = number({ id: "range-high", onchange: typed });
  const presets = select(PRESETS, "", { id: "range-percentiles", onchange: () => {
    if (!known || !presets.value) return;
    const [a, b] = endsBy(known, presets.value);
    set(a, b, presets.value);
  } });
  const inputs = h("div", { class: "fields contrast-fields" }, field("From", low), field("To", high), field("Percentiles", presets));
  const element = h("div", { class: "stack contrast-box" }, chart, inputs);
  const handles = ["Lower", "Upper"].map((word, k) => handle(word, k));
  front.append(...handles);
  /** @type {MapInfo | null} */
  let info = null;
  /** @type {MapStatistics | null} */
  let known = null;
  let palette = "viridis";
  let ends = [0, 1];
  let axis = [0, 1];

  const x = (value) => EDGE + ((value - axis[0]) / (axis[1] - axis[0])) * (WIDTH - 2 * EDGE);
  const clamped = (at) => Math.min(WIDTH - EDGE, Math.max(EDGE, at));

  function handle(word, k) {
    const line = svg("g", { class: "limit", tabindex: 0, role: "slider", "aria-label": `${word} end of the colours` },
      svg("rect", { x: -12, y: 0, width: 24, height: TALL + BAR, class: "grip" }), svg("path", { d: `M0 0V${TALL + BAR}`, class: "edge" }), svg("path", { d: k ? "M0 0H-7L0 9Z" : "M0 0H7L0 9Z", class: "flag" }));
    line.addEventListener("pointerdown", (event) => { line.setPointerCapture(event.pointerId); event.preventDefault(); line.focus(); }, { signal });
    line.addEventListener("pointermove", (event) => {
      if (!line.hasPointerCapture(event.pointerId)) return;
      const box = chart.getBoundingClientRect();
      const at = ((event.clientX - box.left) / box.width) * WIDTH;
      put(k, axis[0] + ((at - EDGE) / (WIDTH - 2 * EDGE)) * (axis[1] - axis[0]));
    }, { signal });
    line.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageUp: 10, PageDown: -10 }[event.key];
      if (!step) return;
      event.preventDefault();
      put(k, ends[k] + (step * (axis[1] - axis[0])) / 100);
    }, { signal });
    return line;
  }

  /** Moves an end; the two keep their order. */
  function put(k, value) {
    const least = (axis[1] - axis[0]) / 1000;
    const next = [...ends];
    next[k] = k ? Math.max(value, ends[0] + least) : Math.min(value, ends[1] - least);
    set(next[0], next[1], "");
  }

  function typed() {
    if (!info) return;
    const { factor } = shownIn(info);
    const [a, b] = [low, high].map((input) => Number(input.value) / factor);
    const problem = Number.isFinite(a) && Number.isFinite(b) && a < b ? "" : "The first value must be below the second one.";
    for (const input of [low, high]) {
      input.setCustomValidity(problem);
      input.setAttribute("aria-invalid", String(problem !== ""));
    }
    if (problem) high.reportValidity();
    else set(a, b, "");
  }

  function set(a, b, preset) {
    ends = [a, b];
    presets.value = preset;
    paint();
    changed(a, b);
  }

  function bars() {
    const { histogram } = known ?? {};
    if (!histogram) return [];
    const most = Math.sqrt(Math.max(...histogram.counts, 1));
    const wide = (histogram.high - histogram.low) / histogram.counts.length;
    return histogram.counts.map((count, k) => {
      const [from, to] = [x(histogram.low + k * wide), x(histogram.low + (k + 1) * wide)];
      // Square roots, so that rare values are seen beside frequent ones.
      const tall = (Math.sqrt(count) / most) * (TALL - 4);
      return count ? `M${from.toFixed(2)} ${TALL}V${(TALL - tall).toFixed(2)}H${to.toFixed(2)}V${TALL}Z` : "";
    });
  }

  function paint() {
    if (!info) return;
    const directions = info.kind === "direction";
    const mask = info.kind === "mask";
    inputs.hidden = directions || mask;
    const { factor, unit } = shownIn(info);
    const span = known?.histogram ? [known.histogram.low, known.histogram.high] : ends;
    axis = directions ? [0, Math.PI] : [Math.min(span[0], ends[0]), Math.max(span[1], ends[1])];
    if (axis[1] <= axis[0]) axis = [axis[0], axis[0] + 1];
    const shades = Array.from({ length: 64 }, (_, k) => {
      const at = EDGE + ((WIDTH - 2 * EDGE) * k) / 64;
      const value = axis[0] + ((k + 0.5) / 64) * (axis[1] - axis[0]);
      const t = directions ? value / Math.PI : (value - ends[0]) / (ends[1] - ends[0]);
      return svg("rect", { x: at, y: TALL, width: (WIDTH - 2 * EDGE) / 64 + 0.5, height: BAR, fill: `rgb(${colorAt(palette, Math.min(1, Math.max(0, t))).join(" ")})` });
    });
    const marks = (directions ? [0, 45, 90, 135, 180] : mask ? [] : ticks(axis[0] * factor, axis[1] * factor, 4)).map((v) =>
      svg("text", { x: x(v / factor).toFixed(1), y: TALL + BAR + 12, "text-anchor": "middle" }, `${plain(v)}${directions ? "°" : ""}`));
    const said = directions ? "" : `, colours from ${plainValue(info, ends[0])} to ${plainValue(info, ends[1])}${unit}`;
    back.replaceChildren(svg("title", {}, "Heights are square roots of frequencies"), svg("path", { class: "bars", d: bars().join("") }), ...shades, ...marks);
    front.toggleAttribute("hidden", directions || mask);
    chart.setAttribute("role", directions || mask ? "img" : "group");
    chart.setAttribute("aria-label", `Histogram of ${titleOf(info)}${said}`);
    handles.forEach((line, k) => {
      line.setAttribute("transform", `translate(${clamped(x(ends[k])).toFixed(2)} 0)`);
      for (const [name, value] of [["aria-valuemin", axis[0]], ["aria-valuemax", axis[1]], ["aria-valuenow", ends[k]]]) line.setAttribute(String(name), String(Number(value) * factor));
      line.setAttribute("aria-valuetext", `${plainValue(/** @type {MapInfo} */ (info), ends[k])}${unit}`);
    });
    for (const [input, value] of /** @type {[HTMLInputElement, number][]} */ ([[low, ends[0]], [high, ends[1]]])) {
      if (document.activeElement !== input) input.value = String(Number((value * factor).toPrecision(4)));
      input.setCustomValidity("");
      input.removeAttribute("aria-invalid");
    }
  }

  return {
    element,
    /** Shows a map; `statistics` may follow later. */
    show(/** @type {MapInfo} */ next, /** @type {string} */ colors, /** @type {number[]} */ limits, /** @type {MapStatistics | null} */ statistics) {
      const other = info !== next;
      [info, palette, ends, known] = [next, colors, limits, statistics];
      if (other) presets.value = "";
      if (statistics && usualEnds(next, statistics).every((v, k) => v === limits[k])) presets.value = usual(next);
      paint();
    },
    /** Makes the range narrower or wider about its middle. */
    stretch(/** @type {number} */ factor) {
      const [middle, half] = [(ends[0] + ends[1]) / 2, ((ends[1] - ends[0]) / 2) * factor];
      if (info?.kind === "number") set(middle - half, middle + half, "");
    },
  };
}
