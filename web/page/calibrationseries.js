// Steps of a calibration on the bench: check of the light, a series of photographs, the computed result.

import { get, listen, picture, post, show } from "./api.js";
import { course } from "./course.js";
import { field, firstOf, h, randomId, say } from "./dom.js";
import { complain, problemMessage } from "./feedback.js";
import { bytes, count, duration, percent } from "./format.js";
import { KINDS, reportOfReference } from "./references.js";
import { service, watch } from "./service.js";

/** Share of saturated pixels above which the live picture is too bright, and level of the brightest 1 % below which it is too dark. */
const [MOST_SATURATED, LEAST_LEVEL] = [0.001, 0.1];
/** Charts of the results. */
const CHARTS = { camera: ["bad-pixels.png", "Pixels with defects are white"], flat: ["flat.png", "Relative light"], analyser: ["analyser.png", "Light over the angle of the analyser, and residuals"], retarder: ["retarder.png", "Light over the angle of the analyser, and residuals"] };

/** Tells the step around an element that it must be judged anew. */
const judge = (/** @type {HTMLElement} */ element) => element.dispatchEvent(new Event("judge", { bubbles: true }));

/**
 * A button that meters, and judges the live picture.
 * @param {AbortSignal} signal
 */
export function lightCheck(signal) {
  let met = false;
  const said = h("p", { id: "light-said", role: "status", "aria-live": "polite" });
  const skip = h("button", { type: "button", class: "quiet", hidden: true, onclick: () => { met = true; judge(element); } }, "Continue without this check");
  const button = h("button", { type: "button", class: "primary", id: "check-light", onclick: run }, "Check the light");
  const element = h("div", { class: "stack" }, h("div", { class: "row" }, button, skip), said);
  watch(({ devices }) => { button.disabled = devices?.activity === "session"; }, signal);

  async function run() {
    button.setAttribute("aria-busy", "true");
    try {
      if (service.devices?.display.pattern === "black") throw new Error("The panel is dark. Press “Light the sample” at the live picture.");
      await post("/devices/camera/meter", {}, { signal });
      const { histogram, saturated } = await get("/devices/camera/preview", { signal });
      const level = brightest(histogram);
      met = saturated <= MOST_SATURATED && level >= LEAST_LEVEL;
      const seen = `Saturated: ${percent(saturated, 2)}. Brightest 1 % of the pixels: ${percent(level, 0)} of white.`;
      say(said, met ? `The light is suitable. ${seen}` : saturated > MOST_SATURATED ? `The picture is saturated; reduce the light. ${seen}` : `The picture is too dark. Check lens cover, panel and the angle of the analyser. ${seen}`);
    } catch (problem) {
      if (problem.name === "AbortError") return;
      met = false;
      say(said, [problem.message, problem.remedy].filter(Boolean).join(" "));
    }
    button.removeAttribute("aria-busy");
    skip.hidden = met;
    button.classList.toggle("primary", !met);
    judge(element);
  }
  return { element, met: () => met };
}

/** Level that 1 % of the pixels exceed, as a share of white. */
function brightest(/** @type {number[]} */ histogram) {
  let left = 0.01 * histogram.reduce((sum, n) => sum + n, 0);
  let bin = histogram.length - 1;
  while (bin > 0 && left >= histogram[bin]) left -= histogram[bin--];
  return bin / (histogram.length - 1);
}

/**
 * A series of photographs by a session: its estimate, a button, progress. `id` is that of a session which exists already.
 * @param {{ key: string, plan: () => any, id: string | null, began: (id: string) => void, signal: AbortSignal }} options
 */
