// Between the fields of the form and a plan as the service takes it. No elements here.

/** What the form holds when nothing was filled in; everything is as typed. */
export const BLANK = {
  kind: "polarization", name: "", sample: "", operator: "", notes: "",
  angles: "range", until_sigma_deg: "0.3", begin: "4", at_most: "24", brackets: "5, 20, 80", start: "0", stop: "150", step: "30", list: "0, 30, 60, 90, 120, 150",
  exposing: "meter", exposure_ms: "40", exposures_ms: "5, 10, 20, 40, 80", step_ev: "2", bracket_most: "7", gain: "1", average: "1",
  roi: "", pattern: "disc", diameter_mm: "180", center_mm: "0, 0",
  lights: "fringes", fringes: "", phases: "4", finest_mm: "28", period_percent: "1", undecided_percent: "",
  spots: "-40, 0\n0, 0\n40, 0", spot_diameter_mm: "10",
  steps: [{ display: "", analyser_deg: "0", flash: false, exposure_ms: "" }],
  dark: true, display_black: true, reconstruct: true, model: "auto",
  // What is made of the frames, and the options of each method as the service takes them.
  method: "", options: {},
};

/** How the phase of polarization becomes an orientation, simplest first. */
export const MODELS = [
  ["auto", "The simplest that explains the data"],
  ["sinusoid", "Sinusoid: the phase is the orientation"],
  ["prenormalized", "Prenormalized: the phase about the mean"],
  ["circle", "Circle: the phase about the fitted centre"],
  ["curve", "Curve: the nearest place on the fitted film's curve"],
];

/** The five kinds, and what each varies. */
export const KINDS = [
  ["polarization", "Polarization", "Turns the analyser."],
  ["exposures", "Exposures", "Varies the exposure time: high dynamic range, lookup tables."],
  ["flash", "Flash", "The same under the flash."],
  ["spots", "Spots", "Moves fringes or discs over the panel: absolute periods. No analyser."],
  ["free", "Free", "Frame by frame, as listed."],
];

/** How exposures can be found for each kind; the first is what it begins with. */
export const EXPOSING = {
  polarization: ["meter", "fixed", "several"], exposures: ["bracket", "several"], flash: ["bracket", "several", "meter", "fixed"],
  spots: ["meter", "fixed"], free: ["meter", "fixed"],
};

/** Gives the form another kind, with the analyser and exposures that need nothing from the user. */
export function ofKind(form, kind) {
  form.kind = kind;
  form.angles = kind === "polarization" ? BLANK.angles : "none";
  form.exposing = EXPOSING[kind][0];
}

/** How the form's exposures are found. */
export const exposingOf = ({ kind, exposing }) => (EXPOSING[kind].includes(exposing) ? exposing : EXPOSING[kind][0]);

/** Results that photographs of one view can give. */
const METHODS = {
  hdr: "One photograph of high dynamic range", lut: "A lookup table of its diffraction", bokeh: "A grating in an out-of-focus highlight",
  flash: "Orientations and periods of a sheet of equal tiles", spots: "Orientations and absolute periods",
};

/** Methods that can be made of what the form asks for, the usual one first: `[name, label]`. */
export function methodsOf(form) {
  const one = form.angles === "none" || (form.angles === "list" && !/[\s,;]/.test(form.list.trim()));
  if (!one || form.kind === "polarization") return [];
  const merged = ["several", "bracket"].includes(exposingOf(form)) ? ["hdr", "lut", "bokeh"] : [];
  const names = { exposures: merged, flash: [...merged, "flash"], spots: form.lights === "discs" ? [] : ["spots"] }[form.kind] ?? [];
  return names.map((name) => [name, METHODS[name]]);
}

/** The one of these that the form asks for. */
export const methodOf = (form) => (methodsOf(form).find(([name]) => name === form.method) ?? methodsOf(form)[0])?.[0];

const MAX_ANGLES = 100_000;
const MAX_UNTIL = 360;

/** Raised by the readers below; `key` names the field. */
class Wrong extends Error {
  constructor(key, text) {
    super(text);
    this.key = key;
  }
}

function one(form, key, text = form[key]) {
  const value = Number(String(text).trim().replace(/^−/, "-"));
  if (String(text).trim() === "" || !Number.isFinite(value)) throw new Wrong(key, "a number is needed");
  return value;
}

/**
 * @param {string} key
 * @param {string} text
 * @param {{ length?: number, none?: string }} options
 */
function many(key, text, { length, none = "at least one number is needed" } = {}) {
  const parts = text.trim().split(/[\s,;]+/).filter(Boolean);
  const values = parts.map((p) => Number(p.replace(/^−/, "-")));
  const bad = values.findIndex((v) => !Number.isFinite(v));
  if (bad >= 0) throw new Wrong(key, `“${parts[bad]}” is no number`);
  if (length && values.length !== length) throw new Wrong(key, `${length} numbers are needed, not ${values.length}`);
  if (!values.length) throw new Wrong(key, none);
  return values;
}

