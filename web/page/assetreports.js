// Reports of foil, calibrations and edited maps.

import { facts, figures, h } from "./dom.js";
import { duration, fixed, percent, plain, significant, words } from "./format.js";

/** Warnings, or that there are none. */
export const warned = (warnings) => warnings.length
  ? h("ul", { class: "problems" }, warnings.map((w) => h("li", { class: "message", "data-tone": "warn" }, w)))
  : h("p", { class: "message", "data-tone": "good" }, "No warnings.");

/** How a foil's dots are distributed. */
export function reportOfFoil(report) {
  const [mean, spread] = report.period_um;
  return h("div", { class: "stack" }, warned(report.warnings ?? []),
    figures([
      ["mean period", `${fixed(mean, 3)} µm`],
      ["spread of periods", `${fixed(spread, 3)} µm`],
      ["of the bins seen", percent(report.covered, 0)],
    ]),
    facts([
      ["Bins", `${report.bins[0]} of orientation, ${report.bins[1]} of period`],
      ["Lines", `${report.lines_per_um.map((v) => fixed(1000 * v, 0)).join(" to ")} per mm`],
      ["Zero order", report.zero_order_off_px === null ? "not in the picture" : `${fixed(report.zero_order_off_px, 2)} pixels from where the geometry has it`],
      ["Stray light", significant(report.background)],
      ["Periods are", report.relative ? "relative" : "absolute"],
      ["Took", report.seconds && duration(report.seconds)],
    ]));
}

/**
 * A camera and where it stands.
 * @param {CalibrationReport} report
 */
export function reportOfCalibration(report) {
  const { geometry, photographs = [] } = report;
  const { camera, sigma } = geometry;
  const told = (values, sigmas, digits) => values.map((v, k) => `${fixed(v, digits)}${sigmas ? ` ± ${fixed(sigmas[k], digits)}` : ""}`).join(", ");
  const unused = photographs.filter((p) => p.unused_because);
  return h("div", { class: "stack" }, warned(report.warnings ?? []),
    figures([
      ["corners off the model (RMS)", `${fixed(report.rms_px, 3)} pixels`],
      ["photographs used", `${photographs.length - unused.length} of ${photographs.length}`],
      ["focal length", `${fixed(camera.focal_px[0], 1)} pixels`],
    ]),
    facts([
      ["Focal lengths", `${told(camera.focal_px, sigma.focal_px, 2)} pixels`],
      ["Axis", `${told(camera.center_px, sigma.center_px, 2)} pixels`],
      ["Distortion", told(camera.distortion, sigma.distortion, 4)],
      ["Sample", `${geometry.sample.translation_mm.map((v) => fixed(v, 1)).join(", ")} mm from the camera`],
      ["Wavelength", geometry.wavelength_nm && `${plain(geometry.wavelength_nm)} nm`],
      ["Left out", unused.map((p) => `${p.file}: ${p.unused_because}`).join("; ")],
    ]));
}

const EDITS = {
  rotate_deg: "Turned by (°)", resample: "Pixels along a side, times", tile: "Copies", size: "Size", layout: "Copies lie", orientation_offset_deg: "Orientations turned by (°)",
  period: "Periods follow", scale: "Periods times", offset_um: "Added to periods (µm)", clamp_um: "Periods between (µm)",
};

/** What was given to an edit, as a person reads it. */
const given = (value) => (Array.isArray(value) ? value.map(given).join(", ") : typeof value === "object" ? Object.entries(value).map(([k, v]) => `${words(k)}: ${given(v)}`).join("; ") : typeof value === "string" ? words(value) : plain(value));

/** Maps before and after. */
export function reportOfMap(report) {
  const told = ({ width, height, maps }) => `${width} × ${height}: ${Object.entries(maps).map(([name, m]) => `${name}, ${m.known_pixels} pixels${m.range ? `, ${m.range.map((v) => fixed(v, 3)).join(" to ")}` : ""}`).join("; ")}`;
  const edits = Object.entries(report.edits).filter(([, value]) => value !== null);
  return h("div", { class: "stack" }, warned(report.warnings ?? []),
    facts([["Before", told(report.before)], ["After", told(report.after)], ...edits.map(([name, value]) => /** @type {[string, Child]} */ ([EDITS[name] ?? words(name), given(value)]))]));
}
