// #/calibrate/ID: what came of a calibration by photographs, or its progress.

import { get, listen, makeDownload } from "./api.js";
import { lightVerdict, verdict } from "./calibrated.js";
import { h, panel } from "./dom.js";
import { complain } from "./feedback.js";
import { percent } from "./format.js";

/** What to do where nothing came of it. */
const BOARD = [
  "Count the inner corners again: one less than squares, along the longer side first.",
  "See that every photograph shows all of the board, sharp and without reflections, and a white margin around it.",
  "Take more photographs, tilted differently, and calibrate anew.",
];
const LIGHT = [
  "See that the light in the mirror is the only bright thing in each photograph: darken the room, and shorten the exposure until little else is seen.",
  "Measure how high the mirror lay, from the sample's surface to the mirror's, and let the heights differ by a third of the light's distance or more.",
  "See that camera and sample stand as they did when geometry.json was made.",
];

/**
 * Shows it until the signal fires.
 * @param {HTMLElement} main
 * @param {string} id
 * @param {AbortSignal} signal
 */
export async function outcome(main, id, signal) {
  const holder = h("div", { class: "stack wizard" });
  main.append(holder);
  const path = `/reconstructions/${id}`;
  /** @param {Job} job */
  const paint = (job) => {
    const open = job.state === "queued" || job.state === "running";
    if (open) return holder.replaceChildren(panel("Calibrating", null, h("div", { class: "stack" }, h("p", { role: "status" }, `${job.stage ?? "Waiting for its turn"} (${percent(job.progress, 0)})`), h("progress", { max: 1, value: job.progress, "aria-label": "Progress" }))));
    const onward = Boolean(job.options?.geometry);
    const again = h("a", { class: "button", href: onward ? "#/calibrate/light" : "#/calibrate" }, "Calibrate anew");
    if (job.state !== "done") {
      return holder.replaceChildren(panel("No calibration", null, h("div", { class: "stack" },
        h("p", { class: "message", role: "alert" }, job.error ?? "It was cancelled."),
        h("h3", {}, "What to do"), h("ol", { class: "todo" }, (onward ? LIGHT : BOARD).map((words) => h("li", {}, words))), h("div", { class: "row" }, again))));
    }
    const download = h("a", { class: "button primary", id: "geometry" }, "Download geometry.json");
    makeDownload(download, `${path}/files/geometry.json`, "geometry.json", complain);
    const next = onward ? [] : [h("li", {}, "Go on with “Light and wavelength” for photographs under a flash.")];
    holder.replaceChildren(
      panel("What came of it", null, onward ? lightVerdict(job.report) : verdict(job.report)),
      panel("What to do with it", null, h("div", { class: "stack" },
        h("ol", { class: "todo" }, h("li", {}, "Keep geometry.json. Uploads of tiles and foils, and the options of their results, take it as “Calibration”."), next,
          h("li", {}, onward ? "Calibrate anew when the light or its filter have been changed, and whenever the camera has." : "Calibrate anew when camera, focus, zoom or the sample's holder have been moved.")),
        h("div", { class: "row" }, download, !onward && h("a", { class: "button", href: "#/calibrate/light" }, "Light and wavelength"), h("a", { class: "button", href: `#/result/${id}` }, "All numbers and pictures"), again))));
  };
  /** @type {Job} */
  const job = await get(path, { signal });
  if (signal.aborted) return;
  paint(job);
  if (job.state !== "queued" && job.state !== "running") return;
  listen(`${path}/events`, { event: async (name, now) => {
    if (name !== "state" || signal.aborted) return;
    // Events leave the report out.
    paint(now.state === "done" && !now.report ? await get(path, { signal }) : now);
  } }, { signal, rest: true });
}