export function series({ key, plan, id, began, signal }) {
  /** @type {Session | null} */
  let session = null;
  let watching = new AbortController();
  const cost = h("div", { class: "stack" });
  const start = h("button", { type: "button", class: "primary", id: `take-${key}`, onclick: begin }, "Take photographs");
  const problems = h("div", { role: "status" });
  const progress = h("div", { class: "stack" });
  const element = h("div", { class: "stack" }, cost, h("div", { class: "row" }, start), problems, progress);
  const done = () => session?.state === "finished" && session.stage === null;
  const running = () => session !== null && session.stage !== null;
  const enable = () => {
    start.disabled = running() || service.devices?.activity === "session";
    say(start, session ? "Repeat the photographs" : "Take photographs");
    start.classList.toggle("primary", !done() && !running());
    cost.hidden = session !== null;
  };
  watch(enable, signal);

  async function estimate() {
    try {
      const [checked, about] = await Promise.all([post("/plans/check", { plan: plan() }, { signal }), post("/plans/estimate", { plan: plan() }, { signal })]);
      cost.replaceChildren(
        h("p", { class: "soft" }, `${count(about.frames)} frames, about ${duration(about.seconds)}, ${bytes(about.bytes + (about.results_bytes ?? 0))} at most.${about.exposure_assumed ? " Metering finds the exposure." : ""}`),
        ...[...checked.problems, ...checked.warnings].map((text) => h("p", { class: "message", "data-tone": "warn" }, text)));
    } catch (problem) {
      if (problem.name !== "AbortError") cost.replaceChildren(problemMessage(problem));
    }
  }

  async function begin() {
    start.disabled = true;
    problems.replaceChildren();
    try {
      const made = await post("/sessions", { plan: plan() }, { headers: { "Idempotency-Key": randomId() } });
      began(made.id);
      await follow(made.id);
    } catch (problem) {
      problems.replaceChildren(problemMessage(problem));
    }
    enable();
  }

  /** Shows a session until it has ended. */
  async function follow(/** @type {string} */ of) {
    watching.abort();
    watching = new AbortController();
    const mine = firstOf(watching.signal, signal);
    const path = `/sessions/${of}`;
    try {
      session = await get(path, { signal: mine });
    } catch (problem) {
      if (problem.name === "AbortError") return;
      session = null;
      problems.replaceChildren(problem.status === 404 ? h("p", { class: "message", "data-tone": "warn" }, "The session of these photographs no longer exists. Take them again.") : problemMessage(problem));
      await estimate();
      return changed();
    }
    const phases = course(session?.plan);
    const bar = h("progress", { max: 1, value: 0, "aria-label": "Frames taken" });
    const link = h("a", { href: `#/session/${of}` }, "Session");
    const taken = h("span", { class: "soft" });
    const noted = h("div", { class: "stack" });
    function changed() {
      if (!session) return enable();
      phases.update(session);
      bar.value = session.frames_committed / Math.max(1, session.frames_planned);
      say(taken, `${session.frames_committed} of ${session.frames_planned} frames · ${session.state}`);
      noted.replaceChildren(...[...(session.warnings ?? []).map((text) => ({ text, tone: "warn" })), ...(session.error ? [{ text: `${session.error} The page of the session shows the remedy; a resumed session continues here.`, tone: null }] : [])]
        .map(({ text, tone }) => h("p", { class: "message", "data-tone": tone }, text)));
      // Only one course has these phases on a page, that of the session in progress.
      progress.replaceChildren(...(running() ? [phases.element, bar] : []), h("p", { class: "row" }, taken, link), noted);
      enable();
      judge(element);
    }
    changed();
    const read = async () => {
      const next = await get(path, { signal: mine }).catch(() => null);
      if (next) session = next;
      changed();
    };
    const take = (/** @type {object} */ part) => {
      if (mine.aborted || !session) return;
      const before = running();
      session = { ...session, ...part };
      changed();
      // Warnings and results are complete at the end.
      if (before && !running()) read();
    };
    listen(`${path}/events`, { event: (name, value) => {
      if (name === "state") take(value);
      else if (name === "stage") take({ stage: value.stage, eta_s: value.eta_s, activity: null });
      else if (name === "activity") take({ activity: value, eta_s: value.eta_s ?? null });
      else if (name === "frame" && session) take({ frames_committed: Math.min(session.frames_planned, session.frames_committed + 1) });
      else if (name === "results") read();
    } }, { signal: mine, rest: true });
  }
  function changed() {
    enable();
    judge(element);
  }
  if (id) follow(id);
  else estimate();
  return { element, done, estimate, session: () => session };
}

