// Calibrations of the bench: kinds, values with their standard deviations, reports.

import { warned } from "./assetreports.js";
import { facts, h, panel } from "./dom.js";
import { count, duration, fixed, moment, percent, plain, significant } from "./format.js";

/** Kinds in the order in which to calibrate: title and measured property. */
export const KINDS = {
  camera: ["Camera", "Noise, black and white of the camera"],
  flat: ["Flat field", "Unevenness of light and lens"],
  analyser: ["Analyser", "Zero, sense of rotation and extinction of the analyser"],
  retarder: ["Retarder", "Polarization behind the retarder of the panel"],
  orientation: ["Orientation offset", "Offset of orientations, from a sample of known orientation"],
};

/** A value with as many decimals as its standard deviation has, which may be unknown. */
export function measured(/** @type {number} */ value, /** @type {number | null | undefined} */ sigma, unit = "") {
  if (!sigma || !Number.isFinite(sigma)) return `${significant(value, 4)}${unit}`;
  const digits = Math.min(6, Math.max(0, 1 - Math.floor(Math.log10(sigma))));
  return `${fixed(value, digits)}${unit === "°" ? unit : ""} ± ${fixed(sigma, digits)}${unit}`;
}

const turning = (/** @type {number} */ sense) => (sense > 0 ? "anticlockwise" : "clockwise");

/** @type {Record<string, (values: any, report: any) => [string, Child][]>} */
const VALUES = {
  camera: ({ noise, black, white, gain }, report) => [
    ["Read noise", measured(noise.read_noise_e, report?.read_noise_e?.sigma, " e⁻")],
    ["Electrons at full scale", count(noise.full_scale_e)],
    ["Conversion gain", report?.gain_dn_e && `${measured(report.gain_dn_e.value, report.gain_dn_e.sigma)} DN per e⁻`],
    ["Black, white", `${significant(black)}, ${plain(white)} DN`],
    ["Gain setting", plain(gain)],
  ],
  flat: ({ sigma }, report) => [
    ["σ of a pixel", percent(sigma, 2)],
    ["Light of 98 % of the pixels", report?.range && `${percent(report.range[0])} to ${percent(report.range[1])} of the mean`],
  ],
  analyser: ({ zero_deg, zero_sigma_deg, sense, eccentricity_deg: [c, s], extinction_ratio }, report) => [
    ["Zero", measured(zero_deg, zero_sigma_deg, "°")],
    ["Sense of rotation", turning(sense)],
    ["Extinction ratio", extinction_ratio ? `${measured(extinction_ratio, report?.extinction_ratio?.sigma)} : 1` : report?.extinction_at_least ? `at least ${significant(report.extinction_at_least)} : 1` : "not measured"],
    ["Eccentricity", measured(Math.hypot(c, s), report?.eccentricity?.sigma_deg, "°")],
  ],
  retarder: ({ panel_deg, azimuth_deg, azimuth_sigma_deg, retardance_deg, retardance_sigma_deg }, report) => [
    ["Azimuth", measured(azimuth_deg, azimuth_sigma_deg, "°")],
    ["Retardance", measured(retardance_deg, retardance_sigma_deg, "°")],
    ["Polarization of the panel", measured(panel_deg, report?.panel_deg?.sigma, "°")],
  ],
  orientation: ({ offset_deg, sigma_deg, model }) => [
    ["Offset", measured(offset_deg, sigma_deg, "°")],
    ["Grating model", model],
  ],
};

/**
 * Values of a calibration as facts; standard deviations that only the report has need the report.
 * @param {string} kind
 * @param {any} values
 * @param {any} [report]
 */
export const valuesOf = (kind, values, report) => facts(VALUES[kind](values, report));

