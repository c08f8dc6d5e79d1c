// The options of a polarization reconstruction: model, oblique incidence, offset, smoothing, periods.

import { field, h, number, select } from "./dom.js";
import { MODELS } from "./plan.js";

const ALL_MODELS = [["", "By the illumination: gratings under a circular panel, else plain"], ["plain", "Plain: Stokes, angle and degree of polarization"], ...MODELS];

const SMOOTHINGS = [["none", "None"], ["light", "Light (10 rounds)"], ["strong", "Strong (50 rounds)"]];
const DEMOSAICS = [["none", "None: one pixel per super-pixel"], ["bilinear", "Bilinear: full size"], ["edge-aware", "Edge-aware: full size (Li et al. 2019)"]];
const PERIODS = [
  ["", "None"],
  ["contrast", "From the polarization, for an assumed surface"],
  ["brightness", "From the brightness (heuristic, relative)"],
];
const METALS = ["aluminium", "silver", "gold", "chromium"].map((metal) => [metal, metal]);

/** The fields, as an earlier report left them if there is one; `request()` is their part of what is asked of the service. */
export function optionFields(report = {}) {
  const { method = {} } = report.period ?? {};
  const [low, high] = method.range_um ?? [0.7, 2];
  const model = select(ALL_MODELS, report.model === "plain" ? "plain" : report.model ? "auto" : "", { id: "model" });
  const oblique = h("input", { type: "checkbox", id: "oblique", checked: Boolean(report.oblique?.asked) });
  const obliqueRow = h("label", { class: "check" }, oblique, h("span", {},
    "Take oblique incidence out, where the photographs say where the camera stood and the points are likelier then: worth it near and from the side"));
  const offset = number({ id: "offset", value: report.offset_deg ?? 0 });
  const given = report.smoothing?.strength ?? "light";
  const known = SMOOTHINGS.some(([value]) => value === given);
  const smooth = select(known ? SMOOTHINGS : [...SMOOTHINGS, [given, `${given} rounds`]], given, { id: "smooth" });
  const maps = h("input", { type: "checkbox", id: "smooth-maps", checked: report.smoothing?.map ?? false });
  const mapsRow = h("label", { class: "check" }, maps, h("span", {}, "Smooth the map itself and its σ as well"));
  const full = h("input", { type: "checkbox", id: "smoothed-exr", checked: report.smoothing?.exr ?? false });
  const fullRow = h("label", { class: "check" }, full, h("span", {}, "Also make a smoothed map at full size"));
  const from = select(PERIODS, method.from ?? "", { id: "period-from", onchange: paint });
  const shortest = number({ id: "period-low", value: low, min: 0 });
  const longest = number({ id: "period-high", value: high, min: 0 });
  const depth = number({ id: "period-depth", value: method.depth_um ?? 0.1, min: 0 });
  const metal = select(METALS.some(([m]) => m === method.metal) || !method.metal ? METALS : [...METALS, [method.metal, method.metal]],
    method.metal ?? "aluminium", { id: "period-metal" });
  const above = number({ id: "period-above", value: method.index_above ?? 1, min: 1 });
  const wavelength = number({ id: "period-wavelength", value: method.wavelength_nm ?? "", min: 0 });
  const range = h("div", { class: "fields" }, field("Shortest (µm)", shortest), field("Longest (µm)", longest));
  const assumed = h("div", { class: "fields" }, field("Assumed depth (µm)", depth, { hint: "Peak to peak; 10 % of it are 11 to 18 % of the period" }),
    field("Assumed metal", metal), field("Index above it", above), field("Wavelength (nm)", wavelength, { hint: "Empty: as the photographs say" }));
  function paint() {
    range.hidden = from.value === "";
    assumed.hidden = from.value !== "contrast";
  }
  const demosaic = select(DEMOSAICS, report.sensor?.demosaic ?? "none", { id: "demosaic" });
  const demosaicField = field("Interpolation of sensor frames", demosaic, { hint: "Of monochrome polarization sensors; model plain only" });
  const align = h("input", { type: "checkbox", id: "align", checked: report.registration?.corrected ?? false });
  const alignRow = h("label", { class: "check" }, align, h("span", {}, "Move photographs that are shifted against each other back"));
  // Smoothing, offset, oblique incidence and periods are of gratings.
  const offsetField = field("Offset (°)", offset, { hint: "The method leaves one open; set it where one orientation is known" });
  const smoothField = field("Smoothing of pictures", smooth);
  const periodField = field("Periods", from);
  const ofGratings = () => model.value !== "plain";
  function gratings() {
    for (const row of [obliqueRow, offsetField, smoothField, periodField]) row.hidden = !ofGratings();
    demosaicField.hidden = alignRow.hidden = ofGratings();
    for (const row of [mapsRow, fullRow]) row.hidden = !ofGratings() || smooth.value === "none";
    if (ofGratings()) paint();
    else range.hidden = assumed.hidden = true;
  }
  for (const choice of [model, smooth]) choice.addEventListener("change", gratings);
  gratings();
  const element = h("div", { class: "stack" }, h("div", { class: "fields" }, field("Model", model), offsetField, demosaicField),
    alignRow, obliqueRow, smoothField, mapsRow, fullRow, periodField, range, assumed);
  function period() {
    const range_um = [shortest.valueAsNumber, longest.valueAsNumber];
    if (from.value === "") return null;
    if (from.value === "brightness") return { from: "brightness", range_um };
    const asked = { from: "contrast", range_um, depth_um: depth.valueAsNumber, metal: metal.value, index_above: above.valueAsNumber };
    return Number.isFinite(wavelength.valueAsNumber) ? { ...asked, wavelength_nm: wavelength.valueAsNumber } : asked;
  }
  return {
    element,
    /** @returns {Record<string, any>} */
    request: () => (ofGratings()
      ? {
        method: "polarization", ...(model.value && { model: model.value }), oblique: oblique.checked ? "auto" : "off", offset_deg: offset.valueAsNumber || 0,
        smooth: smooth.value, smooth_maps: maps.checked && smooth.value !== "none", smoothed_exr: full.checked && smooth.value !== "none", period: period(),
      }
      : { method: "polarization", model: "plain", align: align.checked ? "auto" : "off", demosaic: demosaic.value }),
  };
}
