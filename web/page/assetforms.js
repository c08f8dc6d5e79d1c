// The options of a foil's photograph, of photographs of a board, and of edits of maps.

import { field, h, number, select } from "./dom.js";

const one = (input) => (Number.isFinite(input.valueAsNumber) ? input.valueAsNumber : null);
const pair = (id, values, attributes) => [0, 1].map((k) => number({ id: `${id}-${k}`, value: values?.[k] ?? "", ...attributes }));
const both = (inputs) => {
  const values = inputs.map(one);
  return values.includes(null) ? null : values;
};

/** What was said, without what was left empty. */
function said(given, all) {
  const options = { ...given };
  for (const [name, value] of Object.entries(all)) if (value === null) delete options[name]; else options[name] = value;
  return options;
}

/** A file field for a geometry.json; `value()` is what is in it, or what was known before. */
export function geometryField(id, known = null) {
  let where = known;
  const input = h("input", { type: "file", id, accept: ".json", onchange: read });
  async function read() {
    const file = input.files?.[0];
    where = known;
    input.setCustomValidity("");
    if (!file) return;
    try {
      where = JSON.parse(await file.text());
    } catch {
      input.setCustomValidity("This is no JSON: give a geometry.json, as a calibration writes it");
      input.reportValidity();
    }
  }
  return { input, value: () => where };
}

/** A foil's photograph. */
export function foilFields(given = {}) {
  const geometry = geometryField("foil-geometry", given.geometry);
  const periods = pair("foil-period", given.period_um, { min: 0.1 });
  const depth = number({ id: "foil-depth", value: given.depth_um ?? "", min: 0 });
  const height = number({ id: "foil-light", value: given.light_height_mm ?? "", min: 0 });
  const bins = pair("foil-bins", given.bins, { min: 4, max: 2048, step: 1 });
  const element = h("div", { class: "fields" },
    field("Calibration", geometry.input, { hint: given.geometry ? "As before, or another geometry.json" : "geometry.json: camera, foil, light and wavelength" }),
    field("Light above the foil (mm)", height, { hint: "Empty: as the calibration says" }),
    field("Shortest period (µm)", periods[0], { hint: "Empty: as far as the photograph shows" }), field("Longest period (µm)", periods[1]),
    field("Depth of the gratings (µm)", depth, { hint: "Takes second and third orders out" }),
    field("Bins of orientation", bins[0], { hint: "Empty: as fine as pixels allow" }), field("Bins of period", bins[1]));
  return {
    element,
    options: () => said(given, { geometry: geometry.value(), period_um: both(periods), depth_um: one(depth), light_height_mm: one(height), bins: both(bins) }),
  };
}

/** Photographs of a board. */
export function boardFields(given = {}) {
  const board = pair("board-corners", given.board ?? [9, 6], { min: 2, max: 64, step: 1 });
  const square = number({ id: "board-square", value: given.square_mm ?? 25, min: 0 });
  const wavelength = number({ id: "board-wavelength", value: given.wavelength_nm ?? "", min: 200, max: 2000 });
  const element = h("div", { class: "fields" },
    field("Inner corners across", board[0], { hint: "One less than squares" }), field("Inner corners down", board[1]),
    field("Side of a square (mm)", square), field("Wavelength (nm)", wavelength, { hint: "Of the light that will be used, if it is known" }));
  return { element, options: () => said(given, { board: both(board), square_mm: one(square), wavelength_nm: one(wavelength) }) };
}

/** Edits of maps. */
export function mapFields(given = {}) {
  const curve = Object.keys(given.period ?? {})[0] ?? "";
  const turn = number({ id: "map-turn", value: given.rotate_deg ?? "" });
  const factor = number({ id: "map-resample", value: given.resample ?? "", min: 0.001, max: 1000 });
  const copies = pair("map-tile", given.tile, { min: 1, max: 10000, step: 1 });
  const layout = select([["repeat", "Side by side"], ["mirror", "Every other one mirrored"], ["brick", "Like bricks"]], given.layout ?? "repeat", { id: "map-layout" });
  const offset = number({ id: "map-offset", value: given.orientation_offset_deg ?? "" });
  const follows = select([["", "As measured"], ["quadratic", "Follow orientations, squared"], ["sine_squared", "Follow orientations, sine squared"]], curve in { quadratic: 1, sine_squared: 1 } ? curve : "", { id: "map-curve", onchange: paint });
  const ends = pair("map-ends", given.period?.[curve] ?? [0.8, 1.6], { min: 0.01 });
  const scale = number({ id: "map-scale", value: given.scale ?? "", min: 0 });
  const shift = number({ id: "map-shift", value: given.offset_um ?? "" });
  const clamp = pair("map-clamp", given.clamp_um, { min: 0 });
  const between = h("div", { class: "fields" }, field("Period at 0° (µm)", ends[0]), field("Period at 180° (µm)", ends[1]));
  function paint() {
    between.hidden = !follows.value;
  }
  paint();
  const element = h("div", { class: "stack" },
    h("div", { class: "fields" },
      field("Turn all by (°)", turn, { hint: "Anticlockwise; empty: not" }), field("Turn orientations alone by (°)", offset),
      field("Pixels along a side, times", factor), field("Copies lie", layout),
      field("Copies across", copies[0]), field("Copies down", copies[1]),
      field("Periods", follows)),
    between,
    h("div", { class: "fields" }, field("Periods times", scale), field("Added to periods (µm)", shift),
      field("Least period (µm)", clamp[0]), field("Most (µm)", clamp[1])));
  return {
    element,
    options: () => said(given, {
      rotate_deg: one(turn), resample: one(factor), tile: both(copies), layout: layout.value, orientation_offset_deg: one(offset),
      period: follows.value && both(ends) ? { [follows.value]: both(ends) } : null, scale: one(scale), offset_um: one(shift), clamp_um: both(clamp),
    }),
  };
}