/** Angles that are added until σ is as wanted. */
function until(form) {
  const [start, until_sigma_deg, at_most] = ["begin", "until_sigma_deg", "at_most"].map((key) => one(form, key));
  if (until_sigma_deg <= 0) throw new Wrong("until_sigma_deg", "must be above 0");
  if (!Number.isInteger(at_most) || at_most < 3 || at_most > MAX_UNTIL) throw new Wrong("at_most", `a whole number from 3 to ${MAX_UNTIL} is needed`);
  if (!Number.isInteger(start) || start < 3 || start > at_most) throw new Wrong("begin", "a whole number from 3 to the most angles is needed");
  return { start, until_sigma_deg, at_most };
}

/** All angles from start to stop, both included where the step meets them. */
function range(form) {
  const [start, stop, step] = ["start", "stop", "step"].map((key) => one(form, key));
  if (step === 0) throw new Wrong("step", "must not be 0");
  const steps = Math.floor((stop - start) / step + 1e-9);
  if (steps < 0) throw new Wrong("step", "leads away from the end");
  if (steps >= MAX_ANGLES) throw new Wrong("step", `more than ${MAX_ANGLES} angles`);
  // Rounded, since 3 · 0.1 is not 0.3.
  return Array.from({ length: steps + 1 }, (_, i) => Math.round((start + i * step) * 1e9) / 1e9);
}

function disc(form) {
  return { pattern: "disc", center_mm: many("center_mm", form.center_mm, { length: 2 }), diameter_mm: one(form, "diameter_mm") };
}

function discs(form) {
  const lines = form.spots.trim().split("\n").filter((line) => line.trim());
  if (!lines.length) throw new Wrong("spots", "at least one spot is needed");
  return lines.map((line) => many("spots", line, { length: 2 }));
}

/** Fringes; what has no field stays as it was. */
function fringes(form) {
  const made = { ...form.fringes_given, phases: one(form, "phases"), finest_mm: one(form, "finest_mm"), period_sigma: one(form, "period_percent") / 100 };
  /** @type {[string, string, number][]} */
  const optional = [["count", "fringes", 1], ["until_undecided", "undecided_percent", 100]];
  for (const [key, field, scale] of optional) {
    if (form[field].trim()) made[key] = one(form, field) / scale;
    else delete made[key];
  }
  if (!("until_undecided" in made)) delete made.at_most;
  return made;
}

function freeStep(step, i) {
  const key = `steps.${i}`;
  const made = { flash: step.flash };
  if (step.display === "black") made.display = { pattern: "black" };
  else if (step.display !== "") made.display = { pattern: "disc", diameter_mm: one(step, key, step.display) };
  if (step.center_mm && made.display?.pattern === "disc") made.display.center_mm = step.center_mm;
  if (step.analyser_deg !== "") made.analyser_deg = one(step, key, step.analyser_deg);
  if (step.exposure_ms !== "") made.exposure_ms = one(step, key, step.exposure_ms);
  return made;
}

/** The plan that the form describes, and what is wrong in which field. */
export function toPlan(form) {
  const problems = {};
  const read = (reader) => {
    try {
      return reader();
    } catch (wrong) {
      if (!(wrong instanceof Wrong)) throw wrong;
      problems[wrong.key] = wrong.message;
      return undefined;
    }
  };
  const { kind } = form;
  const plan = { kind };
  for (const key of ["name", "sample", "operator", "notes"]) if (form[key].trim()) plan[key] = form[key].trim();
  plan.camera = { gain: read(() => one(form, "gain")), average: read(() => one(form, "average")) };
  const exposing = exposingOf(form);
  const listed = kind === "polarization" ? "brackets" : "exposures_ms";
  if (exposing === "several") plan.exposures_ms = read(() => many(listed, form[listed]));
  else if (exposing === "bracket") plan.bracket = { step_ev: read(() => one(form, "step_ev")), at_most: read(() => one(form, "bracket_most")) };
  else if (exposing === "fixed") plan.camera.exposure_ms = read(() => one(form, "exposure_ms"));
  else plan.camera.exposure = "meter";
  if (form.roi.trim()) plan.camera.roi = read(() => many("roi", form.roi, { length: 4 }));
  if (kind !== "spots") plan.display = form.pattern === "black" ? { pattern: "black" } : read(() => disc(form));
  if (kind !== "free" && (kind === "polarization" || form.angles !== "none")) {
    const fixed = () => ({ angles_deg: form.angles === "list" ? many("list", form.list) : range(form) });
    plan.analyser = read(() => (form.angles === "until" && kind === "polarization" ? until(form) : fixed()));
  }
  if (kind === "spots") {
    plan.spots = {};
    if (form.lights !== "discs") plan.spots.fringes = read(() => fringes(form));
    if (form.lights !== "fringes") Object.assign(plan.spots, { centers_mm: read(() => discs(form)), diameter_mm: read(() => one(form, "spot_diameter_mm")) });
  }
  if (kind === "free") plan.steps = form.steps.map((step, i) => read(() => freeStep(step, i)));
  plan.extras = ["dark", "display_black"].filter((extra) => form[extra]);
  if (kind === "polarization" && form.reconstruct) plan.reconstruct = { operation: "polarization", options: { model: form.model } };
  const method = methodOf(form);
  const flash = form.options.flash ?? {};
  if (method === "flash" && form.reconstruct && !flash.size_mm && !flash.reference_px) problems.operation = "Size: the width and height of the sheet are needed";
  if (method && form.reconstruct) plan.reconstruct = { operation: method, options: form.options[method] ?? {} };
  return { plan, problems };
}

