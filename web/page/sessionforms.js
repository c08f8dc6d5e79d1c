// Operations that fit the photographs of a session, each with its form, on the page of the session.

import { picture, post } from "./api.js";
import { field, h, panel, select } from "./dom.js";
import { problemMessage } from "./feedback.js";
import { flashForm } from "./flashform.js";
import { fileName } from "./format.js";
import { lutForm } from "./lutform.js";
import { operationForm, titleOf } from "./operationform.js";

/** Operations for each kind of session, the usual one first. */
const FITTING = { polarization: ["polarization"], exposures: ["hdr", "lut", "bokeh"], flash: ["hdr", "lut", "flash", "bokeh"], spots: ["spots"] };
/** Widest picture that the service makes of a frame. */
const WIDEST = 4096;

/** The form of an operation, filled as the plan has it; geometry, wavelength and directions are in the session itself. */
function formOf(name, given) {
  if (name === "lut") return lutForm(given);
  if (name === "flash") return flashForm(given, { described: true });
  return operationForm(name, given, { without: name === "spots" ? ["polarization"] : [] });
}

/**
 * The panel, or null for sessions without photographs that an operation fits.
 * @param {Session} session
 * @param {() => Frame[]} frames
 * @param {AbortSignal} signal
 */
export function sessionForms(session, frames, signal) {
  const names = FITTING[session.kind] ?? [];
  if (!names.length) return null;
  const planned = session.plan?.reconstruct;
  const usual = names.includes(planned?.operation) ? planned.operation : names[0];
  const forms = Object.fromEntries(names.map((name) => [name, formOf(name, name === planned?.operation ? { ...planned.options } : {})]));
  const operation = select(names.map((name) => [name, titleOf(name)]), usual, { id: "session-operation", onchange: paint });
  const choice = field("What to make of them", operation);
  choice.hidden = names.length < 2;
  const problems = h("div", { role: "status", "aria-live": "polite" });
  const make = h("button", { type: "button", class: "primary", id: "session-reconstruct", onclick: begin }, "Reconstruct");
  const form = h("div", { class: "stack" }, choice, Object.values(forms).map((f) => f.element), problems, h("p", {}, make));
  const details = h("details", { id: "session-forms", open: !planned, ontoggle: () => details.open && pickable() }, h("summary", {}, planned ? "Other options, or another result" : "Options"), form);
  const element = panel("Reconstruct these photographs", null, details);
  let shown = false;

  function paint() {
    for (const [name, { element: own }] of Object.entries(forms)) own.hidden = name !== operation.value;
    pickable();
  }

  /** Fetches a photograph to pick in, once that is wanted. */
  async function pickable() {
    // Names of the plan's frames begin with a number; dark frames and others have words.
    const first = frames().filter((frame) => /^\d/.test(fileName(frame.file))).at(-1);
    if (shown || !details.open || !first || !forms[operation.value].show) return;
    shown = true;
    try {
      const name = fileName(first.file).replace(/\.png$/, "");
      const { blob } = await picture(`/sessions/${session.id}/frames/${name}.png?width=${WIDEST}`, { signal });
      for (const one of Object.values(forms)) one.show?.(blob);
    } catch (problem) {
      // Without a picture the values are entered in the fields.
      if (problem.name !== "AbortError" && problem.slug === undefined) throw problem;
    }
  }

  async function begin() {
    make.disabled = true;
    problems.replaceChildren();
    try {
      const chosen = forms[operation.value];
      const others = (await chosen.inputs?.(signal)) ?? {};
      const job = await post(`/operations/${operation.value}`, { session: session.id, upload: null, options: chosen.options(), ...others });
      location.hash = `#/result/${job.id}`;
    } catch (problem) {
      problems.replaceChildren(problemMessage(problem));
      make.disabled = false;
    }
  }
  paint();
  return Object.assign(element, {
    /** Shown once there is something to reconstruct. */
    update: (/** @type {Session} */ now) => { element.hidden = now.stage !== null || now.frames_committed === 0; },
  });
}
