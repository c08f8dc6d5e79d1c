// #/calibrate/panel: how bright the panel is at each level, and when a new picture is there, as the camera sees it.

import { get, post } from "./api.js";
import { judged } from "./calibrated.js";
import { field, firstOf, h, panel, pause, save, say, select, svg } from "./dom.js";
import { complain, problemMessage } from "./feedback.js";
import { count, fixed, percent, significant } from "./format.js";
import { previewPanel } from "./preview.js";
import { refresh } from "./service.js";
import { guided, stepOf } from "./wizard.js";

/** White, as even fringes. */
const WHITE = { fringes: { cycles_per_mm: [0, 0], phase: 0, gamma: 1 } };
const POLL_MS = 500;

/** All steps. */
export function panelWizard() {
  const sight = sightStep();
  const measured = measureStep();
  const steps = guided([sight, measured]);
  const result = h("div", { class: "stack", id: "panel-result" });
  measured.element.addEventListener("found", (event) => result.replaceChildren(...results(/** @type {CustomEvent} */ (event).detail)));
  measured.element.addEventListener("measuring", sight.rest);
  steps.append(result);
  // The live picture and the measurement are looked after while the page is shown.
  steps.addEventListener("shown", (event) => {
    const { detail: signal } = /** @type {CustomEvent<AbortSignal>} */ (event);
    sight.watch(signal);
    measured.watch(signal);
  });
  return steps;
}

function sightStep() {
  let seen = false;
  let said = "the panel is not lit yet";
  const live = h("div", { hidden: true });
  const judge = () => step.element.dispatchEvent(new Event("judge"));
  const lit = h("button", { type: "button", id: "panel-light", onclick: light }, "Light the panel");
  const dark = h("button", { type: "button", id: "panel-dark", onclick: () => show("black").catch(complain) }, "Switch it off");
  async function show(pattern) {
    await post("/devices/display/show", { pattern });
    refresh();
  }
  let watched = new AbortController().signal;
  let looking = new AbortController();
  const look = () => live.firstChild ?? live.append(previewPanel(firstOf(watched, looking.signal)));
  const rest = () => {
    looking.abort();
    looking = new AbortController();
    live.replaceChildren();
    live.hidden = true;
  };
  /** Whether what the camera sees gets brighter with the panel. */
  async function light() {
    lit.disabled = true;
    live.hidden = false;
    look();
    try {
      const means = [];
      for (const pattern of ["black", WHITE]) {
        await show(pattern);
        means.push((await get("/devices/camera/preview")).mean);
      }
      const gain = means[1] - means[0];
      seen = gain > 0.002;
      said = seen ? `the picture gets brighter by ${percent(gain, 1)} of full scale` : "the picture does not get brighter: see that the panel lights what the camera sees, or lengthen the exposure on the bench";
    } catch (problem) {
      [seen, said] = [false, [problem.message, problem.remedy].filter(Boolean).join(" ")];
    }
    lit.disabled = false;
    judge();
  }
  const step = stepOf("1. What the camera sees", "a picture that gets brighter with the panel, and no other light", () => [seen, said],
    h("ol", { class: "todo" },
      h("li", {}, "Put white paper in the sample's place, or let the camera see the panel itself. Nothing must move."),
      h("li", {}, "Keep other light away: draw the curtains, switch lamps off."),
      h("li", {}, "Let the panel warm up for a quarter of an hour, and switch dynamic contrast and automatic brightness off."),
      h("li", {}, "Light the panel, and look at the picture. The exposure is chosen by itself later.")),
    h("div", { class: "row" }, lit, dark), live);
  return {
    ...step,
    /** Looks no more: the camera is needed. */
    rest,
    watch(/** @type {AbortSignal} */ signal) {
      watched = signal;
      live.replaceChildren();
      if (!live.hidden) look();
    },
  };
}

function measureStep() {
  /** @type {Measurement | null} */
  let now = null;
  let watched = new AbortController().signal;
  const levels = select([["16", "16: a minute"], ["52", "52: three minutes, for a curve that is no power law"], ["86", "86: five minutes"]], "16", { id: "panel-levels" });
  const start = h("button", { type: "button", id: "panel-start", class: "primary", onclick: begin }, "Measure the panel");
  const bar = h("progress", { max: 1, value: 0, "aria-label": "Progress of the measurement" });
  const stage = h("p", { class: "soft", role: "status" });
  const running = h("div", { class: "stack", hidden: true }, bar, stage);
  const problems = h("div", { role: "status" });
  const step = stepOf("2. Measure", "luminances that grow with the level and return to the same, and no picture that comes late", () => {
    if (now?.state === "running") return [false, "measuring"];
    if (now?.state === "done") return [true, "measured"];
    return [false, now?.state === "failed" ? "failed" : now?.state === "stopped" ? "stopped" : "ready"];
  },
  h("p", {}, "The panel shows even levels from black to white and back, and changes between the two; the camera looks on. The bench is busy meanwhile; STOP ends it."),
  h("div", { class: "fields" }, field("Levels", levels)), h("div", { class: "row" }, start), running, problems);

  async function begin() {
    problems.replaceChildren();
    start.disabled = true;
    step.element.dispatchEvent(new Event("measuring"));
    try {
      now = await post("/devices/display/measure", { levels: Number(levels.value) });
      follow(watched);
    } catch (problem) {
      problems.replaceChildren(problemMessage(problem));
      start.disabled = false;
    }
  }

  /** Tells how it goes until it has ended. */
  async function follow(/** @type {AbortSignal} */ signal) {
    try {
      do {
        paint();
        if (now?.state !== "running") break;
        await pause(POLL_MS, signal);
        now = await get("/devices/display/measurement", { signal });
      } while (!signal.aborted);
      refresh();
    } catch (problem) {
      if (!signal.aborted) problems.replaceChildren(problemMessage(problem));
      start.disabled = false;
    }
  }

  function paint() {
    const open = now?.state === "running";
    start.disabled = open;
    running.hidden = !open;
    bar.value = now?.progress ?? 0;
    say(stage, open ? `${now?.stage} (${percent(now?.progress ?? 0, 0)})` : "");
    if (now?.state === "failed") problems.replaceChildren(h("p", { class: "message", role: "alert" }, now.error));
    else if (now?.state === "stopped") problems.replaceChildren(h("p", { class: "message", "data-tone": "warn" }, "It was stopped. All light is off; measure again when all is well."));
    step.element.dispatchEvent(new Event("judge"));
    if (now?.state === "done") step.element.dispatchEvent(new CustomEvent("found", { detail: now.found }));
  }
  return {
    ...step,
    /** Goes on with a measurement that is under way, or shows the newest one. */
    async watch(/** @type {AbortSignal} */ signal) {
      watched = signal;
      now = await get("/devices/display/measurement", { signal }).catch(() => now);
      if (now && now.state !== "none" && !signal.aborted) follow(signal);
    },
  };
}

