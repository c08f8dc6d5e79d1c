// #/result/ID: the maps of a reconstruction, one pixel in detail, downloads, the report; before that, its progress.

import { get, listen, makeDownload, picture, post } from "./api.js";
import { h, panel, say } from "./dom.js";
import { complain, problemMessage, tell } from "./feedback.js";
import { degrees, duration, fixed, percent, significant } from "./format.js";
import { showGratings } from "./gratings.js";
import { forFile, headingOf } from "./naming.js";
import { notifyButton } from "./notify.js";
import { operationForm } from "./operationform.js";
import { showPictures } from "./pictures.js";
import { pixelChart } from "./pixelchart.js";
import { soFar } from "./rendering.js";
import { reportView } from "./report.js";

/** Maps in the order in which they are wanted. */
const ORDER = ["orientation", "smoothed", "period", "sigma", "dolp", "mask", "s0", "aolp"];
const PLAIN = ["aolp", "dolp", "sigma", "mask", "s0"];
const MEANING = {
  orientation: "Direction of the grating vector, across the grooves, anticlockwise from image right, up to one offset that all pixels share.",
  smoothed: "The orientations after the bilateral filter, for the eye: measure on the map beside it.",
  sigma: "Standard deviation of the orientation: camera noise, how far the model may be wrong, and edges that a lens may mix.",
  dolp: "Degree of linear polarization.",
  mask: "White where there is an orientation: not saturated, and σ at most 7.2°.",
  s0: "Intensity without the analyser.",
  aolp: "Angle of linear polarization, anticlockwise from image right.",
};
const PLAIN_MEANING = {
  sigma: "Standard deviation of the angle of polarization.",
  mask: "White where the angle of polarization is known: not saturated, and σ at most 7.2°.",
};
const FORMATS = [["exr", "EXR"], ["png", "PNG"], ["csv", "CSV"], ["npy", "NumPy"]];

/**
 * Shows a reconstruction until the signal fires.
 * @param {HTMLElement} main
 * @param {Visit} visit
 */
export async function resultPage(main, { id, signal }) {
  /** @type {Job} */
  const job = await get(`/reconstructions/${id}`, { signal });
  if (signal.aborted) return;
  if (job.state === "done" && job.report && ["spots", "flash"].includes(job.method)) return showGratings(main, job, signal);
  if (job.state === "done" && job.method === "inspect") return (await import("./inspection.js")).showInspection(main, job, signal);
  if (job.state === "done" && job.report) return job.method === "polarization" ? showMaps(main, job, signal) : showPictures(main, job, signal);
  await showProgress(main, job, signal);
}

/**
 * @param {HTMLElement} main
 * @param {Job} job
 * @param {AbortSignal} signal
 */
async function showProgress(main, job, signal) {
  const state = h("p", { role: "status", "aria-live": "polite" });
  const progress = h("progress", { id: "progress", max: 1, "aria-label": "Progress" });
  const error = h("div");
  const act = async (verb) => {
    try {
      await post(`/reconstructions/${job.id}/${verb}`);
    } catch (problem) {
      complain(problem);
    }
  };
  const cancel = h("button", { type: "button", onclick: () => act("cancel") }, "Cancel");
  const retry = h("button", { type: "button", onclick: async () => { await act("retry"); dispatchEvent(new HashChangeEvent("hashchange")); } }, "Try again");
  const log = h("pre", { class: "scroll code", hidden: true, tabindex: 0 });
  const readLog = h("button", { type: "button", onclick: async () => {
    try {
      const { blob } = await picture(`/reconstructions/${job.id}/log`, { signal });
      log.textContent = await blob.text();
      log.hidden = false;
    } catch (problem) {
      complain(problem);
    }
  } }, "Log");
  const notify = notifyButton(`/reconstructions/${job.id}`, `#/result/${job.id}`);
  const seen = job.method === "render" ? soFar(job, signal) : null;
  const how = panel("Progress", h("div", { class: "row" }, notify, cancel, retry, readLog), h("div", { class: "stack" }, state, progress, error, log));
  main.append(h("div", { class: "head" }, headingOf(job), h("a", { class: "button", href: "#/queue" }, "Queue")),
    seen ? h("div", { class: "columns result" }, seen.element, how) : how);
  const paint = (/** @type {Job} */ now) => {
    const open = now.state === "queued" || now.state === "running";
    const ended = { done: "Done.", failed: "Failed.", cancelled: "Cancelled.", set_aside: `Set aside after ${now.attempts} attempts.` }[now.state];
    say(state, ended ?? `${now.state === "queued" ? "Waiting for its turn" : "Running"}${now.stage ? `: ${now.stage}` : ""} (${percent(now.progress, 0)})${now.remaining_s ? `, about ${duration(now.remaining_s)} left` : ""}`);
    progress.value = now.progress;
    seen?.update(now);
    cancel.disabled = !open;
    notify.hidden ||= !open;
    if (now.state === "running") document.title = `${percent(now.progress, 0)} · ${job.name} · Nacre`;
    retry.disabled = open || now.state === "done";
    error.replaceChildren(...(now.error ? [h("p", { class: "message", role: "alert" }, now.error)] : []));
    // The page starts over with the maps.
    if (now.state === "done") dispatchEvent(new HashChangeEvent("hashchange"));
  };
  paint(job);
  if (job.state !== "queued" && job.state !== "running") return;
  listen(`/reconstructions/${job.id}/events`, { event: (name, now) => name === "state" && !signal.aborted && paint(now) }, { signal, rest: true });
}

