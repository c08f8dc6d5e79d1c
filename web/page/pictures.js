// Results that are pictures rather than maps of orientations: merged exposures, lookup tables, bokeh photographs, BRDF maps.

import { get, makeDownload, picture, post, send, show } from "./api.js";
import { facts, field, figures, h, panel, say, segments, select, svg } from "./dom.js";
import { complain, problemMessage } from "./feedback.js";
import { bytes, duration, fixed, percent, plain, significant, words } from "./format.js";
import { reportOfCalibration, reportOfFoil, reportOfMap, warned } from "./assetreports.js";
import { flashForm } from "./flashform.js";
import { lutForm } from "./lutform.js";
import { hdrView } from "./hdrview.js";
import { lutCurves } from "./lutcurves.js";
import { forFile, headingOf } from "./naming.js";
import { operationForm } from "./operationform.js";
import { reportOfReference } from "./references.js";
import { exposure, reportOfRender } from "./rendering.js";

const REPORTS = { hdr: reportOf, lut: reportOfTable, bokeh: reportOfBokeh, brdf: reportOfBrdf, foil: reportOfFoil, calibrate: reportOfCalibration, map: reportOfMap, render: reportOfRender,
  camera: reportOfReference, flat: reportOfReference, analyser: reportOfReference, retarder: reportOfReference, orientation: reportOfReference };
const MEANING = {
  "hdr.png": "The merged light, tone-mapped for the eye: measure on hdr.exr. White where every exposure is saturated.",
  "lut.png": "The table under its light, tone-mapped for the eye, over half vectors: the zero order is in the middle. Grey is not measured.",
  "deconvolved.png": "The highlight with the lens's blur taken out; light as a share of white.",
  "height.png": "Dark taken for deep. Relative where nothing calibrates it.",
  "brdf.png": "Light towards each direction, seen from above: the rim is grazing, up is up. Orders are spread violet to red away from the mirror direction. Compressed for the eye.",
  "period.png": "The gratings' periods. Grey is masked.",
  "orientation.png": "Direction of the grating vector, across the grooves.",
  "histogram.png": "How frequent dots of each orientation and period are.",
  "before-after.png": "Before on the left, after on the right, in the same colours.",
  "render.png": "The scene as a screen shows it: what is brighter than white is compressed, colours that no screen has are paler. Measure on render.exr.",
  "coverage.png": "Which part of each entry was measured: short wavelengths need light from further out than the photograph may show.",
  "bad-pixels.png": "Pixels whose darkness or response differs from that of the others.",
  "flat.png": "Light of each pixel, relative to the mean.",
  "analyser.png": "Light over the angle of the analyser, and residuals.",
  "retarder.png": "Light over the angle of the analyser, and residuals.",
  "figure.png": "For publications, also as figure.svg: angles or half vectors on the axes, luminance on a logarithmic scale with the limits of its colours.",
};

/** Files that a scene can show. */
const RENDERED = ["orientation.exr", "period.exr", "lut.exr"];

