// #/new: a plan from the form or a file, what it costs, and start.

import { post } from "./api.js";
import { figures, firstOf, h, panel, randomId, say, settle } from "./dom.js";
import { complain, problemMessage } from "./feedback.js";
import { bytes, count, duration } from "./format.js";
import { reach } from "./gratings.js";
import { onReturn, service } from "./service.js";
import { BLANK, fromPlan, pretty, toPlan } from "./plan.js";
import { planForm } from "./planform.js";
import { presets } from "./presets.js";

const OPERATOR = "nacre-operator";
/** Time for results from which a smaller region is offered, and the side of that region in pixels. */
const [LONG_S, MIDDLE_PX] = [45, 256];
/** Simulated samples on which a plan of each kind shows something. */
const SAMPLES = { spots: "mosaic", flash: "polygons", exposures: "emblem" };
// Kept while the page is open, so that a look at the bench loses nothing.
let values = null;
let text = null;

function remembered() {
  try {
    return localStorage.getItem(OPERATOR) ?? "";
  } catch {
    return "";
  }
}

/** Fills the form with a plan; used to repeat a session. */
export function prepare(plan) {
  values = fromPlan(plan);
  text = null;
}

/**
 * Takes a region of the live picture into the form: left, top, width and height in pixels, or null for the whole frame.
 * @param {number[] | null} roi
 */
export function takeRegion(roi) {
  values ??= blank();
  values.roi = roi?.join(", ") ?? "";
  text = null;
}

const blank = () => ({ ...structuredClone(BLANK), operator: remembered() });

/**
 * Shows the form until the signal fires.
 * @param {HTMLElement} main
 * @param {Visit} visit
 */
