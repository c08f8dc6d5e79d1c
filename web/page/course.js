// The course of a session: its phases, what the devices do now, and the remaining time, which runs down between events.

import { h, say } from "./dom.js";
import { degrees, duration, percent, words } from "./format.js";

/** Phases in their order. */
const PHASES = [["metering", "Metering"], ["frames", "Frames"], ["results", "Results"]];

/** The phase that a stage of the service belongs to; null before the first. */
export function phaseOf(/** @type {string | null} */ stage) {
  if (!stage || stage === "waiting") return null;
  if (stage.startsWith("metering")) return "metering";
  return stage === "capturing" ? "frames" : "results";
}

/** Phases that a session with this plan has. */
function phasesOf(plan) {
  const metered = plan?.camera?.exposure === "meter" || Boolean(plan?.bracket) || (plan?.kind === "calibration" && !plan?.camera?.exposure_ms);
  return PHASES.filter(([key]) => key === "frames" || (key === "metering" ? metered : Boolean(plan?.reconstruct)));
}

/** The present activity of the devices, in words. */
function doing(/** @type {Activity | null} */ now) {
  switch (now?.activity) {
    case "homing": return "finding the zero of the analyser";
    case "lighting": return "changing the light";
    case "turning": return `turning the analyser to ${degrees(now.analyser_deg, 1)}`;
    case "exposing": return `exposing${now.exposure_s ? ` for ${duration(now.exposure_s)}` : ""}`;
    case "saving": return "saving the last frames";
    default: return "";
  }
}

/** Remaining time, rounded as far as it can be known. */
const left = (/** @type {number} */ seconds) => (seconds < 1 ? "soon" : seconds < 99.5 ? `${Math.round(seconds)} s` : duration(seconds));

/**
 * The list of phases with what happens now; `eta` is the remaining time, and `title()` a few words for the window.
 * @param {any} plan
 */
export function course(plan) {
  const items = phasesOf(plan).map(([key, label]) => ({ key, item: h("li", {}, label) }));
  const now = h("p", { id: "session-now", class: "soft", role: "status", "aria-live": "off" });
  const eta = h("span", { id: "session-eta" }, "–");
  /** @type {Session | null} */
  let session = null;
  let told = 0;

  function paint() {
    if (!session) return;
    const phase = phaseOf(session.stage);
    const at = items.findIndex(({ key }) => key === phase);
    // Frames of an earlier run need no second metering.
    const done = session.stage === null && session.state === "finished";
    items.forEach(({ item }, k) => {
      item.dataset.is = done || k < at ? "done" : k === at ? "now" : "to-come";
      if (k === at && !done) item.setAttribute("aria-current", "step");
      else item.removeAttribute("aria-current");
    });
    const what = phase === "results" ? words(session.stage) : doing(session.activity);
    now.hidden = session.stage === null;
    say(now, session.stage === null || session.state === "paused" ? "" : phase ? `Now: ${what || "preparing"}` : "Waiting for the bench");
    const remaining = session.eta_s === null || session.stage === null ? null : Math.max(0, session.eta_s - (performance.now() - told) / 1000);
    say(eta, remaining === null ? duration(session.timing?.wall_s) : left(remaining));
  }

  return {
    element: h("div", { class: "course" }, h("ol", { class: "phases", "aria-label": "Phases" }, items.map(({ item }) => item)), now),
    eta,
    paint,
    /** Takes what the service says of the session; `fresh` if its remaining time was told just now. */
    update(/** @type {Session} */ next, fresh = true) {
      session = next;
      if (fresh) told = performance.now();
      paint();
    },
    title() {
      if (!session) return "";
      const phase = phaseOf(session.stage);
      if (session.state === "paused") return "Paused";
      return phase === "frames" ? percent(session.frames_committed / Math.max(1, session.frames_planned), 0) : phase === "metering" ? "Metering" : phase ? "Results" : "Waiting";
    },
  };
}
