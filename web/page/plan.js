// Between the fields of the form and a plan as the service takes it. No elements here.

/** What the form holds when nothing was filled in; everything is as typed. */
export const BLANK = {
  kind: "polarization", name: "", sample: "", operator: "", notes: "",
  angles: "range", until_sigma_deg: "0.3", begin: "4", at_most: "24", brackets: "5, 20, 80", start: "0", stop: "150", step: "30", list: "0, 30, 60, 90, 120, 150",
  exposing: "meter", exposure_ms: "40", exposures_ms: "5, 10, 20, 40, 80", step_ev: "2", bracket_most: "7", gain: "1", average: "1",
  roi: "", pattern: "disc", diameter_mm: "180", center_mm: "0, 0",
  spots: "-40, 0\n0, 0\n40, 0", spot_diameter_mm: "10",
  steps: [{ display: "", analyser_deg: "0", flash: false, exposure_ms: "" }],
  dark: true, display_black: true, reconstruct: true, model: "auto",
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
  ["exposures", "Exposures", "Varies the exposure time, at each angle of the analyser if any."],
  ["flash", "Flash", "Under the flash, at each angle of the analyser if any."],
  ["spots", "Spots", "Moves a disc over the panel, at each angle of the analyser if any."],
  ["free", "Free", "Frame by frame, as listed."],
];

/** How exposures can be found for each kind; the first is what it begins with. */
export const EXPOSING = {
  polarization: ["meter", "fixed", "several"], exposures: ["several", "bracket"], flash: ["meter", "fixed", "several", "bracket"],
  spots: ["meter", "fixed"], free: ["meter", "fixed"],
};

/** How the form's exposures are found. */
export const exposingOf = ({ kind, exposing }) => (EXPOSING[kind].includes(exposing) ? exposing : EXPOSING[kind][0]);

/** Whether the form asks for one view in several exposures, which can be merged. */
export function merges(form) {
  const several = ["several", "bracket"].includes(exposingOf(form)) && form.kind !== "polarization";
  return several && (form.angles === "none" || (form.angles === "list" && !/[\s,;]/.test(form.list.trim())));
}

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
    const lines = form.spots.trim().split("\n").filter((line) => line.trim());
    plan.spots = {
      centers_mm: read(() => {
        if (!lines.length) throw new Wrong("spots", "at least one spot is needed");
        return lines.map((line) => many("spots", line, { length: 2 }));
      }),
      diameter_mm: read(() => one(form, "spot_diameter_mm")),
    };
  }
  if (kind === "free") plan.steps = form.steps.map((step, i) => read(() => freeStep(step, i)));
  plan.extras = ["dark", "display_black"].filter((extra) => form[extra]);
  if (kind === "polarization" && form.reconstruct) plan.reconstruct = { method: "polarization", model: form.model };
  if (merges(form) && form.reconstruct) plan.reconstruct = { method: "hdr" };
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
    form.spots = spots.centers_mm.map(pair).join("\n");
    form.spot_diameter_mm = String(spots.diameter_mm);
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
  form.model = reconstruct?.model ?? "auto";
  return form;
}
