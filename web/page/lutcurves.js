// A lookup table over its angles: the radial profile, and the angles at which it is brightest.

import { send } from "./api.js";
import { h, svg } from "./dom.js";
import { fixed, percent, plain } from "./format.js";

/** Most lobes that are listed. */
const LISTED = 8;

/**
 * Lobes of the profile beside the zero order, brightest first.
 * @param {number[][]} rows half vector, X, Y, Z, coverage
 */
function lobes(rows) {
  const bright = (k) => (rows[k]?.[2] > 0 ? rows[k][2] : 0);
  // Of a peak that is flat, the middle of three is enough; neighbours at two rings keep noise out.
  const peaks = rows.map((_, k) => k).filter((k) => k > 2 && bright(k) > 0 && [1, 2].every((d) => bright(k) >= bright(k - d) && bright(k) >= bright(k + d)) && bright(k) > bright(k - 2));
  return peaks.sort((a, b) => bright(b) - bright(a)).slice(0, LISTED).map((k) => ({ half: rows[k][0], light: bright(k) }));
}

/** A table of the brightest angles for light from the normal, with the period whose first order is there. */
function strongest(rows, report) {
  const found = lobes(rows);
  if (!found.length) return h("p", { class: "soft" }, "No lobe stands out beside the zero order.");
  const [nm] = [report.wavelength_nm].flat();
  const most = Math.max(...found.map((f) => f.light));
  return h("div", { class: "scroll", id: "strongest-angles" }, h("table", {},
    h("caption", {}, `Brightest rings. The angle is for light from the normal; the period, for a first order at ${plain(nm)} nm`),
    h("thead", {}, h("tr", {}, ["Half vector", "Angle", "Period", "Light"].map((t) => h("th", { scope: "col", class: "number" }, t)))),
    h("tbody", {}, found.map(({ half, light }) => h("tr", {}, [fixed(half, 3), half <= 1 ? `${fixed((Math.asin(half) * 180) / Math.PI, 1)}°` : "–", `${fixed(nm / 1000 / half, 2)} µm`, percent(light / most, 0)].map((t) => h("td", { class: "number" }, t)))))));
}

/** Means over rings around the zero order: the luminance, the measured part, and the brightest rings. */
export async function lutCurves(base, report, signal) {
  const text = await (await send(`${base}/profile.csv`, { signal })).text();
  const rows = text.trim().split("\n").slice(1).map((line) => line.split(",").map(Number));
  const [width, height, left, bottom] = [420, 220, 44, 30];
  const reach = rows.at(-1)?.[0] ?? 1;
  const lights = rows.map((r) => r[2]).filter((y) => y > 0);
  const top = Math.ceil(Math.log10(Math.max(...lights, 1e-30)));
  const low = Math.max(top - 6, Math.floor(Math.log10(Math.min(...lights, 1e30))));
  const x = (r) => left + (r / reach) * (width - left - 8);
  const y = (share) => 8 + (1 - share) * (height - bottom - 8);
  const path = (value) => rows.map((r, i) => `${i ? "L" : "M"}${x(r[0]).toFixed(1)} ${y(Math.min(1, Math.max(0, value(r)))).toFixed(1)}`).join("");
  const decades = Array.from({ length: top - low + 1 }, (_, i) => low + i);
  const label = "Mean luminance over the half vector, on a logarithmic axis, and coverage";
  return h("div", { class: "stack" },
    svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": label, class: "chart" },
      decades.map((d) => {
        const at = y((d - low) / Math.max(1, top - low));
        return [svg("line", { x1: left, x2: width - 8, y1: at, y2: at, class: "grid" }), svg("text", { x: left - 6, y: at + 4, "text-anchor": "end" }, `10${superscript(d)}`)];
      }),
      [0, 0.5, 1].map((share) => svg("text", { x: x(share * reach), y: height - 10, "text-anchor": "middle" }, plain(Number((share * reach).toPrecision(2))))),
      svg("path", { d: path((r) => r[4]), class: "coverage" }),
      svg("path", { d: path((r) => (Math.log10(Math.max(r[2], 1e-30)) - low) / Math.max(1, top - low)), class: "light" })),
    strongest(rows, report),
    h("p", { class: "soft" }, "Mean luminance Y over the length of the half vector; dashed, the part that was measured, 0 to 1."));
}

const superscript = (n) => String(n).replace(/./g, (c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]);