export async function newPage(main, { signal }) {
  values ??= blank();
  let asked = new AbortController();
  let sound = false;
  let starting = false;
  let form = null;

  const area = h("textarea", { id: "plan-text", class: "code", rows: 24, spellcheck: "false", "aria-label": "Plan, TOML or JSON",
    oninput: () => { text.content = area.value; changed(); } });
  const written = panel("Plan file", h("div", { class: "row" }, h("button", { type: "button", onclick: () => { text = null; paint(); } }, "Back to the form")), area);
  const left = h("div", { class: "stack" });
  const json = h("pre", { class: "scroll code", tabindex: 0, "aria-label": "The plan as JSON" });
  const estimate = h("div", { id: "estimate", role: "status", "aria-live": "polite" });
  const problems = h("div", { id: "problems", role: "status", "aria-live": "polite" });
  const start = h("button", { type: "button", id: "start", class: "primary", onclick: () => begin("/sessions"), disabled: true }, "Start");
  const trial = h("button", { type: "button", id: "try-simulated", disabled: true, onclick: () => begin(`/samples/${SAMPLES[kind()] ?? "kinematic"}/sessions`),
    title: "Carries this plan out on a simulated bench with a sample that fits; no device moves" }, "Try this plan on a simulated sample");
  const file = h("input", { type: "file", id: "plan-file", accept: ".toml,.json,application/json", class: "sr", onchange: open });
  const again = h("button", { type: "button", onclick: () => { values = { ...structuredClone(BLANK), operator: values.operator }; text = null; paint(); } }, "Clear");
  const offered = presets(() => values, (next) => { values = next; text = null; paint(); }, signal);
  const bench = h("button", { type: "button", onclick: fromBench, title: "Take over exposure and gain as set on the bench" }, "Exposure of the bench");
  main.append(
    h("div", { class: "head" }, h("h1", { class: "grow" }, "New session"), bench, again,
      h("label", { class: "button", for: "plan-file" }, "Open a plan file"), file),
    offered.element,
    h("div", { class: "columns planning" }, left,
      h("div", { class: "stack beside" },
        panel("Estimate", start, estimate, problems, h("p", {}, trial)),
        panel("Plan", null, h("details", { open: true }, h("summary", {}, "As JSON"), json)))));

  /** What is sent: the form's plan, or the text as it stands. */
  function request() {
    if (text) return { body: text.toml ? { toml: text.content } : { plan: JSON.parse(text.content) }, problems: {} };
    const { plan, problems: found } = toPlan(values);
    return { body: { plan }, problems: found };
  }

  function paint() {
    if (text) {
      area.value = text.content;
      left.replaceChildren(written);
    } else {
      form = planForm(values, () => { offered.mark(""); changed(); });
      left.replaceChildren(form.element);
    }
    changed();
  }

  const ask = settle(250, async () => {
    let wanted;
    try {
      wanted = request();
    } catch (error) {
      return refuse([`The text is no JSON: ${error.message}`]);
    }
    try {
      localStorage.setItem(OPERATOR, values.operator);
    } catch {
      // Only a convenience.
    }
    asked.abort();
    asked = new AbortController();
    const options = { signal: firstOf(asked.signal, signal) };
    try {
      const [checked, cost] = await Promise.all([post("/plans/check", wanted.body, options), post("/plans/estimate", wanted.body, options)]);
      if (text && checked.plan) json.textContent = pretty(checked.plan);
      show(cost, checked);
      refuse(checked.problems ?? [], checked.sound);
    } catch (problem) {
      if (problem.name === "AbortError") return;
      estimate.replaceChildren();
      sound = false;
      problems.replaceChildren(problemMessage(problem));
      enable();
    }
  });

  function changed() {
    sound = false;
    enable();
    let wanted = null;
    try {
      wanted = request();
    } catch {
      // Said by `ask`, once typing pauses.
    }
    if (wanted) json.textContent = wanted.body.toml ?? pretty(wanted.body.plan);
    if (!text) {
      if (wanted) form?.mark(wanted.problems);
      if (wanted && Object.keys(wanted.problems).length) {
        asked.abort();
        estimate.classList.add("stale");
        return refuse(["Some fields need attention."]);
      }
    }
    estimate.classList.add("stale");
    ask();
  }

  const kind = () => request().body.plan?.kind ?? "";

  function show(cost, { shortest_um }) {
    estimate.classList.remove("stale");
    /** @type {[string, string][]} */
    const facts = [
      [cost.least_frames < cost.frames ? `frames, at least ${count(cost.least_frames)}` : "frames", count(cost.frames)],
      [cost.metering_seconds ? `time, ${duration(cost.metering_seconds)} of it for metering` : "time", duration(cost.seconds)],
    ];
    if (cost.results_seconds !== null) facts.push(["then, for results, about", duration(cost.results_seconds)]);
    const periods = reach(shortest_um);
    facts.push(["on disk, at most", bytes(cost.bytes + (cost.results_bytes ?? 0))]);
    estimate.replaceChildren(
      figures(facts),
      h("p", { class: "soft" }, cost.exposure_assumed
        ? `Assumes an exposure of ${duration(cost.exposure_s)}; metering finds the real one, which can change the time.`
        : `Exposure ${duration(cost.exposure_s)}.`),
      periods ? h("p", { id: "reach", class: "soft" }, `Shortest period whose first order reaches the panel: ${periods}. Bring the panel nearer for shorter ones.`) : "", smaller(cost));
  }

  /** Offers a smaller region where the results of all pixels take long. */
  function smaller({ results_seconds: seconds }) {
    const { width, height } = service.devices?.camera ?? { width: 0, height: 0 };
    if (text || values.kind !== "spots" || values.roi || !(seconds > LONG_S) || Math.min(width, height) <= MIDDLE_PX) return "";
    return h("p", {}, h("button", { type: "button", id: "only-middle", onclick: () => {
      values.roi = [(width - MIDDLE_PX) / 2, (height - MIDDLE_PX) / 2].map(Math.floor).concat(MIDDLE_PX, MIDDLE_PX).join(", ");
      paint();
    } }, `Only the middle, ${MIDDLE_PX} × ${MIDDLE_PX} pixels: about ${duration((seconds * MIDDLE_PX ** 2) / (width * height))}`));
  }

  function refuse(list, isSound = false) {
    sound = isSound && list.length === 0;
    problems.replaceChildren(...(list.length ? [h("ul", { class: "problems" }, list.map((p) => h("li", {}, p)))] : []));
    enable();
  }

  function enable() {
    const busy = service.devices?.activity === "session";
    start.disabled = !sound || starting || busy;
    trial.disabled = text !== null || starting || Object.keys(toPlan(values).problems).length > 0;
    start.title = busy ? "A session has the bench; wait for its end or stop it" : sound ? "" : "The plan is not complete yet";
  }

  /** Starts the session on the bench, or at the path of a simulated sample. */
  async function begin(path) {
    starting = true;
    enable();
    say(start, "Starting…");
    try {
      const session = await post(path, request().body, { headers: { "Idempotency-Key": randomId() } });
      location.hash = `#/session/${session.id}`;
    } catch (problem) {
      complain(problem);
    }
    starting = false;
    say(start, "Start");
    enable();
  }

  function fromBench() {
    const { exposure_ms, gain } = service.devices?.camera ?? {};
    if (exposure_ms === undefined) return;
    Object.assign(values, { exposing: "fixed", exposure_ms: String(exposure_ms), gain: String(gain) });
    text = null;
    paint();
  }

  async function open() {
    const chosen = file.files?.[0];
    file.value = "";
    if (!chosen) return;
    const content = await chosen.text();
    const toml = !/\.json$/i.test(chosen.name) && !content.trimStart().startsWith("{");
    text = { content, toml };
    try {
      const plan = toml ? (await post("/plans/check", { toml: content }, { signal })).plan : JSON.parse(content);
      if (plan && fits(plan)) prepare(plan);
    } catch (problem) {
      // A file with a mistake stays open as text, where it can be corrected; `ask` says what is wrong.
      if (problem.name === "AbortError") return;
    }
    paint();
  }

  paint();
  const timer = setInterval(enable, 500);
  signal.addEventListener("abort", () => clearInterval(timer));
  onReturn(changed, signal);
}

/** Whether the form can show all of a plan; a key it does not know must not get lost silently. */
function fits(plan) {
  const known = (given, made) => given === null || Object.entries(given).every(([key, value]) => {
    if (value === null || value === "" || (Array.isArray(value) && value.length === 0)) return true;
    if (made?.[key] === undefined) return key === "exposure" || value === false;
    if (typeof value !== "object") return value === made[key];
    return known(value, made[key]);
  });
  const { plan: made, problems } = toPlan(fromPlan(plan));
  // Kind spots shows its spots only, so that a display in its plan does not count.
  const { display, ...rest } = plan;
  return Object.keys(problems).length === 0 && known(made.display ? plan : rest, made);
}