/** @type {Record<string, (report: any) => [string, Child][]>} */
const REPORTS = {
  camera: (r) => [
    ["Conversion gain", `${measured(r.gain_dn_e.value, r.gain_dn_e.sigma)} DN per e⁻`],
    ["Read noise", measured(r.read_noise_e.value, r.read_noise_e.sigma, " e⁻")],
    ["Black", `${significant(r.black_dn, 4)} DN`],
    ["Saturation", `${significant(r.saturation_dn, 4)} DN${r.full_well_e ? `, ${count(r.full_well_e)} e⁻` : ""}`],
    ["Dark current", r.dark_current_e_s && measured(r.dark_current_e_s.value, r.dark_current_e_s.sigma, " e⁻/s")],
    ["Response", r.response && `corrected, ${percent(r.response.deviation, 2)} from linear before`],
    ["Linearity error", r.linearity_error === null ? null : percent(r.linearity_error, 2)],
    ["Noise model", `reduced χ² ${fixed(r.chi_square, 2)}`],
  ],
  flat: (r) => [
    ["σ of a pixel", percent(r.sigma, 2)],
    ["Light of 98 % of the pixels", `${percent(r.range[0])} to ${percent(r.range[1])} of the mean`],
    ["Photographs", String(r.photographs)],
    ["Saturated pixels", percent(r.saturated, 2)],
  ],
  analyser: (r) => [
    ["Zero", measured(r.zero_deg.value, r.zero_deg.sigma, "°")],
    ["Sense of rotation", turning(r.sense)],
    ["Extinction ratio", r.extinction_ratio ? `${measured(r.extinction_ratio.value, r.extinction_ratio.sigma)} : 1` : `at least ${significant(r.extinction_at_least)} : 1`],
    ["Eccentricity", r.eccentricity && measured(r.eccentricity.amplitude_deg, r.eccentricity.sigma_deg, "°")],
    ["Axis of the polarizer", measured(r.axis_deg.value, r.axis_deg.sigma, "°")],
    ["Repeatability of angles", `${significant(r.angle_sigma_deg, 2)}°`],
    ["Instability of light", percent(r.light_sigma, 3)],
    ["Angles", r.angles.join(", ")],
  ],
  retarder: (r) => [
    ["Azimuth", measured(r.azimuth_deg.value, r.azimuth_deg.sigma, "°")],
    ["Retardance", measured(r.retardance_deg.value, r.retardance_deg.sigma, "°")],
    ["Polarization of the panel", measured(r.panel_deg.value, r.panel_deg.sigma, "°")],
    ["Wavelength", r.wavelength_nm && `${plain(r.wavelength_nm)} nm`],
    ["S1/S0, S2/S0", r.stokes.map((s) => measured(s.value, s.sigma)).join("; ")],
  ],
  orientation: (r) => [
    ["Offset", measured(r.offset_deg.value, r.offset_deg.sigma, "°")],
    ["Spread of differences", `${significant(r.spread_deg, 2)}°`],
    ["Pixels", count(r.pixels)],
    ["Grating model", r.model],
  ],
};

/**
 * Report of a calibration: warnings and values.
 * @param {any} report
 */
export function reportOfReference(report) {
  const rows = REPORTS[report.method]?.(report) ?? [];
  return h("div", { class: "stack" }, warned(report.warnings ?? []), facts([...rows, ["Computed in", report.seconds && duration(report.seconds)]]));
}

/** Age of a calibration. */
export const age = (/** @type {number} */ days) => (days < 1 / 24 ? "less than an hour" : days < 1 ? `${Math.round(24 * days)} h` : `${Math.round(days)} ${Math.round(days) === 1 ? "day" : "days"}`);

/** Progress of an unfinished calibration of a kind, kept in this browser: the query of its page. */
export const drafts = {
  read(/** @type {string} */ kind) {
    try {
      return localStorage.getItem(`nacre-calibration-${kind}`) ?? "";
    } catch {
      return "";
    }
  },
  write(/** @type {string} */ kind, /** @type {string} */ query) {
    try {
      if (query) localStorage.setItem(`nacre-calibration-${kind}`, query);
      else localStorage.removeItem(`nacre-calibration-${kind}`);
    } catch {
      // Without storage, the address of the page keeps the progress.
    }
  },
};

/** Calibrations that a session uses, and its warnings. */
export function calibrationsUsed() {
  const list = h("div", { class: "stack" });
  const element = panel("Calibrations", null, list);
  let shown = "";
  return {
    element,
    update(/** @type {Session} */ { calibration, warnings = [] }) {
      const key = JSON.stringify([calibration, warnings]);
      if (key === shown) return;
      shown = key;
      const used = Object.entries(calibration ?? {}).filter(([kind, one]) => KINDS[kind] && one);
      list.replaceChildren(...warnings.map((text) => h("p", { class: "message", "data-tone": "warn" }, text)),
        used.length ? facts(used.map(([kind, one]) => [KINDS[kind][0], one?.source ? h("a", { href: `#/calibration/${one.source.id}` }, `of ${moment(one.source.taken)}`) : "stated"])) : h("p", { class: "soft" }, "This session uses no calibrations."));
    },
  };
}
