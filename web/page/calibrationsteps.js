// Calibration of camera, flat field, analyser and retarder step by step. The address keeps the progress: sessions, options, result.

import { post } from "./api.js";
import { field, h, number, say, segments, select } from "./dom.js";
import { problemMessage } from "./feedback.js";
import { lightCheck, resultOf, series } from "./calibrationseries.js";
import { lightingPanel } from "./lighting.js";
import { previewPanel } from "./preview.js";
import { drafts, KINDS } from "./references.js";
import { watch } from "./service.js";
import { guided, stepOf } from "./wizard.js";

/** Instructions of the first step of each kind. */
const SETUP = {
  camera: ["Even light", "Place white paper on the sample table, and defocus the lens until no structure of the paper is visible."],
  flat: ["Uniform surface", "Place white paper or a mirror on the sample table. Set lens, aperture and focus as in the sessions."],
  analyser: ["Polarizer on a mirror", "Place a mirror on the sample table, and on it a linear polarizer whose axis is about 20° anticlockwise from the right of the image."],
  retarder: ["Mirror", "Place a front-surface mirror on the sample table. The film remains on the panel."],
};

/** Default direction of the polarizer's axis in degrees. */
const AXIS_DEG = 20;

/**
 * The address of a page with its progress.
 * @param {string} kind
 * @param {URLSearchParams} state
 */
export function progressOf(kind, state) {
  const keep = () => {
    const query = state.toString();
    history.replaceState(null, "", `#/calibration/${kind}${query && `?${query}`}`);
    drafts.write(kind, state.has("kept") ? "" : query);
  };
  return {
    get: (/** @type {string} */ key) => state.get(key),
    /** Sets values; those that are null are removed. */
    set(/** @type {Record<string, string | null>} */ values) {
      for (const [key, value] of Object.entries(values)) value === null ? state.delete(key) : state.set(key, value);
      keep();
    },
    /** A button that discards the progress. */
    restart: () => h("button", { type: "button", id: "start-over", onclick: () => {
      drafts.write(kind, "");
      history.replaceState(null, "", `#/calibration/${kind}`);
      dispatchEvent(new HashChangeEvent("hashchange"));
    } }, "Start over"),
  };
}

/**
 * @param {HTMLElement} main
 * @param {string} kind
 * @param {URLSearchParams} state
 * @param {AbortSignal} signal
 */
export async function referenceWizard(main, kind, state, signal) {
  const progress = progressOf(kind, state);
  const lighting = lightingPanel();
  const steps = { camera: single, flat: single, analyser, retarder }[kind]?.(kind, progress, signal) ?? [];
  main.querySelector(".head")?.append(progress.restart());
  main.append(h("div", { class: "columns bench" }, guided(steps), previewPanel(signal, lighting)));
  watch(({ devices }) => devices && lighting.update(devices), signal);
}

/** @typedef {ReturnType<typeof progressOf>} Progress */

/**
 * The first step: what to place on the table, and the check of the light. Photographs that exist need no check.
 * @param {string} kind
 * @param {Progress} progress
 * @param {AbortSignal} signal
 * @param {...Child} more
 */
function setup(kind, progress, signal, ...more) {
  const [title, text] = SETUP[kind];
  const check = lightCheck(signal);
  if (progress.get("first")) check.element.querySelector(".primary")?.classList.remove("primary");
  return stepOf(title, "no saturated pixels, and brightest pixels above 10 % of white",
    () => (progress.get("first") ? [true, "done"] : check.met() ? [true, "as expected"] : [false, "not checked"]), h("p", {}, text), ...more, check.element);
}

/**
 * @param {string} title
 * @param {string} text
 * @param {ReturnType<typeof series>} photographs
 * @param {...Child} more
 */
const seriesStep = (title, text, photographs, ...more) => stepOf(title, "all frames are taken",
  () => (photographs.done() ? [true, "done"] : [false, photographs.session()?.state ?? "to do"]), h("p", {}, text), ...more, photographs.element);

/**
 * @param {string} kind
 * @param {string} name
 * @param {object} more
 */
const planOf = (kind, name, more = {}) => ({ kind: "calibration", name, calibration: { of: kind, ...more } });

/** Kinds whose session computes and stores the calibration. */
function single(kind, progress, signal) {
  const result = results(kind, progress, signal, true);
  const darkness = select([["dark", "Camera shutter"], ["display_black", "Panel black, in a dark room (camera without shutter)"]], progress.get("darkness") ?? "dark", { id: "darkness", onchange: () => {
    progress.set({ darkness: darkness.value });
    photographs.estimate();
  } });
  const photographs = series({ key: "first", signal, id: progress.get("first"), began: (id) => progress.set({ first: id, kept: null }),
    plan: () => planOf(kind, KINDS[kind][0], kind === "camera" && darkness.value !== "dark" ? { darkness: darkness.value } : {}) });
  const text = kind === "camera" ? "The session takes frames of even light and of darkness at several exposures. Keep gain, lens and light as they are." : "The session takes frames under the light of the sessions, and one of ambient light. Do not touch lens or surface.";
  const shoot = seriesStep("Photographs", text, photographs, kind === "camera" ? field("Frames of darkness", darkness) : null);
  const last = stepOf("Result", "no warnings", () => [result.done(), result.done() ? "stored" : "not stored"], result.element);
  shoot.element.addEventListener("judge", () => {
    const session = photographs.session();
    if (photographs.done() && session?.has_results) result.follow(session.id);
  });
  return [setup(kind, progress, signal), shoot, last];
}

