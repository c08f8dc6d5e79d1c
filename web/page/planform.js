// The form of a plan: fields that belong to the chosen kind, and what is wrong with each.

import { check, field, h, select } from "./dom.js";
import { KINDS, MODELS } from "./plan.js";
import { stepsEditor } from "./steps.js";

/** The form over `values`, which it changes; `changed()` is called after each change. */
export function planForm(values, changed) {
  const holders = {};
  const set = (key, value) => {
    values[key] = value;
    paint();
    changed();
  };
  const keep = (key, element) => {
    holders[key] = element;
    element.append(h("span", { class: "problem", role: "status" }));
    return element;
  };
  const text = (key, label, options = {}) =>
    keep(key, field(label, h("input", {
      id: `plan-${key}`, value: values[key], autocomplete: "off", inputmode: options.numeric ? "decimal" : "text",
      spellcheck: "false", oninput: (e) => set(key, e.target.value),
    }), options));
  const area = (key, label, options = {}) =>
    keep(key, field(label, h("textarea", { id: `plan-${key}`, rows: 3, value: values[key], oninput: (e) => set(key, e.target.value) }), { wide: true, ...options }));
  const list = (key, label, options) =>
    field(label, select(options, values[key], { id: `plan-${key}`, onchange: (e) => set(key, e.target.value) }));
  const tick = (key, label) => check(label, { id: `plan-${key}`, checked: values[key], onchange: (e) => set(key, e.target.checked) });
  const group = (title, ...children) => h("fieldset", { class: "panel" }, h("legend", {}, title), ...children);
  const fields = (...children) => h("div", { class: "fields" }, children);

  const kinds = h("div", { class: "kinds", role: "radiogroup", "aria-label": "Kind" }, KINDS.map(([key, label, about]) =>
    h("label", { class: "kind" },
      h("input", { type: "radio", name: "kind", value: key, checked: values.kind === key, onchange: () => set("kind", key) }),
      h("span", {}, h("strong", {}, label), h("small", {}, about)))));

  const angleMode = list("angles", "Angles", [["range", "From, to, step"], ["list", "List"], ["none", "Leave the analyser alone"]]);
  const rangeFields = ["start", "stop", "step"].map((key, i) => text(key, ["From (°)", "To (°)", "Step (°)"][i], { numeric: true }));
  const listField = text("list", "Angles (°)", { hint: "In the order they are taken", wide: true, numeric: true });
  const analyser = group("Analyser", fields(angleMode, rangeFields, listField));

  const exposureMode = field("Exposure", select([["meter", "Metered"], ["fixed", "Given"]], values.metered ? "meter" : "fixed",
    { id: "plan-metered", onchange: (e) => set("metered", e.target.value === "meter") }));
  const exposure = text("exposure_ms", "Exposure (ms)", { numeric: true });
  const exposures = text("exposures_ms", "Exposures (ms)", { wide: true, numeric: true });
  const camera = group("Camera", fields(exposures, exposureMode, exposure, text("gain", "Gain", { numeric: true }),
    text("average", "Average of", { numeric: true }),
    text("roi", "Region of interest", { hint: "Left, top, width, height in pixels; empty for the whole frame", wide: true, numeric: true })));

  const discFields = [text("diameter_mm", "Diameter (mm)", { numeric: true }), text("center_mm", "Middle x, y (mm)", { numeric: true })];
  const display = group("Panel", fields(list("pattern", "Pattern", [["disc", "Disc"], ["black", "Black"]]), discFields));
  const spots = group("Spots", fields(area("spots", "Middles (mm)", { hint: "One a line: right, up from the panel's middle" }),
    text("spot_diameter_mm", "Diameter (mm)", { numeric: true })));
  const steps = stepsEditor(values.steps, changed);
  const stepsGroup = group("Frames", steps.element);

  const model = list("model", "Model", MODELS);
  const reconstruct = h("div", { class: "fields" }, tick("reconstruct", "Reconstruct the orientation map at once"), model);
  const about = group("Session", h("div", { class: "stack" }, fields(text("name", "Name"), text("sample", "Sample"), text("operator", "Operator")),
    area("notes", "Notes")));
  const besides = group("Extra frames and result", h("div", { class: "stack" },
    tick("dark", "Dark frame, behind the closed shutter"), tick("display_black", "Frame with all light off (subtracted)"), reconstruct));

  function paint() {
    const { kind } = values;
    analyser.hidden = kind === "free";
    // Polarization needs angles; the other kinds can leave the analyser alone.
    const none = angleMode.querySelector('[value="none"]');
    none.hidden = none.disabled = kind === "polarization";
    const mode = kind === "polarization" && values.angles === "none" ? "range" : values.angles;
    angleMode.querySelector("select").value = mode;
    for (const f of rangeFields) f.hidden = mode !== "range";
    listField.hidden = mode !== "list";
    exposures.hidden = kind !== "exposures";
    exposureMode.hidden = kind === "exposures";
    exposure.hidden = kind === "exposures" || values.metered;
    display.hidden = kind === "spots";
    for (const f of discFields) f.hidden = values.pattern !== "disc";
    spots.hidden = kind !== "spots";
    stepsGroup.hidden = kind !== "free";
    reconstruct.hidden = kind !== "polarization";
    model.hidden = !values.reconstruct;
  }
  paint();
  return {
    element: h("div", { class: "stack plan" }, group("Kind", kinds), about, analyser, spots, stepsGroup, h("div", { class: "columns pair" }, camera, display), besides),
    /** Shows what is wrong, by field. */
    mark(problems) {
      for (const [key, holder] of Object.entries(holders)) {
        holder.lastElementChild.textContent = problems[key] ?? "";
        holder.querySelector("input, textarea").setAttribute("aria-invalid", String(key in problems));
      }
      steps.mark(problems);
    },
  };
}
