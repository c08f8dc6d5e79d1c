// Measurements on a map: the profile along a line, and the statistics of a region.

import { get, query } from "./api.js";
import { facts, figures, h, panel, save, settle, svg } from "./dom.js";
import { complain } from "./feedback.js";
import { count, fixed, percent, plain, significant } from "./format.js";
import { everyNth, shownIn, ticks, titleOf, valueText } from "./mapvalues.js";
import { colorAt } from "./palettes.js";

const [WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM] = [420, 210, 52, 10, 10, 38];

/** Axes of a chart with round marks; the titles are their quantities. */
function axes({ x, y, xs, ys, xTitle, yTitle }) {
  return svg("g", { "aria-hidden": "true" },
    ys.map((v) => [svg("line", { class: "grid", x1: LEFT, x2: WIDTH - RIGHT, y1: y(v), y2: y(v) }), svg("text", { x: LEFT - 6, y: y(v) + 4, "text-anchor": "end" }, plain(Number(v.toPrecision(4))))]),
    xs.map((v) => svg("text", { x: x(v), y: HEIGHT - BOTTOM + 16, "text-anchor": "middle" }, plain(Number(v.toPrecision(4))))),
    svg("text", { x: (LEFT + WIDTH - RIGHT) / 2, y: HEIGHT - 5, "text-anchor": "middle" }, xTitle),
    svg("text", { transform: `translate(11 ${(TOP + HEIGHT - BOTTOM) / 2}) rotate(-90)`, "text-anchor": "middle" }, yTitle));
}

const ruler = ([low, high], [from, to]) => (/** @type {number} */ v) => from + ((v - low) / (high - low || 1)) * (to - from);

/** Angles of lines, continued beyond 0 and π so that neighbours lie close together. */
function continued(/** @type {(number | null)[]} */ values) {
  let last = /** @type {number | null} */ (null);
  return values.map((v) => {
    if (v === null) return null;
    if (last !== null) v += Math.PI * Math.round((last - v) / Math.PI);
    last = v;
    return v;
  });
}

/**
 * The chart of a profile: the values, and a band of one standard deviation to both sides.
 * @param {MapInfo} info
 * @param {LineProfile} profile
 */
