// The analyser as an instrument. At ψ and at ψ + 180° it is the same analyser, so its line has two ends.

import { svg } from "./dom.js";
import { fixed } from "./format.js";

const RIM = 84;

function at(radius, deg) {
  const angle = (deg * Math.PI) / 180;
  return [radius * Math.cos(angle), -radius * Math.sin(angle)];
}

function tick(deg, from, to, attributes) {
  const [x1, y1] = at(from, deg);
  const [x2, y2] = at(to, deg);
  return svg("line", { x1, y1, x2, y2, ...attributes });
}

/** A dial with the analyser's line. `set(deg)` turns it; `marks(planned, done)` shows the angles of a series. */
export function dial() {
  const scale = Array.from({ length: 72 }, (_, i) =>
    tick(5 * i, RIM, RIM + (i % 6 ? 4 : 8), { class: i % 6 ? "tick" : "tick major" }));
  const labels = [0, 90, 180, 270].map((deg) => {
    const [x, y] = at(RIM + 19, deg);
    return svg("text", { x, y, class: "label", "text-anchor": "middle", "dominant-baseline": "central" }, `${deg}`);
  });
  // The hatching is the analyser's own: parallel lines along its axis.
  const hatch = [-3, -2, -1, 0, 1, 2, 3].map((i) => {
    const half = Math.sqrt((RIM - 10) ** 2 - (20 * i) ** 2);
    return svg("line", { x1: -half, x2: half, y1: 20 * i, y2: 20 * i, class: i === 0 ? "axis" : "hatch" });
  });
  const needle = svg("g", { class: "needle" }, hatch, svg("path", { d: `M${RIM - 2} 0l-11 -6v12z`, class: "tip" }));
  const series = svg("g", {});
  const root = svg("svg", { viewBox: "-116 -112 232 224", class: "dial", role: "img", "aria-label": "Analyser" },
    svg("circle", { r: RIM, class: "rim" }), scale, labels, series, needle);
  const set = (/** @type {number | null} */ deg) => {
    const known = typeof deg === "number";
    needle.setAttribute("transform", `rotate(${known ? -deg : 0})`);
    needle.setAttribute("visibility", known ? "visible" : "hidden");
    root.setAttribute("aria-label", known ? `Analyser at ${fixed(deg, 2)}°` : "Analyser: angle not known");
  };
  const marks = (/** @type {number[]} */ planned, /** @type {number[]} */ done) => {
    const key = (/** @type {number} */ deg) => Math.round(100 * deg);
    const taken = new Set(done.map(key));
    series.replaceChildren(...planned.map((deg) => {
      const [cx, cy] = at(RIM - 1, deg);
      return svg("circle", { cx, cy, r: 4.5, class: taken.has(key(deg)) ? "mark done" : "mark" });
    }));
  };
  set(null);
  return Object.assign(root, { set, marks });
}
