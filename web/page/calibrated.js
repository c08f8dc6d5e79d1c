// What a calibration of a camera is worth, in words: what was expected, whether it was met, and what to do where it was not.

import { h } from "./dom.js";
import { fixed, significant } from "./format.js";

// How the service's warning begins that the place of the sample was not said.
const TAKEN = "the sample's place is taken for that";

/** Photographs as they are called where they come from; the wizard uploads them in an order. */
const called = (/** @type {string} */ text) => text.replaceAll(/\b(0-sample|1)-(?=\S+\.(png|tiff?|jpe?g)\b)/gi, "");

/**
 * The findings, in the order in which they matter.
 * @param {CalibrationReport} report
 */
export function findings(report) {
  const { geometry, photographs, rms_px: rms } = report;
  const used = photographs.filter((p) => !p.unused_because);
  const unused = photographs.filter((p) => p.unused_because);
  const [focal] = geometry.camera.focal_px;
  const sigma = geometry.sigma.focal_px?.[0] ?? null;
  const share = sigma === null ? null : (100 * sigma) / focal;
  const [across] = geometry.image_px ?? [null];
  const field = across ? (2 * Math.atan(across / 2 / focal) * 180) / Math.PI : null;
  const far = Math.hypot(...geometry.sample.translation_mm);
  const farSigma = geometry.sigma.sample_mm?.[2] ?? null;
  // Where the sample is was chosen step by step, so that what the service took for granted is no warning.
  const [taken, others] = [report.warnings.filter((text) => text.startsWith(TAKEN)), report.warnings.filter((text) => !text.startsWith(TAKEN))];
  const board = called(/board in (.+?):/.exec(taken[0] ?? "")?.[1] ?? "");
  return [
    {
      what: "Corners off the model", got: rms === null ? "not known" : `${fixed(rms, 2)} pixels (root mean square)`, expected: "at most 0.5 pixels", met: rms !== null && rms <= 0.5,
      helps: "The board must be flat, glued to something stiff, and every photograph sharp and still. Take out photographs that fit worse than the others. Check the number of inner corners.",
    },
    {
      what: "Photographs used", got: `${used.length} of ${photographs.length}`, expected: "at least 8", met: used.length >= 8,
      helps: `Take more photographs.${unused.length ? ` Left out: ${unused.map((p) => `${called(p.file)} (${p.unused_because})`).join("; ")}.` : ""}`,
    },
    {
      what: "Focal length", got: `${fixed(focal, 1)} ± ${sigma === null ? "unknown" : significant(sigma, 2)} pixels${share === null ? "" : `, known to ${significant(share, 2)} %`}${field === null ? "" : `; the picture is ${fixed(field, 0)}° wide`}`,
      expected: "known to 0.5 %", met: share !== null && share <= 0.5,
      helps: "Tilt the board more, by 20 to 40° in different directions, and bring it closer, so that it fills the picture: boards seen straight on do not tell how far away they are.",
    },
    {
      what: "Place of the sample", got: `${fixed(far, 1)}${farSigma === null ? "" : ` ± ${significant(farSigma, 2)}`} mm from the camera${board && `, as the board in ${board}`}`, expected: "within 2 % of what a ruler says", met: null,
      helps: "If a ruler says otherwise, the side of a square is wrong, or the photograph that was chosen for the sample's place shows the board elsewhere.",
    },
    ...others.map((text) => ({ what: "Warning", got: called(text), expected: "none", met: false, helps: adviceOn(text) })),
  ];
}

/** What helps against a warning. */
function adviceOn(text) {
  if (text.includes("corners reach")) return "Take some photographs with the board in the corners of the picture.";
  if (text.includes("fits worse")) return "Take that photograph out, or take it again, sharp and still.";
  if (text.includes("folds back")) return "Take photographs with the board in the corners of the picture, so that the lens is known there.";
  if (text.includes("photographs:")) return "Take more photographs, with the board tilted differently.";
  return "";
}

/**
 * The verdict and the findings.
 * @param {CalibrationReport} report
 */