/** Result whose storage the address records. */
function results(kind, progress, signal, automatic = false) {
  return resultOf({ kind, automatic, signal, kept: progress.get("kept"), name: () => KINDS[kind][0], keeps: (id) => progress.set({ kept: id }) });
}

/**
 * The last step: computes a result of two sessions or options, shows it, and stores it.
 * @param {string} kind
 * @param {Progress} progress
 * @param {AbortSignal} signal
 * @param {() => object} options
 * @param {HTMLElement} [fields]
 */
function computeStep(kind, progress, signal, options, fields) {
  const result = results(kind, progress, signal);
  const problems = h("div", { role: "status" });
  const compute = h("button", { type: "button", id: "compute", onclick: async () => {
    compute.disabled = true;
    problems.replaceChildren();
    try {
      const job = await post(`/operations/${kind}`, { session: progress.get("first"), upload: null, options: options() });
      progress.set({ result: job.id, kept: null });
      result.follow(job.id);
    } catch (problem) {
      problems.replaceChildren(problemMessage(problem));
    }
    compute.disabled = false;
    paint();
  } }, "Compute");
  const paint = () => {
    say(compute, progress.get("result") ? "Compute again" : "Compute");
    compute.classList.toggle("primary", !progress.get("result"));
  };
  paint();
  const shown = progress.get("result");
  if (shown) result.follow(shown);
  return stepOf("Result", "no warnings", () => [result.done(), result.done() ? "stored" : "not stored"], fields, h("div", { class: "row" }, compute), problems, result.element);
}

/** A field of degrees that the address records. */
function degreesField(progress, key, value, label, hint) {
  const input = number({ id: `calibration-${key}`, value: progress.get(key) ?? value, onchange: () => progress.set({ [key]: input.value || null }) });
  return Object.assign(field(label, input, { hint }), { value: () => (Number.isFinite(input.valueAsNumber) ? input.valueAsNumber : null) });
}

function analyser(kind, progress, signal) {
  const axis = degreesField(progress, "axis_deg", String(AXIS_DEG), "Axis of the polarizer (°)", "Anticlockwise from the right of the image, within 20°; not near 0°, 45° or 90°");
  const take = (key, name) => series({ key, signal, id: progress.get(key), began: (id) => progress.set({ [key]: id, result: null, kept: null }), plan: () => planOf(kind, name) });
  const [first, second] = [take("first", "Analyser, front"), take("second", "Analyser, turned over")];
  return [
    setup(kind, progress, signal, axis),
    seriesStep("Front", "The session turns the analyser through a full turn, and to angles near the crossed direction.", first),
    seriesStep("Turned over", "Turn the polarizer over about a vertical line of the image, as a page of a book, and place it on the mirror again.", second),
    computeStep(kind, progress, signal, () => ({ axis_deg: axis.value(), flipped: `session:${progress.get("second")}` })),
  ];
}

function retarder(kind, progress, signal) {
  const take = (key, name) => series({ key, signal, id: progress.get(key), began: (id) => progress.set({ [key]: id, result: null, kept: null }), plan: () => planOf(kind, name) });
  const [first, second] = [take("first", "Retarder, with film"), take("second", "Retarder, without film")];
  const panel = degreesField(progress, "panel_deg", "", "Polarization of the panel (°)", "Anticlockwise from the right of the image");
  const sigma = degreesField(progress, "panel_sigma_deg", "0.5", "σ of that direction (°)", "Standard deviation, 0 or more");
  const azimuth = degreesField(progress, "azimuth_deg", "", "Axis of the film (°, optional)", "Within 40°. Default: 45° from the panel’s polarization");
  const stated = h("div", { class: "fields" }, panel, sigma);
  const measuring = h("div", { class: "stack" }, h("p", {}, "Remove the film from the panel. Do not move mirror or panel."), second.element);
  const way = () => progress.get("way") ?? "bare";
  const choice = segments("Polarization of the panel", [["bare", "Film removed"], ["stated", "Film cannot be removed"]], way(), (key) => {
    progress.set({ way: key });
    paint();
  });
  const paint = () => {
    measuring.hidden = way() !== "bare";
    stated.hidden = way() !== "stated";
    choice.dispatchEvent(new Event("judge", { bubbles: true }));
  };
  const bare = stepOf("Polarization of the panel", "all frames without film are taken, or the direction is stated",
    () => (way() === "bare" ? (second.done() ? [true, "done"] : [false, second.session()?.state ?? "to do"]) : panel.value() === null ? [false, "direction missing"] : [true, "stated"]), choice, measuring, stated);
  paint();
  return [
    setup(kind, progress, signal, h("p", { class: "soft" }, "Calibrate the analyser first: directions refer to its zero.")),
    seriesStep("With film", "The session turns the analyser through a full turn.", first),
    bare,
    computeStep(kind, progress, signal, () => ({
      ...(way() === "bare" ? { bare: `session:${progress.get("second")}` } : { panel_deg: panel.value(), panel_sigma_deg: sigma.value() ?? 0 }),
      ...(azimuth.value() !== null && { azimuth_deg: azimuth.value() }) }), azimuth),
  ];
}