/**
 * The result of a calibration and its storage. `show(id)` follows the reconstruction or session `id`; those that are stored by
 * themselves have `automatic`.
 * @param {{ kind: string, automatic: boolean, name: () => string, kept: string | null, keeps: (id: string) => void, signal: AbortSignal }} options
 */
export function resultOf({ kind, automatic, name, kept, keeps, signal }) {
  let shown = "";
  let done = false;
  const said = h("p", { class: "soft", role: "status", "aria-live": "polite" });
  const body = h("div", { class: "stack" });
  const element = h("div", { class: "stack", id: "calibration-result" }, said, body);

  /** @param {string} id */
  async function follow(id) {
    if (shown === id) return;
    shown = id;
    done = false;
    body.replaceChildren();
    try {
      const path = `/reconstructions/${id}`;
      let job = await get(path, { signal });
      while (shown === id && !signal.aborted && ["queued", "running"].includes(job.state)) {
        say(said, job.state === "queued" ? "Waiting for its turn." : `Computing: ${percent(job.progress, 0)}`);
        await new Promise((resolve) => setTimeout(resolve, 300));
        job = await get(path, { signal });
      }
      if (shown === id && !signal.aborted) await paint(job);
    } catch (problem) {
      if (problem.name === "AbortError") return;
      shown = "";
      body.replaceChildren(problemMessage(problem));
    }
  }

  /** @param {Job} job */
  async function paint(job) {
    say(said, "");
    if (job.state !== "done" || !job.report) {
      body.replaceChildren(h("p", { class: "message", role: "alert" }, job.error ?? `The computation ended: ${job.state.replace("_", " ")}.`));
      return judge(element);
    }
    const [file, alt] = CHARTS[kind] ?? [];
    const image = file ? h("img", { alt, class: "chart", hidden: true }) : null;
    const storage = h("div", { class: "stack" });
    body.replaceChildren(reportOfReference(job.report), ...(image ? [h("figure", { class: "reference-chart" }, h("div", { class: "well" }, image), h("figcaption", { class: "soft" }, `${alt}.`))] : []), h("p", {}, h("a", { href: `#/result/${job.id}` }, "Result with all files")), storage);
    const { items } = await get(`/calibrations?kind=${kind}`, { signal });
    const own = items.find((one) => one.id === kept || (automatic && !one.reconstruction && one.session === job.session));
    paintStorage(storage, job, own?.id);
    if (!file || !image) return;
    picture(`/reconstructions/${job.id}/files/${file}`, { signal }).then(({ blob }) => show(image, blob), (problem) => problem.name !== "AbortError" && complain(problem));
  }

  /** @param {HTMLElement} storage @param {Job} job @param {string} [id] */
  function paintStorage(storage, job, id) {
    if (id) {
      done = true;
      keeps(id);
      storage.replaceChildren(h("p", { class: "message", "data-tone": "good" }, `${automatic ? "The session has stored this calibration." : "This calibration is stored."} New sessions use it if it applies to the bench.`),
        h("div", { class: "row" }, h("a", { class: "button primary", href: "#/calibration" }, "All calibrations"), h("a", { class: "button", href: `#/calibration/${id}` }, "This calibration")));
      return judge(element);
    }
    const named = h("input", { id: "calibration-name", value: name(), maxlength: 200, autocomplete: "off" });
    const key = randomId();
    const keep = h("button", { type: "button", class: "primary", id: "keep", onclick: async () => {
      keep.disabled = true;
      try {
        const made = await post("/calibrations", { from: job.id, name: named.value.trim() }, { headers: { "Idempotency-Key": key } });
        kept = made.id;
        paintStorage(storage, job, made.id);
      } catch (problem) {
        complain(problem);
        keep.disabled = false;
      }
    } }, "Keep");
    storage.replaceChildren(h("div", { class: "row end" }, field("Name of the calibration", named), keep));
    judge(element);
  }
  return { element, follow, done: () => done, title: KINDS[kind][0] };
}