/** Shows the pictures of a finished reconstruction. */
export async function showPictures(main, job, signal) {
  const { report } = job;
  const base = `/reconstructions/${job.id}/files`;
  const files = await get(base, { signal });
  const pictures = files.map((f) => f.name).filter((name) => name.endsWith(".png"));
  const order = Object.keys(MEANING);
  pictures.sort((a, b) => (order.indexOf(a) + 1 || 99) - (order.indexOf(b) + 1 || 99));
  const image = h("img", { id: "result-picture", alt: "", hidden: true });
  const well = h("div", { class: "well" }, image);
  const meaning = h("p", { class: "soft" });
  let shown = pictures[0];
  async function change(name) {
    shown = name;
    say(meaning, MEANING[name] ?? "");
    try {
      const { blob } = await picture(`${base}/${encodeURIComponent(name)}`, { signal });
      if (shown !== name) return;
      image.alt = MEANING[name] ?? name;
      image.classList.toggle("small", !["bokeh", "brdf", "foil", "calibrate", "map", "render"].includes(job.method) && report.width < 640);
      image.classList.toggle("whole", job.method === "render");
      show(image, blob);
    } catch (problem) {
      if (problem.name !== "AbortError") well.replaceChildren(problemMessage(problem));
    }
  }
  const label = (name) => name.replace(/\.png$/, "").replace(/^\w/, (c) => c.toUpperCase());
  const links = files.map(({ name, bytes: size }) => {
    const link = h("a", { title: bytes(size) }, name);
    makeDownload(link, `${base}/${encodeURIComponent(name)}`, `${forFile(job)}-${name}`, complain);
    return link;
  });
  const merged = job.method === "hdr" ? await hdrView(job.id, signal) : null;
  if (merged) well.replaceChildren(merged.canvas);
  main.append(
    h("div", { class: "head" }, headingOf(job),
      files.some((f) => f.name.endsWith(".exr")) ? h("a", { class: "button primary", id: "to-maps", href: `#/maps/${job.id}` }, "Map viewer") : null,
      job.method === "render" ? h("a", { class: "button", id: "edit-scene", href: `#/render/${job.id}` }, "Edit the scene") : null,
      files.some((f) => RENDERED.includes(f.name)) ? h("a", { class: "button", href: `#/render/${job.id}` }, "Render") : null,
      job.session ? h("a", { class: "button", href: `#/session/${job.session}` }, "Session") : null),
    h("div", { class: "columns result" },
      h("section", { class: "panel", "aria-label": "Picture" },
        h("header", {}, pictures.length > 1 ? segments("Picture", pictures.map((p) => [p, label(p)]), shown, change) : h("h2", {}, "Picture")),
        well, merged?.controls, job.method === "render" ? exposure(job, image, signal) : null, meaning, h("p", { class: "row downloads" }, h("span", { class: "soft" }, "Download"), links)),
      h("div", { class: "stack" },
        panel("Report", null, (REPORTS[job.method] ?? reportOf)(report)),
        job.method === "lut" ? panel("Radial profile", null, await lutCurves(base, report, signal)) : null,
        job.method === "bokeh" && report.slice ? panel("Slice across the lines", null, await slice(base, signal)) : null,
        nextPanel(job))));
  if (merged) say(meaning, "The merged light. The slider chooses which stops fill the screen; values are those of hdr.exr.");
  else if (shown) await change(shown);
}

/** Another reconstruction of the same photographs, by the service. */
export function nextPanel(/** @type {Job} */ job) {
  const kept = (method) => (job.method === method ? { ...job.options } : {});
  if (job.method === "flash") return anew(job, "Again", flashForm(kept("flash"), { described: true }));
  const verbs = { brdf: "In other light", map: "Other edits" };
  if (!["hdr", "lut", "bokeh"].includes(job.method)) {
    const form = operationForm(job.method, kept(job.method), { without: ["scene"] });
    // An edited scene is part of the options, but nothing to type into a field.
    const { scene } = kept(job.method);
    const same = { element: form.element, options: () => ({ ...form.options(), ...(scene && { scene }) }) };
    return anew(job, verbs[job.method] ?? "Again", same, job.method === "render" ? "Render" : undefined);
  }
  const forms = { lut: lutForm(kept("lut"), job.light), bokeh: operationForm("bokeh", kept("bokeh")) };
  const method = select([["lut", "A diffraction table"], ["bokeh", "Lines in an out-of-focus highlight"]], job.method === "bokeh" ? "bokeh" : "lut", { id: "next-method", onchange: paint });
  function paint() {
    for (const [name, form] of Object.entries(forms)) form.element.hidden = name !== method.value;
  }
  paint();
  return asking(job, "From the same photographs", () => [method.value, forms[method.value]], [field("What to make of them", method), forms.lut.element, forms.bokeh.element]);
}

/** The same reconstruction with other options. */
function anew(job, title, form, verb) {
  return asking(job, title, () => [job.method, form], [form.element], verb);
}

/** A panel that asks the service for a reconstruction of the same input. */
function asking(job, title, wanted, content, verb = "Reconstruct") {
  const problems = h("div", { role: "status", "aria-live": "polite" });
  const make = h("button", { type: "button", class: "primary", id: "make-next", onclick: async () => {
    make.disabled = true;
    problems.replaceChildren();
    try {
      const [method, form] = wanted();
      const others = (await form.inputs?.()) ?? {};
      const next = await post(`/operations/${method}`, { session: job.session ?? null, upload: job.upload ?? null, options: form.options(), ...others });
      location.hash = `#/result/${next.id}`;
    } catch (problem) {
      problems.replaceChildren(problemMessage(problem));
      make.disabled = false;
    }
  } }, verb);
  return panel(title, null, h("div", { class: "stack" }, content, problems, h("p", {}, make)));
}