/** A plan as JSON with one line for each list of numbers. */
export function pretty(plan) {
  return JSON.stringify(plan, null, 2).replaceAll(/\[[-\d.,e\s]+\]/g, (list) => list.replaceAll(/\s+/g, " ").replace("[ ", "[").replace(" ]", "]"));
}

const pair = (values) => values.join(", ");

/** The form that shows a plan. */
export function fromPlan(plan) {
  const form = structuredClone(BLANK);
  const { camera = {}, display = {}, analyser, spots, extras = [], reconstruct } = plan;
  form.kind = plan.kind ?? "polarization";
  for (const key of ["name", "sample", "operator", "notes"]) form[key] = plan[key] ?? "";
  form.angles = analyser || form.kind === "polarization" ? "list" : "none";
  if (analyser?.angles_deg) form.list = pair(analyser.angles_deg);
  if (analyser?.until_sigma_deg) {
    form.angles = "until";
    form.until_sigma_deg = String(analyser.until_sigma_deg);
    form.begin = String(analyser.start ?? BLANK.begin);
    form.at_most = String(analyser.at_most ?? BLANK.at_most);
  }
  const given = camera.exposure_ms !== undefined && camera.exposure_ms !== null;
  form.exposing = given ? "fixed" : "meter";
  if (given) form.exposure_ms = String(camera.exposure_ms);
  form.gain = String(camera.gain ?? 1);
  form.average = String(camera.average ?? 1);
  form.roi = camera.roi ? pair(camera.roi) : "";
  form.pattern = display.pattern ?? "disc";
  form.diameter_mm = String(display.diameter_mm ?? 180);
  form.center_mm = pair(display.center_mm ?? [0, 0]);
  if (plan.exposures_ms?.length) {
    form.exposing = "several";
    form[form.kind === "polarization" ? "brackets" : "exposures_ms"] = pair(plan.exposures_ms);
  }
  if (plan.bracket) {
    form.exposing = "bracket";
    form.step_ev = String(plan.bracket.step_ev ?? BLANK.step_ev);
    form.bracket_most = String(plan.bracket.at_most ?? BLANK.bracket_most);
  }
  if (spots) {
    const { fringes: shown, centers_mm = [], diameter_mm } = spots;
    form.lights = shown && centers_mm.length ? "both" : shown ? "fringes" : "discs";
    if (centers_mm.length) form.spots = centers_mm.map(pair).join("\n");
    if (diameter_mm) form.spot_diameter_mm = String(diameter_mm);
    if (shown) {
      form.fringes_given = shown;
      form.fringes = String(shown.count ?? "");
      form.phases = String(shown.phases ?? BLANK.phases);
      form.finest_mm = String(shown.finest_mm ?? BLANK.finest_mm);
      form.period_percent = String(100 * (shown.period_sigma ?? 0.01));
      form.undecided_percent = shown.until_undecided ? String(100 * shown.until_undecided) : "";
    }
  }
  if (plan.steps?.length) {
    form.steps = plan.steps.map((step) => ({
      display: !step.display ? "" : step.display.pattern === "black" ? "black" : String(step.display.diameter_mm ?? 180),
      center_mm: step.display?.center_mm,
      analyser_deg: String(step.analyser_deg ?? ""),
      flash: Boolean(step.flash),
      exposure_ms: String(step.exposure_ms ?? ""),
    }));
  }
  form.dark = extras.includes("dark");
  form.display_black = extras.includes("display_black");
  form.reconstruct = Boolean(reconstruct);
  // Plans of the first version have the operation as `method`, and its options under its name or beside it.
  form.method = reconstruct?.operation ?? reconstruct?.method ?? "";
  const options = reconstruct?.options ?? reconstruct?.[form.method] ?? reconstruct ?? {};
  form.model = options.model ?? "auto";
  if (form.method !== "polarization") form.options[form.method] = options;
  return form;
}
