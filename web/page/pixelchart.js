// One pixel's measured points, the curve fitted to them, and what is left over.

import { h, svg } from "./dom.js";
import { fixed, significant } from "./format.js";

const [WIDTH, MAIN, REST] = [420, 190, 70];
const [LEFT, RIGHT, TOP, GAP, BOTTOM] = [46, 10, 10, 16, 38];

/** Round values between two ends, about `wanted` of them. */
function ticks(low, high, wanted) {
  const rough = (high - low) / wanted;
  if (!(rough > 0)) return [low];
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= rough * 0.999) ?? 10 * power;
  const first = Math.ceil(low / step - 1e-6);
  return Array.from({ length: Math.floor(high / step + 1e-6) - first + 1 }, (_, i) => (first + i) * step);
}

/** The fitted intensity behind the analyser at ψ. */
function fitted({ s0, s1, s2 }, deg) {
  const angle = (2 * deg * Math.PI) / 180;
  return (s0 + s1 * Math.cos(angle) + s2 * Math.sin(angle)) / 2;
}

/** The chart of what the service says about a pixel. */
export function pixelChart(pixel) {
  // The curve repeats after 180°, so points of a full turn are folded onto it.
  const points = pixel.points.filter((p) => Number.isFinite(p.value)).map((p) => ({
    ...p, deg: ((p.analyser_deg % 180) + 180) % 180, rest: p.value - fitted(pixel, p.analyser_deg),
  }));
  const curve = pixel.fit.filter((p) => Number.isFinite(p.value));
  const top = Math.max(1e-9, ...points.map((p) => p.value), ...curve.map((p) => p.value)) * 1.06;
  const low = Math.min(0, ...points.map((p) => p.value));
  const residuals = points.map((p) => Math.abs(p.rest)).filter(Number.isFinite);
  const rest = Math.max(1e-9, ...residuals) * 1.2;
  const height = TOP + MAIN + GAP + REST + BOTTOM;
  const x = (deg) => LEFT + ((WIDTH - LEFT - RIGHT) * deg) / 180;
  const y = (value) => TOP + MAIN * (1 - (value - low) / (top - low));
  const z = (value) => TOP + MAIN + GAP + REST * (0.5 - value / (2 * rest));

  const grid = [];
  const line = (x1, y1, x2, y2, name) => grid.push(svg("line", { x1, y1, x2, y2, class: name }));
  const label = (tx, ty, text, anchor = "end") => grid.push(svg("text", { x: tx, y: ty, "text-anchor": anchor, "dominant-baseline": "central" }, text));
  for (const value of ticks(low, top, 5)) {
    line(LEFT, y(value), WIDTH - RIGHT, y(value), "grid");
    label(LEFT - 6, y(value), significant(value, 2));
  }
  for (const value of [-rest / 1.2, 0, rest / 1.2]) {
    line(LEFT, z(value), WIDTH - RIGHT, z(value), value === 0 ? "zero" : "grid");
    label(LEFT - 6, z(value), significant(value, 2));
  }
  for (const deg of [0, 45, 90, 135, 180]) {
    line(x(deg), TOP, x(deg), TOP + MAIN + GAP + REST, "grid");
    label(x(deg), height - BOTTOM + 12, `${deg}°`, deg === 180 ? "end" : "middle");
  }
  label((LEFT + WIDTH - RIGHT) / 2, height - 6, "analyser", "middle");
  const path = curve.map((p, i) => `${i ? "L" : "M"}${x(p.analyser_deg).toFixed(1)} ${y(p.value).toFixed(1)}`).join("");
  const about = (p) => svg("title", {}, `${p.file}: ${fixed(p.analyser_deg, 2)}°, ${significant(p.value, 4)}, residual ${significant(p.rest, 2)}`);
  const chart = svg("svg", { id: "pixel-chart", class: "chart", viewBox: `0 0 ${WIDTH} ${height}`, role: "img",
    "aria-label": `Intensity against analyser angle: ${points.length} measured points, the fitted curve, and residuals of ${significant(pixel.residual_rms, 2)} (root mean square)` },
  grid, svg("path", { class: "fit", d: path }),
  points.map((p) => svg("circle", { class: "point", cx: x(p.deg), cy: y(p.value), r: 3.6 }, about(p))),
  points.filter((p) => Number.isFinite(p.rest)).map((p) => svg("g", { class: "residual" }, about(p),
    svg("line", { x1: x(p.deg), x2: x(p.deg), y1: z(0), y2: z(p.rest) }), svg("circle", { cx: x(p.deg), cy: z(p.rest), r: 3 }))));
  const key = h("p", { class: "row soft key" }, h("span", { class: "key-point" }, "measured"), h("span", { class: "key-fit" }, "fitted"), h("span", { class: "key-residual" }, "residual, below"));
  return h("figure", {}, chart, key);
}