/** Light along the slice. */
async function slice(base, signal) {
  const text = await (await send(`${base}/slice.csv`, { signal })).text();
  const rows = text.trim().split("\n").slice(1).map((line) => line.split(","));
  const known = rows.filter((r) => r[2] !== "").map((r) => ({ at: Number(r[1] === "" ? r[0] : r[1]), light: Number(r[2]) }));
  const [width, height, left, bottom] = [420, 200, 44, 30];
  const reach = known.at(-1)?.at ?? 1;
  const top = Math.max(...known.map((k) => k.light), 1e-30);
  const x = (at) => left + (at / Math.max(reach, 1e-9)) * (width - left - 8);
  const y = (light) => 8 + (1 - Math.max(0, light) / top) * (height - bottom - 8);
  const unit = rows[0]?.[1] === "" ? "pixels" : "µm";
  return h("div", { class: "stack" },
    svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": `Light along the slice, over ${unit}`, class: "chart" },
      [0, 0.5, 1].map((share) => [svg("line", { x1: left, x2: width - 8, y1: y(share * top), y2: y(share * top), class: "grid" }),
        svg("text", { x: left - 6, y: y(share * top) + 4, "text-anchor": "end" }, plain(Number((share * top).toPrecision(2))))]),
      [0, 0.5, 1].map((share) => svg("text", { x: x(share * reach), y: height - 10, "text-anchor": "middle" }, plain(Number((share * reach).toPrecision(3))))),
      svg("path", { d: known.map((k, i) => `${i ? "L" : "M"}${x(k.at).toFixed(1)} ${y(k.light).toFixed(1)}`).join(""), class: "light" })),
    h("p", { class: "soft" }, `Light across the lines, over ${unit}.`));
}

/** A table's report. */
function reportOfTable(report) {
  const { choice, coverage, seconds = {}, warnings = [] } = report;
  const known = (value, digits = 2) => (value === null ? "unknown" : percent(value, digits));
  return h("div", { class: "stack" }, warned(warnings),
    figures([
      ["error at the rim", known(report.error_estimate)],
      ["its part by the zero order", known(report.center_error)],
      ["measured in full", percent(coverage.full, 0)],
    ]),
    facts([
      ["Light", `${report.illuminant}, observer ${report.observer}`],
      ["Photographed at", `${[report.wavelength_nm].flat().join(", ")} nm`],
      ["Half vectors", `±${plain(report.extent)}, ${report.width} × ${report.height}${report.warp > 1 ? `, warped by ${report.warp}` : ""}`],
      ["Zero order", report.center.map((c) => fixed(c, 2)).join(", ") + (report.center_sigma_px === null ? "" : ` ± ${fixed(report.center_sigma_px, 2)} pixels`)],
      ["Error by adding up", known(report.sum_error)],
      ["Error between pixels", known(report.sampling_error)],
      ["Per pixel", plain(report.scale)],
      ["Exponent", plain(report.exponent)],
      ["Method", `${words(choice.method)}${choice.spacing_px === null ? "" : `, ${plain(choice.spacing_px)} pixels apart`}: ${choice.why}`],
      ["Took", seconds.total && duration(seconds.total)],
    ]),
    h("details", {}, h("summary", {}, "Taken for granted"), h("ul", {}, (report.assumptions ?? []).map((a) => h("li", { class: "soft" }, a)))));
}