function profileChart(info, profile) {
  const { factor, unit } = shownIn(info);
  const of = (/** @type {(number | null)[]} */ list) => list.map((v) => (v === null ? null : v * factor));
  const value = of(info.kind === "direction" ? continued(profile.value) : profile.value);
  const sigma = profile.sigma && of(profile.sigma);
  const pitch = info.pixel_um;
  const long = profile.length_px * (pitch ?? 1);
  const at = (k) => (long * k) / Math.max(1, value.length - 1);
  const known = value.flatMap((v, k) => (v === null ? [] : [v - (sigma?.[k] ?? 0), v + (sigma?.[k] ?? 0)]));
  if (!known.length) return h("p", { class: "soft" }, "All pixels along the line are masked.");
  let [low, high] = [Math.min(...known), Math.max(...known)];
  const room = 0.06 * (high - low) || Math.abs(high) * 0.01 || 1;
  [low, high] = [low - room, high + room];
  const x = ruler([0, long], [LEFT, WIDTH - RIGHT]);
  const y = ruler([low, high], [HEIGHT - BOTTOM, TOP]);
  /** Runs of valid pixels. */
  const runs = value.reduce((all, v, k) => {
    if (v !== null) (k && value[k - 1] !== null ? all[all.length - 1] : all[all.push([]) - 1]).push(k);
    return all;
  }, /** @type {number[][]} */ ([]));
  const point = (k, v) => `${x(at(k)).toFixed(1)} ${y(v).toFixed(1)}`;
  const line = runs.map((run) => `M${run.map((k) => point(k, value[k])).join("L")}${run.length === 1 ? "h0.1" : ""}`).join("");
  const band = sigma && runs.map((run) => `M${run.map((k) => point(k, (value[k] ?? 0) + (sigma[k] ?? 0))).join("L")}L${[...run].reverse().map((k) => point(k, (value[k] ?? 0) - (sigma[k] ?? 0))).join("L")}Z`).join("");
  const label = `${titleOf(info)} along the line: ${value.length} pixels, ${significant(Math.min(...known))} to ${significant(Math.max(...known))}${unit}`;
  return svg("svg", { id: "profile-chart", class: "chart", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": label },
    axes({ x, y, xs: ticks(0, long, 5), ys: ticks(low, high, 5), xTitle: pitch ? "distance (µm)" : "distance (pixels)", yTitle: `${titleOf(info)}${unit ? ` (${unit.trim()})` : ""}` }),
    band ? svg("path", { class: "band", d: band }) : null, svg("path", { class: "fit", d: line }));
}

/** The histogram of a region. */
function histogramChart(/** @type {MapInfo} */ info, /** @type {MapStatistics} */ { histogram }, palette, ends) {
  if (!histogram) return null;
  const { factor, unit } = shownIn(info);
  const { low, high, counts } = histogram;
  const most = Math.max(...counts, 1);
  const x = ruler([low * factor, high * factor], [LEFT, WIDTH - RIGHT]);
  const y = ruler([0, most], [HEIGHT - BOTTOM, TOP]);
  const wide = (WIDTH - LEFT - RIGHT) / counts.length;
  const bars = counts.map((n, k) => {
    const value = low + ((k + 0.5) / counts.length) * (high - low);
    const t = info.kind === "direction" ? value / Math.PI : (value - ends[0]) / (ends[1] - ends[0]);
    return n ? svg("rect", { x: (LEFT + k * wide).toFixed(2), width: (wide + 0.3).toFixed(2), y: y(n).toFixed(1), height: (HEIGHT - BOTTOM - y(n)).toFixed(1), fill: `rgb(${colorAt(palette, Math.min(1, Math.max(0, t))).join(" ")})` }) : null;
  });
  return svg("svg", { id: "region-chart", class: "chart", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": `Histogram of ${titleOf(info)} in the region` },
    axes({ x, y, xs: ticks(low * factor, high * factor, 5), ys: ticks(0, most, 4), xTitle: `${titleOf(info)}${unit ? ` (${unit.trim()})` : ""}`, yTitle: "pixels" }), ...bars);
}

/** Mean, spread and share of the valid pixels of a region. */
function regionView(/** @type {MapInfo} */ info, /** @type {MapStatistics} */ s, palette, ends) {
  if (!s.valid) return h("p", { class: "soft" }, `All ${count(s.pixels)} pixels of the region are masked.`);
  const at = (percentile) => s.percentiles.find((p) => p.percent === percentile)?.value ?? null;
  const area = info.pixel_um && s.pixels * info.pixel_um ** 2;
  return h("div", { class: "stack" },
    figures([["mean", valueText(info, s.mean)], ["standard deviation", valueText({ ...info, kind: "number" }, s.sd)], ["of pixels valid", percent(s.valid / s.read, 1)]]),
    histogramChart(info, s, palette, ends),
    facts([
      ["Median", at(50) === null ? null : valueText(info, at(50))],
      ["5 to 95 %", at(5) === null ? null : `${valueText(info, at(5))} to ${valueText(info, at(95))}`],
      ["Least, most", info.kind === "direction" ? null : `${valueText(info, s.min)}, ${valueText(info, s.max)}`],
      ["Pixels", `${count(s.pixels)}${s.step > 1 ? `; ${everyNth(s.step)} was read` : ""}`],
      ["Area", area && (area >= 1e6 ? `${significant(area / 1e6, 4)} mm²` : `${significant(area, 4)} µm²`)],
    ]));
}

/** Query of the service for a shape; its coordinates are centres of pixels. */
function asked(tool, corners, { width, height }) {
  const center = (v, size) => Math.min(size - 1, Math.max(0, v - 0.5));
  const [[x0, y0], [x1, y1]] = corners;
  if (tool === "line") return { x0: center(x0, width), y0: center(y0, height), x1: center(x1, width), y1: center(y1, height) };
  if (tool === "rectangle") return { x: x0, y: y0, w: Math.max(1, x1 - x0), h: Math.max(1, y1 - y0) };
  return { polygon: corners.map(([x, y]) => `${fixedPlain(x - 0.5)},${fixedPlain(y - 0.5)}`).join(",") };
}

const fixedPlain = (/** @type {number} */ v) => String(Number(v.toFixed(2)));

/**
 * The panel of measurements, hidden until something is drawn.
 * @param {{ base: string, named: string, signal: AbortSignal }} options
 */
export function measurements({ base, named, signal }) {
  const body = h("div", { class: "stack", "aria-live": "polite" });
  const heading = h("h2", {}, "Region");
  const download = h("button", { type: "button", id: "measure-csv" }, "CSV");
  const element = panel("Measurement", download, body);
  element.id = "measurement";
  element.querySelector("h2")?.replaceWith(heading);
  element.hidden = true;
  let turn = 0;
  let table = "";
  download.onclick = () => save(new Blob([table], { type: "text/csv" }), `${named}-${heading.textContent?.toLowerCase().replace(/\W+/g, "-")}.csv`);

  const fetched = settle(120, async (/** @type {MapInfo} */ info, /** @type {string} */ tool, /** @type {Point[]} */ corners, /** @type {string} */ palette, /** @type {number[]} */ ends) => {
    const mine = ++turn;
    const kind = tool === "line" ? "profile" : "statistics";
    try {
      const answer = await get(`${base}/${kind}/${encodeURIComponent(info.name)}${query(asked(tool, corners, info))}`, { signal });
      if (mine !== turn) return;
      element.hidden = false;
      body.replaceChildren(...(kind === "profile" ? lineView(info, answer, corners) : [regionView(info, answer, palette, ends)]));
      heading.textContent = kind === "profile" ? `Profile of ${titleOf(info)}` : `${titleOf(info)} in the ${tool}`;
      table = kind === "profile" ? lineTable(info, answer) : regionTable(info, answer);
    } catch (problem) {
      if (mine === turn) complain(problem);
    }
  });

  return {
    element,
    /** Measures a shape; null hides the panel. */
    measure(info, shape, palette, ends) {
      if (shape) return fetched(info, shape.tool, shape.corners, palette, ends);
      turn++;
      element.hidden = true;
    },
  };
}

function lineView(/** @type {MapInfo} */ info, /** @type {LineProfile} */ profile, /** @type {Point[]} */ [[x0, y0], [x1, y1]]) {
  const length = info.pixel_um ? `${significant(profile.length_px * info.pixel_um, 4)} µm` : `${fixed(profile.length_px, 1)} pixels`;
  const angle = ((Math.atan2(y0 - y1, x1 - x0) * 180) / Math.PI + 360) % 180;
  return [profileChart(info, profile), h("p", { class: "soft" }, `${length} at ${fixed(angle, 1)}°, from x ${Math.floor(x0)}, y ${Math.floor(y0)} to x ${Math.floor(x1)}, y ${Math.floor(y1)}${profile.sigma ? "; the band is one standard deviation" : ""}.`)];
}

/** The profile as a table, in shown units. */
function lineTable(info, { x, y, value, sigma, length_px: long }) {
  const { factor } = shownIn(info);
  const text = (v) => (v === null || v === undefined ? "" : String(Number((v * factor).toPrecision(7))));
  const rows = value.map((v, k) => [Number(((long * k) / Math.max(1, value.length - 1)).toFixed(3)), x[k], y[k], text(v), text(sigma?.[k])].join());
  return `distance_px,x,y,${info.name},sigma\n${rows.join("\n")}\n`;
}

/** Statistics and histogram as a table, in shown units. */
function regionTable(info, s) {
  const { factor } = shownIn(info);
  const text = (v) => (v === null ? "" : String(Number((v * factor).toPrecision(7))));
  const single = [["pixels", s.pixels], ["read", s.read], ["valid", s.valid], ["mean", text(s.mean)], ["sd", text(s.sd)], ["min", text(s.min)], ["max", text(s.max)], ...s.percentiles.map((p) => [`percentile ${p.percent}`, text(p.value)])];
  const { low = 0, high = 0, counts = [] } = s.histogram ?? {};
  const bins = counts.map((n, k) => `${text(low + (k / counts.length) * (high - low))},${text(low + ((k + 1) / counts.length) * (high - low))},${n}`);
  return `quantity,value\n${single.map((row) => row.join()).join("\n")}\n\nfrom,to,pixels\n${bins.join("\n")}\n`;
}
