// A merged photograph on a canvas: its linear values under a slider of the exposure, saturated and dark places marked.

import { get, send } from "./api.js";
import { check, h, pen, say } from "./dom.js";
import { complain } from "./feedback.js";
import { fixed } from "./format.js";
import { TILE } from "./tiles.js";

/** Longest side on the canvas in pixels; larger photographs are shown from their means. */
const MOST = 1024;
/** Share of the values that is below white at the exposure 0. */
const BELOW_WHITE = 0.99;
const SATURATED = [255, 60, 60];
const DARK = [60, 90, 255];

/**
 * The values of a map, reduced to at most `MOST` pixels a side.
 * @param {string} base
 * @param {MapInfo} info
 * @param {AbortSignal} signal
 */
async function planeOf(base, info, signal) {
  const level = Math.min(info.levels - 1, Math.max(0, Math.ceil(Math.log2(Math.max(info.width, info.height) / MOST))));
  const [width, height] = [info.width, info.height].map((n) => Math.ceil(n / 2 ** level));
  const values = new Float32Array(width * height);
  const columns = Math.ceil(width / TILE);
  const fetchTile = async (/** @type {number} */ k) => {
    const [column, row] = [k % columns, Math.floor(k / columns)];
    const tile = new Float32Array(await (await send(`${base}/tiles/${encodeURIComponent(info.name)}/${level}/${column}/${row}`, { signal })).arrayBuffer());
    const wide = Math.min(TILE, width - TILE * column);
    for (let y = 0; y * wide < tile.length; y++) values.set(tile.subarray(y * wide, (y + 1) * wide), (TILE * row + y) * width + TILE * column);
  };
  // One after the other, as a browser has few connections for a host and STOP must not wait for one.
  for (let k = 0; k < columns * Math.ceil(height / TILE); k++) await fetchTile(k);
  return { width, height, values };
}

/**
 * The view, or null where the result has no merged light.
 * @param {string} id
 * @param {AbortSignal} signal
 */
export async function hdrView(id, signal) {
  const base = `/reconstructions/${id}`;
  /** @type {MapInfo[]} */
  const maps = await get(`${base}/maps`, { signal });
  const named = (/** @type {string} */ file, /** @type {string[]} */ channels) => maps.filter((m) => channels.some((c) => m.name === `${file}.${c}`)).sort((a, b) => channels.indexOf(a.name.slice(-1)) - channels.indexOf(b.name.slice(-1)));
  const colours = named("hdr", ["R", "G", "B"]);
  const light = colours.length === 3 ? colours : named("hdr", ["Y"]);
  if (light.length === 0) return null;
  const flags = named("flags", light.length === 3 ? ["G"] : ["Y"]);
  const canvas = h("canvas", { id: "hdr-view", role: "img", "aria-label": "The merged photograph at the chosen exposure" });
  const stops = h("output", { for: "exposure" }, "0 stops");
  const slider = h("input", { type: "range", id: "exposure", min: -10, max: 10, step: 0.25, value: 0, disabled: true, oninput: () => paint() });
  const marks = check("Mark saturated (red) and dark (blue) pixels", { id: "hdr-marks", onchange: () => paint() });
  /** @type {{ width: number, height: number, values: Float32Array }[]} */
  let planes = [];
  /** @type {Float32Array | null} */
  let state = null;
  let white = 1;

  function paint() {
    if (!planes.length) return;
    say(stops, `${slider.valueAsNumber > 0 ? "+" : ""}${fixed(slider.valueAsNumber, 2)} stops`);
    const { width, height } = planes[0];
    const scale = 2 ** slider.valueAsNumber / white;
    const image = new ImageData(width, height);
    for (let i = 0; i < width * height; i++) {
      const mark = marks.box.checked && state && state[i] >= 0.5 ? (state[i] >= 1.5 ? DARK : SATURATED) : null;
      for (let c = 0; c < 3; c++) {
        const value = planes[Math.min(c, planes.length - 1)].values[i] * scale;
        // Light that every exposure saturates is not a number, and white.
        image.data[4 * i + c] = mark ? mark[c] : Number.isNaN(value) ? 255 : 255 * (value <= 0.0031308 ? 12.92 * Math.max(0, value) : 1.055 * Math.min(1, value) ** (1 / 2.4) - 0.055);
      }
      image.data[4 * i + 3] = 255;
    }
    pen(canvas).putImageData(image, 0, 0);
  }

  async function load() {
    planes = await Promise.all(light.map((info) => planeOf(base, info, signal)));
    if (flags[0]) state = (await planeOf(base, flags[0], signal)).values;
    const { width, height } = planes[0];
    [canvas.width, canvas.height] = [width, height];
    const sorted = planes.at(-1)?.values.filter((v) => v > 0).sort() ?? new Float32Array();
    white = sorted[Math.floor(BELOW_WHITE * (sorted.length - 1))] ?? 1;
    slider.disabled = false;
    paint();
  }
  load().catch((problem) => problem.name !== "AbortError" && complain(problem));
  return { canvas, controls: h("div", { class: "stack" }, h("div", { class: "row exposure" }, h("label", { for: "exposure" }, "Exposure"), slider, stops), marks) };
}