/** A bokeh photograph's report. */
function reportOfBokeh(report) {
  const { deconvolution, scale, cutoff, lines, slits, heights, seconds = {}, warnings = [] } = report;
  const pair = ([value, sigma], unit) => `${fixed(value, 3)} ± ${fixed(sigma, 3)} ${unit}`;
  const why = !deconvolution.auto ? "as asked for" : deconvolution.converged ? "stopped before the noise" : "the most allowed";
  return h("div", { class: "stack" }, warned(warnings),
    figures([
      ["lines along the slice", lines ? fixed(lines.count, 1) : "none found"],
      ["from line to line", lines ? (lines.period_um ? `${fixed(lines.period_um, 2)} µm` : `${fixed(lines.period_px[0], 2)} pixels`) : "unknown"],
      ["finest the lens can show", cutoff ? `${fixed(cutoff.period_um, 1)} µm` : "lens not told"],
    ]),
    facts([
      ["Blur", report.psf],
      ["Iterations", `${deconvolution.iterations}, ${why}`],
      ["Period", lines && pair(lines.period_px, "pixels")],
      ["Slits", slits && `${slits.count}, ${pair(slits.width_px, "pixels")} wide, ${pair(slits.spacing_px, "pixels")} apart`],
      ["Pixel", scale.pixel_um === null ? "size not known" : `${plain(scale.pixel_um)} µm (${words(scale.source)})`],
      ["Heights", heights.calibration ? `${plain(heights.calibration.gain_um)} µm · (light ÷ mean − ${fixed(heights.calibration.offset, 3)})` : heights.unit],
      ["Light", words(report.channel)],
      ["Size", `${report.width} × ${report.height}${report.rotate_deg ? `, turned by ${plain(report.rotate_deg)}°` : ""}`],
      ["Took", seconds.total && duration(seconds.total)],
    ]));
}

/** A BRDF map's report. */
function reportOfBrdf(report) {
  const { quality, settings, choice, albedo, warnings = [] } = report;
  const [first] = quality.periods;
  return h("div", { class: "stack" }, warned(warnings),
    figures([
      ["error at most", percent(report.error_estimate, 2)],
      ["strongest period", first ? `${fixed(first.period_um, 2)} µm` : "none"],
      ["depth", `${significant(quality.range_um)} µm`],
    ]),
    facts([
      ["Method", `${words(choice.method)}, ${choice.bits} bits${choice.terms === null ? "" : `, ${choice.terms} terms`}: ${choice.why}`],
      ["Measured error", choice.measured_error === null ? "not measured" : percent(choice.measured_error, 4)],
      ["Periods", quality.periods.slice(0, 3).map((p) => `${fixed(p.period_um, 3)} ± ${fixed(p.resolution_um, 3)} µm towards ${fixed(p.direction_deg, 1)}° (${percent(p.share, 0)} of the variance)`).join("; ")],
      ["Light", `${settings.illuminant}, ${plain(settings.light_deg[0])}° from the normal, azimuth ${plain(settings.light_deg[1])}°`],
      ["Reflected", `X ${fixed(albedo[0], 3)}, Y ${fixed(albedo[1], 3)}, Z ${fixed(albedo[2], 3)} of what falls in`],
      ["Reflects", settings.reflectance],
      ["Height field", `${quality.width} × ${quality.height} pixels of ${significant(quality.pixel_um)} µm`],
      ["Took", report.seconds && duration(report.seconds)],
    ]));
}

/** Warnings, the figures that count, and the rest as facts. */
function reportOf(report) {
  const { samples, seconds = {}, registration, frames = [], warnings = [] } = report;
  const share = (n) => percent(n / samples.all, 2);
  const shifted = registration?.corrected && "Moved back onto each other";
  return h("div", { class: "stack" }, warned(warnings),
    figures([
      ["measured range", report.dynamic_range === null ? "none" : `${fixed(Math.log2(report.dynamic_range), 1)} stops`],
      ["saturated in all", share(samples.saturated)],
      ["dark in all", share(samples.dark)],
      ["σ of a typical value", report.error_estimate === null ? "unknown" : percent(report.error_estimate, 2)],
    ]),
    facts([
      ["Response", `${words(report.response)}${report.response_sigma === null ? "" : `, known to ${percent(report.response_sigma, 2)}`}`],
      ["Range", report.dynamic_range === null ? null : `${significant(report.dynamic_range)} : 1`],
      ["Exposures", `${frames.length}, over ${fixed(Math.log2(Math.max(...frames.map((f) => f.exposure)) / Math.min(...frames.map((f) => f.exposure))), 1)} stops`],
      ["Exposures agree", report.chi2 === null ? "nothing was measured twice" : `reduced χ² ${fixed(report.chi2, 2)}`],
      ["Noise", words(report.noise)],
      ["Shifts", shifted || registration?.doubt],
      ["Times", frames.map((f) => duration(f.exposure)).join(", ")],
      ["Size", `${report.width} × ${report.height}, ${report.channels.join(" ")}`],
      ["Took", seconds.total && duration(seconds.total)],
    ]));
}
