// The form of a plan: fields that belong to the chosen kind, and what is wrong with each.

import { check, field, h, part, select } from "./dom.js";
import { operationForm } from "./operationform.js";
import { EXPOSING, exposingOf, KINDS, methodOf, methodsOf, MODELS, ofKind } from "./plan.js";
import { stepsEditor } from "./steps.js";

/** Methods with options of their own in a plan, and the options that need photographs. */
const WITHOUT = { lut: ["light"], bokeh: [], spots: ["polarization"], flash: ["corners_px", "reference_px"] };

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
      h("input", { type: "radio", name: "kind", value: key, checked: values.kind === key, onchange: () => {
        ofKind(values, key);
        set("kind", key);
      } }),
      h("span", {}, h("strong", {}, label), h("small", {}, about)))));

  const angleMode = list("angles", "Angles", [["range", "From, to, step"], ["list", "List"], ["until", "Until σ is small enough"], ["none", "Leave the analyser alone"]]);
  const rangeFields = ["start", "stop", "step"].map((key, i) => text(key, ["From (°)", "To (°)", "Step (°)"][i], { numeric: true }));
  const listField = text("list", "Angles (°)", { hint: "In the order they are taken", wide: true, numeric: true });
  const untilFields = [
    text("until_sigma_deg", "Wanted σ (°)", { hint: "Of 90 % of the pixels with an orientation", numeric: true }),
    text("begin", "Angles to begin with", { numeric: true }), text("at_most", "Most angles", { numeric: true }),
  ];
  const analyser = group("Analyser", fields(angleMode, rangeFields, listField, untilFields));

  const exposureMode = list("exposing", "Exposure", [["meter", "Metered"], ["fixed", "Given"], ["several", "Several, as listed"], ["bracket", "A bracket, worked out by metering"]]);
  const brackets = text("brackets", "Exposures at each angle (ms)", { hint: "Merged: short ones for what is bright, long ones for what is dark", wide: true, numeric: true });
  const exposure = text("exposure_ms", "Exposure (ms)", { numeric: true });
  const exposures = text("exposures_ms", "Exposures (ms)", { hint: "Merged into one photograph where one view is taken", wide: true, numeric: true });
  const bracketFields = [text("step_ev", "Step (EV)", { hint: "2 is four times longer each", numeric: true }), text("bracket_most", "Most exposures", { numeric: true })];
  const camera = group("Camera", fields(exposureMode, exposures, bracketFields, exposure, brackets, text("gain", "Gain", { numeric: true }),
    text("average", "Average of", { numeric: true }),
    text("roi", "Region of interest", { hint: "Left, top, width, height in pixels; empty for the whole frame. The bench page draws it on the live picture", wide: true, numeric: true })));

  const discFields = [text("diameter_mm", "Diameter (mm)", { numeric: true }), text("center_mm", "Middle x, y (mm)", { numeric: true })];
  const display = group("Panel", fields(list("pattern", "Pattern", [["disc", "Disc"], ["black", "Black"]]), discFields));
  const fringeFields = [
    text("fringes", "Fringes", { hint: "Empty: as many as the camera's noise asks for", numeric: true }), text("phases", "Phases of each", { numeric: true }),
    text("finest_mm", "Finest period (mm)", { numeric: true }), text("period_percent", "Wanted σ of a period (%)", { numeric: true }),
    text("undecided_percent", "Add fringes until undecided (%)", { hint: "Of the pixels with a first order. Empty: none are added", numeric: true }),
  ];
  const discsFields = [area("spots", "Middles of discs (mm)", { hint: "One a line: right, up from the panel's middle" }),
    text("spot_diameter_mm", "Diameter (mm)", { numeric: true })];
  const spots = group("Panel", fields(
    list("lights", "Light", [["fringes", "Fringes that move"], ["discs", "Discs, one after the other"], ["both", "Discs, then fringes"]]),
    fringeFields, discsFields));
  const steps = stepsEditor(values.steps, changed);
  const stepsGroup = group("Frames", steps.element);

  const model = list("model", "Model", MODELS);
  const what = h("select", { id: "plan-method", onchange: (e) => set("method", e.target.value) });
  const method = field("Result", what);
  const options = h("div");
  const unfit = h("p", { class: "soft" }, "A result at once needs one view: leave the analyser alone. Other series are reconstructed from the page of the session.");
  const reconstruct = h("div", { class: "stack" }, h("div", { class: "fields" }, tick("reconstruct", "Reconstruct at once"), model, method), keep("operation", h("div", {}, options)));
  const about = group("Session", h("div", { class: "stack" }, fields(text("name", "Name"), text("sample", "Sample"), text("operator", "Operator")),
    area("notes", "Notes")));
  const besides = group("Extra frames and result", h("div", { class: "stack" },
    tick("dark", "Dark frame, behind the closed shutter"), tick("display_black", "Frame with all light off (subtracted)"), reconstruct, unfit));

  /** The methods there are, and the options of the chosen one. */
  function paintMethod() {
    const choices = methodsOf(values);
    const chosen = methodOf(values);
    reconstruct.hidden = values.kind !== "polarization" && !chosen;
    unfit.hidden = !reconstruct.hidden || values.kind === "free";
    method.hidden = !values.reconstruct || choices.length < 2;
    what.replaceChildren(...choices.map(([name, label]) => h("option", { value: name, selected: name === chosen }, label)));
    options.hidden = !values.reconstruct || !(chosen in WITHOUT);
    if (options.hidden || options.dataset.of === chosen) return;
    options.dataset.of = chosen;
    const shown = operationForm(chosen, values.options[chosen], { without: WITHOUT[chosen] });
    const keep = () => {
      values.options[chosen] = shown.options();
      changed();
    };
    // All options have defaults, except that a sheet of tiles has a size.
    options.replaceChildren(h("details", { open: chosen === "flash" }, h("summary", {}, "Options of the result"), shown.element));
    shown.element.addEventListener("input", keep);
    shown.element.addEventListener("change", keep);
    values.options[chosen] = shown.options();
  }

  const listOf = (/** @type {HTMLElement} */ holder) => /** @type {HTMLSelectElement} */ (part(holder, "select"));
  /** Offers a choice of a list, or not. */
  function allow(holder, value, allowed) {
    for (const option of listOf(holder).options) if (option.value === value) option.hidden = option.disabled = !allowed;
  }

  function paint() {
    const { kind } = values;
    // Fringes need no analyser; a plan that turns it all the same is shown as it is.
    analyser.hidden = kind === "free" || (kind === "spots" && values.angles === "none");
    // Polarization needs angles; the other kinds can leave the analyser alone.
    allow(angleMode, "none", kind !== "polarization");
    allow(angleMode, "until", kind === "polarization");
    const fits = kind === "polarization" ? values.angles !== "none" : values.angles !== "until";
    const mode = fits ? values.angles : "range";
    listOf(angleMode).value = mode;
    for (const f of rangeFields) f.hidden = mode !== "range";
    listField.hidden = mode !== "list";
    for (const f of untilFields) f.hidden = mode !== "until";
    for (const { value } of listOf(exposureMode).options) allow(exposureMode, value, EXPOSING[kind].includes(value));
    const exposing = exposingOf(values);
    listOf(exposureMode).value = exposing;
    exposures.hidden = exposing !== "several" || kind === "polarization";
    for (const f of bracketFields) f.hidden = exposing !== "bracket";
    exposure.hidden = exposing !== "fixed";
    brackets.hidden = exposing !== "several" || kind !== "polarization";
    display.hidden = kind === "spots" || kind === "flash";
    for (const f of discFields) f.hidden = values.pattern !== "disc";
    spots.hidden = kind !== "spots";
    for (const f of fringeFields) f.hidden = values.lights === "discs";
    for (const f of discsFields) f.hidden = values.lights === "fringes";
    stepsGroup.hidden = kind !== "free";
    paintMethod();
    model.hidden = !values.reconstruct || kind !== "polarization";
  }
  paint();
  return {
    element: h("div", { class: "stack plan" }, group("Kind", kinds), about, analyser, spots, stepsGroup, h("div", { class: "columns pair" }, camera, display), besides),
    /** Shows what is wrong, by field. */
    mark(problems) {
      for (const [key, holder] of Object.entries(holders)) {
        holder.lastElementChild.textContent = problems[key] ?? "";
        // Of an operation's options, one at most is needed: the size of a sheet of tiles.
        holder.querySelector(key === "operation" ? "#flash-size-mm" : "input, textarea")?.setAttribute("aria-invalid", String(key in problems));
      }
      steps.mark(problems);
    },
  };
}