/**
 * @param {HTMLElement} main
 * @param {Job} job
 * @param {AbortSignal} signal
 */
async function showMaps(main, job, signal) {
  const { report } = job;
  const base = `/reconstructions/${job.id}`;
  const plain = report.model === "plain";
  // The viewer is fetched when it is wanted, as it is a third of the page's scripts.
  const { mapViewer, mapsOf } = await import("./mapviewer.js");
  const first = plain ? PLAIN : ORDER;
  const maps = await mapsOf(job.id, first, signal);
  if (signal.aborted) return;
  const meaning = h("p", { class: "soft" });
  const links = FORMATS.map(([ending, label]) => h("a", { class: "button", "data-download": ending }, label));
  let asked = 0;
  function shown(/** @type {MapInfo} */ { name }) {
    say(meaning, name === "period" && report.period ? periodMeaning(report.period) : (plain && PLAIN_MEANING[name]) || (MEANING[name] ?? ""));
    for (const link of links) makeDownload(link, `${base}/maps/${name}.${link.dataset.download}`, `${forFile(job)}-${name}.${link.dataset.download}`, complain);
  }

  const detail = h("div", { class: "stack", "aria-live": "polite" }, h("p", { class: "soft" }, "Click the map to see how a pixel was measured."));
  async function pick(x, y) {
    const mine = ++asked;
    viewer.mark(x, y, null);
    try {
      const pixel = await get(`${base}/pixel?x=${x}&y=${y}`, { signal });
      if (mine !== asked) return;
      const angle = plain ? pixel.aolp_deg : pixel.orientation_deg;
      viewer.mark(x, y, angle);
      detail.replaceChildren(h("p", { class: "verdict" }, verdict(pixel, angle, plain)), report.period && !pixel.masked ? h("p", {}, periodVerdict(pixel, report.period)) : "", pixelChart(pixel),
        h("p", { class: "soft" }, `x ${x}, y ${y} · S0 ${significant(pixel.s0)} · S1 ${significant(pixel.s1)} · S2 ${significant(pixel.s2)} · DoLP ${fixed(pixel.dolp, 3)} · residual ${significant(pixel.residual_rms, 2)} rms`));
    } catch (problem) {
      if (mine === asked && problem.name !== "AbortError") detail.replaceChildren(problemMessage(problem));
    }
  }
  // Reports of versions that had hues alone do not name the palette.
  const viewer = mapViewer({ id: job.id, method: "polarization", maps, first, palette: report.palette ?? "hsv", title: job.name, named: forFile(job), pick, shown, signal,
    under: h("div", { class: "under" }, h("div", { class: "stack" }, meaning, h("div", { class: "row" }, h("span", { class: "soft" }, "Download this map"), links))) });

  const options = operationForm("polarization", { ...job.options });
  const again = h("button", { type: "button", id: "again", onclick: async () => {
    try {
      /** @type {Job} */
      const next = await post("/operations/polarization", { session: job.session, upload: job.upload, options: options.options() });
      tell("Reconstructing anew.");
      location.hash = `#/result/${next.id}`;
    } catch (problem) {
      complain(problem);
    }
  } }, "Reconstruct again");

  main.append(
    h("div", { class: "head" }, headingOf(job),
      plain ? null : h("a", { class: "button primary", id: "to-view", href: `#/view/${job.id}` }, "Under a light"),
      plain ? null : h("a", { class: "button", href: `#/render/${job.id}` }, "Render"),
      plain ? null : h("a", { class: "button", id: "to-inspect", href: `#/inspect/${job.id}` }, "Inspect against…"),
      job.session ? h("a", { class: "button", href: `#/session/${job.session}` }, "Session") : null),
    h("div", { class: "columns result" },
      viewer.element,
      h("div", { class: "stack" }, viewer.aside,
        panel("Pixel", null, detail),
        panel("Report", null, reportView(report)),
        panel("Options", null, options.element, h("div", { class: "row end" }, again)))));
}

/** What the map of periods is worth. */
function periodMeaning({ heuristic, method }) {
  if (heuristic) return "Heuristic periods from the brightness: only their order has a meaning, and only where light and reflectance are even.";
  return `Periods from the polarization, if the surface is ${method.metal}, ${significant(1000 * method.depth_um)} nm deep, under an index of ${method.index_above}, at ${significant(method.wavelength_nm)} nm. Masked where none or several would answer.`;
}

/** The period of a pixel in words. */
function periodVerdict(pixel, { heuristic }) {
  if (pixel.period_um === null) return "No period can be told.";
  return heuristic ? `Heuristic period ${fixed(pixel.period_um, 3)} µm.` : `Period ${fixed(pixel.period_um, 3)} ± ${significant(pixel.period_sigma_um, 2)} µm (noise alone) for the assumed surface.`;
}

/** A pixel in words. */
function verdict(pixel, angle, plain) {
  if (pixel.saturated) return "Masked: saturated in at least one photograph.";
  if (pixel.masked || angle === null) return `Masked: too little modulation to tell an angle (σ would be ${degrees(pixel.sigma_deg, 1)}).`;
  const digits = pixel.sigma_deg < 0.1 ? 2 : 1;
  if (plain) return `The light is polarized at ${degrees(angle, digits)} ± ${degrees(pixel.sigma_deg, digits)} anticlockwise from image right.`;
  return `The grating vector points ${degrees(pixel.orientation_deg, digits)} ± ${degrees(pixel.sigma_deg, digits)} anticlockwise from image right; the grooves run at ${degrees((pixel.orientation_deg + 90) % 180, digits)}.`;
}
