// Offset of orientations: from a result of a sample whose orientations are known.

import { post } from "./api.js";
import { field, h, number, panel, segments, select } from "./dom.js";
import { problemMessage } from "./feedback.js";
import { resultOf } from "./calibrationseries.js";
import { progressOf } from "./calibrationsteps.js";
import { viewable } from "./finding.js";

/**
 * @param {HTMLElement} main
 * @param {string} kind
 * @param {URLSearchParams} state
 * @param {AbortSignal} signal
 */
export async function orientationWizard(main, kind, state, signal) {
  const progress = progressOf(kind, state);
  const items = await viewable(signal, ["polarization"]);
  const input = (/** @type {string} */ key, value = "") => {
    const control = number({ id: `offset-${key}`, value: progress.get(key) ?? value, onchange: () => progress.set({ [key]: control.value || null }) });
    return control;
  };
  const from = select(items.map((job) => [job.id, `${job.title} · ${job.about}`]), progress.get("from") ?? items[0]?.id ?? "", { id: "offset-from", onchange: () => progress.set({ from: from.value }) });
  const [known, sigma, x, y] = [input("known_deg"), input("known_sigma_deg", "0"), input("x"), input("y")];
  const line = h("div", { class: "fields" }, field("Grating vector (°)", known, { hint: "Perpendicular to the lines, anticlockwise from the right of the image" }), field("σ (°)", sigma));
  const disc = h("div", { class: "fields" }, field("Centre, from the left (pixels)", x), field("Centre, from the top (pixels)", y));
  const way = () => progress.get("way") ?? "direction";
  const paint = () => {
    line.hidden = way() !== "direction";
    disc.hidden = way() !== "disc";
  };
  const choice = segments("Known orientation", [["direction", "Direction of a grating"], ["disc", "Centre of a disc"]], way(), (key) => {
    progress.set({ way: key });
    paint();
  });
  paint();
  const result = resultOf({ kind, automatic: false, signal, kept: progress.get("kept"), name: () => "Orientation offset", keeps: (id) => progress.set({ kept: id }) });
  const problems = h("div", { role: "status" });
  const compute = h("button", { type: "submit", id: "compute", class: "primary" }, "Compute");
  const form = h("form", { class: "stack", novalidate: true, onsubmit: async (event) => {
    event.preventDefault();
    problems.replaceChildren();
    const wanted = way() === "disc" ? [x, y] : [known];
    const missing = wanted.find((one) => !Number.isFinite(one.valueAsNumber));
    if (missing) {
      problems.replaceChildren(h("p", { class: "message", role: "alert" }, way() === "disc" ? "State the centre of the disc in pixels." : "State the direction of the grating vector in degrees."));
      return missing.focus();
    }
    compute.disabled = true;
    try {
      const options = way() === "disc" ? { center_px: [x.valueAsNumber, y.valueAsNumber] } : { known_deg: known.valueAsNumber, known_sigma_deg: sigma.valueAsNumber || 0 };
      const job = await post("/operations/orientation", { results: [from.value], options });
      progress.set({ from: from.value, result: job.id, kept: null });
      result.element.querySelector(".before")?.remove();
      result.follow(job.id);
    } catch (problem) {
      problems.replaceChildren(problemMessage(problem));
    }
    compute.disabled = false;
  } }, field("Result of the known sample", from), choice, line, disc, problems, h("div", { class: "row" }, compute));
  main.querySelector(".head")?.append(progress.restart());
  const empty = h("p", {}, "There is no result with orientations yet. Photograph a sample of known orientation in a ", h("a", { href: "#/new" }, "new session"), " of kind polarization.");
  main.append(h("p", { class: "soft lead" }, "Orientations are relative: their offset depends on metal, period and depth of the grating. Reconstruct a sample of the kind to be measured whose orientation is known, such as a disc with circular tracks or a ruled grating."),
    h("div", { class: "columns planning" }, panel("Known sample", null, items.length ? form : empty), panel("Result", null, result.element)));
  const shown = progress.get("result");
  if (shown) result.follow(shown);
  else result.element.prepend(h("p", { class: "soft before" }, "The offset and its standard deviation appear here."));
}
