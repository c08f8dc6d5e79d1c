// Renderings: the picture while it is made, its exposure, the report.

import { picture, post, show } from "./api.js";
import { warned } from "./assetreports.js";
import { facts, figures, h, panel, say, settle, svg } from "./dom.js";
import { complain } from "./feedback.js";
import { duration, fixed, percent, plain } from "./format.js";

/** What the service exposes anew, in pixels. */
const MOST_EXPOSED = 4 * 1024 * 1024;

/** Size of the chart of noise, and room for its labels. */
const CHART = { width: 620, height: 120, left: 44, right: 12, top: 10, bottom: 20 };

/**
 * Noise against passes, both logarithmic, with the target: noise falls with the square root of the passes.
 * @param {{ passes: number, noise: number }[]} points
 * @param {number} wanted
 * @param {number} of
 */
function noiseChart(points, wanted, of) {
  const { width, height, left, right, top, bottom } = CHART;
  const most = Math.max(wanted * 2, ...points.map((p) => p.noise));
  const [low, high] = [Math.log(wanted / 1.5), Math.log(most * 1.1)];
  const end = Math.log(Math.max(of, 4));
  const x = (passes) => left + ((width - left - right) * Math.log(Math.max(1, passes))) / end;
  const y = (noise) => top + ((height - top - bottom) * (high - Math.log(noise))) / (high - low);
  const path = points.map(({ passes, noise }, k) => `${k ? "L" : "M"}${x(passes).toFixed(1)} ${y(noise).toFixed(1)}`).join("");
  const rows = [1, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001].filter((noise) => noise > wanted * 1.25 && noise < most)
    // As many as have room for their labels.
    .filter((_, k, all) => k % Math.ceil(all.length / 4) === 0);
  return svg("svg", { class: "noise", viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": `Noise after ${points.length} measurements; target ${plain(100 * wanted)} %` },
    rows.map((noise) => [svg("line", { class: "grid", x1: left, x2: width - right, y1: y(noise), y2: y(noise) }), svg("text", { x: left - 6, y: y(noise) + 4, "text-anchor": "end" }, `${plain(100 * noise)} %`)]),
    svg("line", { class: "target", x1: left, x2: width - right, y1: y(wanted), y2: y(wanted) }), svg("text", { x: width - right, y: y(wanted) - 4, "text-anchor": "end" }, `target ${plain(100 * wanted)} %`),
    svg("path", { class: "curve", d: path }), svg("text", { x: left, y: height - 4 }, "1 pass"), svg("text", { x: width - right, y: height - 4, "text-anchor": "end" }, `about ${of} passes`));
}

/** The panel of the picture so far; `update(job)` with each state of the job. */
export function soFar(job, signal) {
  const path = `/reconstructions/${job.id}/picture.png`;
  const image = h("img", { id: "so-far", alt: "The picture so far", hidden: true });
  const empty = h("p", { class: "empty" }, "The picture appears with its first pass.");
  const about = h("div");
  const chart = h("div");
  /** @type {{ passes: number, noise: number }[]} */
  const points = [];
  let finishing = false;
  const keep = h("button", { type: "button", id: "keep-so-far", disabled: true, title: "Ends the passes; the picture so far becomes the result, with its noise", onclick: async () => {
    [keep.disabled, finishing] = [true, true];
    try {
      await post(`/reconstructions/${job.id}/finish`);
    } catch (problem) {
      complain(problem);
    }
  } }, "Stop and keep the picture");
  const wanted = job.options?.max_error ?? 0.01;
  let shown = 0;
  let asking = false;
  /** @param {Job} job */
  async function update({ so_far: now }) {
    if (!now || asking || now.passes === shown) return;
    asking = true;
    try {
      const { blob } = await picture(path, { signal });
      show(image, blob);
      empty.hidden = true;
      shown = now.passes;
      about.replaceChildren(figures([
        [`noise; ${plain(100 * wanted)} % asked for`, now.noise === null ? "not known yet" : percent(now.noise, 2)],
        [`of about ${now.of} passes`, String(now.passes)],
        ["to go", `about ${duration(Math.max(1, Math.round(now.seconds_left)))}`],
      ]));
      if (now.noise) points.push({ passes: now.passes, noise: now.noise });
      if (points.length) chart.replaceChildren(noiseChart(points, wanted, now.of));
      keep.disabled = finishing || now.noise === null;
    } catch (problem) {
      // Between the last look and the result there is none.
      if (problem.status !== 404) complain(problem);
    } finally {
      asking = false;
    }
  }
  return { element: panel("Picture so far", keep, h("div", { class: "stack" }, h("div", { class: "well" }, image, empty), about, chart)), update };
}

/** A slider that shows a finished picture brighter or darker; none for pictures too large for it. */
export function exposure(job, image, signal) {
  const [width, height] = job.report.size;
  if (width * height > MOST_EXPOSED) return null;
  const stops = h("output", { for: "exposure" }, "as rendered");
  const slider = h("input", { type: "range", id: "exposure", min: -6, max: 6, step: 0.25, value: 0, oninput: () => {
    say(stops, slider.valueAsNumber === 0 ? "as rendered" : `${slider.valueAsNumber > 0 ? "+" : ""}${fixed(slider.valueAsNumber, 2)} stops`);
    load();
  } });
  const load = settle(120, async () => {
    const wanted = slider.value;
    try {
      const { blob } = await picture(`/reconstructions/${job.id}/picture.png?stops=${wanted}`, { signal });
      if (wanted === slider.value) show(image, blob);
    } catch (problem) {
      complain(problem);
    }
  });
  return h("div", { class: "row exposure" }, h("label", { for: "exposure" }, "Exposure"), slider, stops);
}

/** A rendering's report. */
export function reportOfRender(report) {
  const { predicted, materials, settings, spectral = null, warnings = [] } = report;
  const measured = report.measured_model_error ?? null;
  return h("div", { class: "stack" }, warned(warnings),
    figures([
      [`noise; ${plain(100 * settings.max_error)} % asked for`, percent(report.noise, 2)],
      [measured === null ? "sums off by, as predicted" : "sums off by, measured", percent(measured ?? report.predicted_model_error, 2)],
      ["samples per pixel", String(report.samples)],
    ]),
    facts([
      ["Size", `${report.size[0]} × ${report.size[1]}`],
      ...Object.entries(materials).map(([name, notes]) => /** @type {[string, Child]} */ ([`Material ${name}`, notes.method])),
      ["Expected", `noise ${percent(predicted.noise, 2)} after ${predicted.passes} passes in ${duration(predicted.seconds)}`],
      ["Sums off by", measured === null ? null : `${percent(report.predicted_model_error, 2)} by prediction`],
      ["Wavelengths", settings.wavelengths === null ? "as many as needed" : plain(settings.wavelengths)],
      ["Spectra", spectral ? `${spectral.bands} bands from ${spectral.range_nm[0]} to ${spectral.range_nm[1]} nm in render.exr, ${spectral.noise === null ? "noise unknown after one pass" : `noise ${percent(spectral.noise, 2)} at most`}` : null],
      ["Exposure", `linear light times ${plain(Number(report.exposure.toPrecision(4)))}`],
      ["Took", `${duration(report.seconds)}, of which passes ${duration(report.seconds_of_passes)}`],
    ]),
    h("details", {}, h("summary", {}, "Taken for granted"), h("ul", {}, (report.assumptions ?? []).map((a) => h("li", { class: "soft" }, a)))));
}