/**
 * What was found, and what to do with it.
 * @param {NonNullable<Measurement["found"]>} found
 */
function results(found) {
  const { law, drift, late_frames: late, late_ms, pixels, exposure_ms, luminances, advice } = found;
  const findings = [
    { what: "Tone curve", got: `luminance grows with the level to the power ${fixed(law.gamma, 3)} ± ${significant(law.gamma_sigma, 2)}, within ${percent(law.deviation, 1)} of white`, expected: "a power law, within 2 %", met: law.deviation <= 0.02, helps: "Choose the panel's sRGB or gamma preset and measure again, or use the measured curve below." },
    { what: "Black", got: `${percent(law.black, 2)} of white`, expected: "at most 1 %", met: law.black <= 0.01, helps: "Lower the panel's brightness, or keep other light away." },
    { what: "Drift", got: `${percent(drift, 2)} of white between the way up and the way down`, expected: "at most 1 %", met: drift <= 0.01, helps: "Let the panel warm up, switch dynamic contrast and automatic brightness off, and measure again." },
    { what: "Pictures in time", got: late ? `${count(late)} frames were too early, the last ${fixed(late_ms, 0)} ms after the panel said that it shows the picture` : "every frame showed what the panel said", expected: "none too early", met: late === 0, helps: "Set the panel's response time as it says below." },
    { what: "Seen by", got: `${count(pixels)} pixels, exposed for ${significant(exposure_ms, 3)} ms`, expected: "thousands", met: pixels >= 1000, helps: "Let the camera see more of what the panel lights." },
  ];
  const keep = h("button", { type: "button", class: "primary", id: "panel-save", onclick: () => save(new Blob([JSON.stringify(found, null, 2)], { type: "application/json" }), "panel.json") }, "Download panel.json");
  return [
    panel("What came of it", null, h("div", { class: "columns halves" }, judged(findings, false), curve(luminances, law))),
    panel("What to do with it", null, h("div", { class: "stack" },
      h("ol", { class: "todo" }, h("li", {}, "Put these lines where they say, into the service's configuration or into plans."), h("li", {}, "Measure again when brightness, picture mode or the panel are changed.")),
      h("ul", { class: "advice", id: "panel-advice" }, advice.map((line) => h("li", {}, h("code", {}, line)))),
      h("div", { class: "row" }, keep))),
  ];
}

/** Luminances over levels with the power law through them. */
function curve(luminances, { gamma, black }) {
  const [width, height, left, bottom, top] = [420, 280, 46, 40, 10];
  const x = (/** @type {number} */ v) => left + (width - left - 10) * v;
  const y = (/** @type {number} */ v) => top + (height - top - bottom) * (1 - v);
  const law = Array.from({ length: 101 }, (_, k) => `${k ? "L" : "M"}${x(k / 100).toFixed(1)} ${y(black + (1 - black) * (k / 100) ** gamma).toFixed(1)}`).join("");
  const text = (/** @type {number} */ tx, /** @type {number} */ ty, /** @type {string} */ words, anchor = "middle") => svg("text", { x: tx, y: ty, "text-anchor": anchor }, words);
  const marks = [0, 0.25, 0.5, 0.75, 1].map((v) => [
    svg("line", { class: "grid", x1: left, x2: width - 10, y1: y(v), y2: y(v) }), text(left - 6, y(v) + 4, percent(v, 0), "end"),
    svg("line", { class: "grid", x1: x(v), x2: x(v), y1: top, y2: height - bottom }), text(x(v), height - bottom + 15, String(Math.round(255 * v)), v === 1 ? "end" : "middle")]);
  return h("figure", {}, svg("svg", { class: "chart", viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": `Luminance over level: ${luminances.length} measured points and a power law of ${fixed(gamma, 2)}` },
    marks, svg("path", { class: "fit", d: law }), luminances.map((v, k) => svg("circle", { class: "point", r: 3, cx: x(k / (luminances.length - 1)), cy: y(v) })),
    text((left + width) / 2, height - 6, "level (code of 255)")),
  h("figcaption", { class: "soft" }, "Luminance as a part of white's: points as measured, the line a power law."));
}
