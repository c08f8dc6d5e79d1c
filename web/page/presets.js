// Plans to begin with, in plain words, each with the time that it takes on this bench.

import { post } from "./api.js";
import { h, panel, say, svg } from "./dom.js";
import { duration } from "./format.js";
import { BLANK, toPlan } from "./plan.js";
import { service } from "./service.js";

/** Fields that belong to the sample and stay when a preset is chosen. */
const KEPT = ["name", "sample", "operator", "notes", "roi"];

/** @type {{ key: string, label: string, about: string, flash?: boolean, form: Record<string, unknown> }[]} */
const PRESETS = [
  { key: "quick", label: "Quick look", about: "Four analyser angles without a dark frame. Shows whether sample, light and focus are right.",
    form: { angles: "range", start: "0", stop: "135", step: "45", dark: false, display_black: false } },
  { key: "map", label: "Orientation map", about: "Eight analyser angles. The direction of the grating in every pixel, with its uncertainty.",
    form: { angles: "range", start: "0", stop: "157.5", step: "22.5" } },
  { key: "until", label: "Map to a wanted σ", about: "Adds analyser angles until 90 % of the pixels are known to 0.3°.",
    form: { angles: "until" } },
  { key: "periods", label: "Accurate periods", about: "Fringes move over the panel. Orientation and absolute period of the grating in every pixel.",
    form: { kind: "spots", angles: "none", lights: "fringes" } },
  { key: "range", label: "High dynamic range", about: "Exposures from short to long, found by metering and merged into one photograph.",
    form: { kind: "exposures", angles: "none", exposing: "bracket" } },
  { key: "flash", label: "Flash", about: "The same under the flash, a small light: bright highlights of few orientations.", flash: true,
    form: { kind: "flash", angles: "none", exposing: "bracket" } },
];

/** Pictures of the presets on a field of 48 by 32. */
const PICTURES = {
  quick: () => angles([0, 45, 90, 135]),
  map: () => angles([0, 22.5, 45, 67.5, 90, 112.5, 135, 157.5]),
  until: () => [svg("path", { d: "M5 5 C13 20 20 24 43 25" }), svg("path", { d: "M5 28 H43", "stroke-dasharray": "3 3" })],
  periods: () => [0, 1, 2, 3, 4, 5].map((k) => svg("path", { d: `M${8 + 6.4 * k} 4 V28`, "stroke-width": 1 + k * 0.5 })),
  range: () => [3, 6, 9].map((r, k) => svg("circle", { cx: [8, 20, 36][k], cy: 16, r })),
  flash: () => [svg("path", { d: "M27 3 L17 18 H24 L21 29 L31 13 H24 Z" })],
};

/** Lines at these angles about one point. */
function angles(/** @type {number[]} */ all) {
  return all.map((deg) => {
    const [x, y] = [Math.cos((deg * Math.PI) / 180), Math.sin((deg * Math.PI) / 180)].map((v) => 13 * v);
    return svg("path", { d: `M${24 - x} ${16 + y} L${24 + x} ${16 - y}` });
  });
}

const formOf = (preset, values = {}) => ({ ...structuredClone(BLANK), ...Object.fromEntries(KEPT.map((key) => [key, values[key] ?? ""])), ...preset.form });

/** "about 6 s", or "4 s to 20 s" for a series that can end early. */
function timeText({ seconds, least_seconds, results_seconds }) {
  const rounded = (/** @type {number} */ s) => (s < 99.5 ? `${Math.max(1, Math.round(s))} s` : s < 3570 ? `${Math.round(s / 60)} min` : duration(s));
  const [least, most] = [least_seconds, seconds].map((s) => rounded(s + (results_seconds ?? 0)));
  return least === most ? `about ${most}` : `${least} to ${most}`;
}

/**
 * The presets as a panel. `chosen(values)` is called with the form's values.
 * @param {() => any} values of the form now
 * @param {(values: any) => void} chosen
 * @param {AbortSignal} signal
 */
export function presets(values, chosen, signal) {
  const buttons = PRESETS.map((preset) => {
    const time = h("span", { class: "time" }, "…");
    const button = h("button", { type: "button", class: "preset", "data-preset": preset.key, hidden: preset.flash && service.devices?.flash === null,
      onclick: () => { mark(preset.key); chosen(formOf(preset, values())); } },
      svg("svg", { viewBox: "0 0 48 32", class: "pictogram", "aria-hidden": "true" }, ...PICTURES[preset.key]()),
      h("strong", {}, preset.label), time, h("small", {}, preset.about));
    estimate(preset, time);
    return button;
  });

  async function estimate(preset, time) {
    try {
      say(time, timeText(await post("/plans/estimate", { plan: toPlan(formOf(preset)).plan }, { signal })));
    } catch (problem) {
      // The bench cannot do it, or the service does not answer; the panel of the estimate says why once it is chosen.
      if (problem.name !== "AbortError") say(time, "–");
    }
  }

  /** Shows which preset the form has, or none. */
  function mark(key) {
    for (const button of buttons) button.setAttribute("aria-pressed", String(button.dataset.preset === key));
  }
  return { element: panel("Begin with", null, h("div", { class: "presets" }, buttons)), mark };
}