export function verdict(report) {
  return judged(findings(report), report.rms_px === null || report.rms_px > 1.5);
}

/**
 * The same of light and wavelength.
 * @param {CalibrationReport} report
 */
export function lightVerdict(report) {
  const { geometry, highlights = [], band, light_chi2: chi2 } = report;
  const { light_mm: light, wavelength_nm: nm, sigma } = geometry;
  const found = [];
  if (highlights.length) {
    const list = highlights.map(({ file, pixel }) => `${file ?? "picked"} at ${pixel.map((v) => fixed(v, 1)).join(", ")}`).join("; ");
    found.push({ what: "Light in the mirror", got: `${list} pixels`, expected: "where you see it in the photographs", met: null, helps: "If it is elsewhere, something else was brighter: darken the room, shorten the exposure, and take the photograph anew." });
  }
  if (light) {
    const distance = Math.hypot(...light);
    const off = sigma.light_mm ? Math.hypot(...sigma.light_mm) : null;
    found.push({
      what: "Place of the light", got: `${light.map((v, k) => `${fixed(v, 1)} ± ${sigma.light_mm ? significant(sigma.light_mm[k], 2) : "unknown"}`).join(", ")} mm from the sample's middle (right, up, out of it), ${fixed(distance, 0)} mm away`,
      expected: "known to a percent of its distance", met: off !== null && off <= 0.01 * distance,
      helps: "Let the mirror's heights differ more, add another height, or measure how high the light is with a ruler.",
    });
  } else found.push({ what: "Place of the light", got: "not known", expected: "needed for periods under a flash", met: null, helps: "Calibrate anew with photographs of the light in a mirror, if you need it." });
  if (chi2 !== null && chi2 !== undefined) found.push({ what: "Photographs agree", got: `${significant(Math.sqrt(chi2), 2)} times as far apart as they may be`, expected: "at most 3 times", met: chi2 <= 9, helps: "Check the mirror's heights, and that it lay flat: a tilt of a degree moves the light by two." });
  if (nm) {
    const share = sigma.wavelength_nm === null || sigma.wavelength_nm === undefined ? null : (100 * sigma.wavelength_nm) / nm;
    found.push({
      what: "Wavelength", got: `${fixed(nm, 1)} nm${share === null ? "" : ` ± ${significant(sigma.wavelength_nm ?? 0, 2)} nm, known to ${significant(share, 2)} %`}${band ? `; the band is ${fixed(band.fwhm_nm, 1)} nm wide at half its height` : ""}`,
      expected: "known to 0.5 %", met: share === null ? null : share <= 0.5,
      helps: "Use a narrower filter, or say which lamp it is: behind a wide filter an unknown lamp moves the mean.",
    });
  } else found.push({ what: "Wavelength", got: "not known", expected: "needed for periods", met: null, helps: "Calibrate anew with a wavelength, or say it with each result." });
  found.push(...report.warnings.map((text) => ({ what: "Warning", got: text, expected: "none", met: false, helps: "" })));
  return judged(found, false);
}

/** Findings under what they come to. */
export function judged(found, bad) {
  const poor = found.filter((f) => f.met === false);
  const summary = bad ? "This calibration is poor: do not measure with it." : poor.length ? "This calibration can be used; it would be surer with what is said below." : "This calibration is good.";
  return h("div", { class: "stack" },
    h("p", { class: "message verdict", "data-tone": bad ? null : poor.length ? "warn" : "good" }, summary),
    h("ul", { class: "findings" }, found.map(({ what, got, expected, met, helps }) => h("li", {},
      h("p", { class: "row" }, h("strong", {}, what), h("span", { class: "lamp", "data-tone": met === null ? "quiet" : met ? "good" : "warn" }, met === null ? "to be checked" : met ? "as expected" : "not as expected")),
      h("p", {}, got, h("span", { class: "soft" }, ` · expected: ${expected}`)),
      met !== true && helps && h("p", { class: "soft" }, helps)))));
}
