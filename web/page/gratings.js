// Results with a grating in every pixel, from fringes or from flash photographs: maps, shares of pixels, residuals, lights.

import { get, makeDownload } from "./api.js";
import { warned } from "./assetreports.js";
import { facts, figures, h, panel, say, svg } from "./dom.js";
import { complain } from "./feedback.js";
import { count, duration, fixed, percent, plain } from "./format.js";
import { forFile, headingOf } from "./naming.js";
import { nextPanel } from "./pictures.js";

const FORMATS = [["exr", "EXR"], ["png", "PNG"], ["csv", "CSV"], ["npy", "NumPy"]];
/** Maps in the order in which they are wanted. */
const ORDER = { spots: ["period", "orientation", "period_sigma", "sigma"], flash: ["orientation", "period", "sigma", "period_sigma"] };
const MEANING = {
  period: "Period of the grating. Masked: no order in reach, light of no single grating, or two gratings that explain it.",
  orientation: "Direction of the grating vector, across the grooves, anticlockwise from image right.",
  sigma: "Standard deviation of the orientation.",
  period_sigma: "Standard deviation of the period, including the error common to all periods.",
};
/** Most residuals that are listed. */
const LISTED = 5;
/** Classes of pixels, with the colour of their part of the bar. */
const CLASSES = {
  spots: [["resolved", "resolved", "#1b7f79"], ["no_order", "no order in reach", "#8aa0a8"], ["ambiguous", "two gratings explain it", "#e0a100"], ["unexplained", "no single grating", "#c8553d"], ["dark", "dark", "#4b5358"], ["unusable", "saturated", "#b03a8c"]],
  flash: [["known", "with a grating", "#1b7f79"], ["ambiguous", "ambiguous", "#e0a100"], ["several", "several gratings", "#c8553d"], ["uncertain", "too few copies lit", "#8c6bb1"], ["unexplained", "no grating fits", "#b03a8c"], ["dark", "dark", "#4b5358"], ["unseen", "in no photograph", "#8aa0a8"]],
};

/**
 * Shows the result until the signal fires.
 * @param {HTMLElement} main
 * @param {Job} job
 * @param {AbortSignal} signal
 */
export async function showGratings(main, job, signal) {
  const { report } = job;
  const base = `/reconstructions/${job.id}`;
  const { mapViewer, mapsOf } = await import("./mapviewer.js");
  const first = ORDER[job.method];
  const all = await mapsOf(job.id, first, signal);
  if (signal.aborted) return;
  const maps = all.filter((m) => m.kind !== "mask");
  const meaning = h("p", { class: "soft" });
  const links = FORMATS.map(([ending, label]) => h("a", { class: "button", "data-download": ending }, label));
  const shown = (/** @type {MapInfo} */ { name }) => {
    say(meaning, MEANING[name] ?? "");
    for (const link of links) makeDownload(link, `${base}/maps/${encodeURIComponent(name)}.${link.dataset.download}`, `${forFile(job)}-${name}.${link.dataset.download}`, complain);
  };
  const viewer = mapViewer({ id: job.id, method: job.method, maps, first, palette: report.palette ?? "hsv", title: job.name, named: forFile(job), shown, signal,
    pick: (x, y) => viewer.mark(x, y, null),
    under: h("div", { class: "under" }, h("div", { class: "stack" }, meaning, h("div", { class: "row" }, h("span", { class: "soft" }, "Download this map"), links))) });
  const files = await get(`${base}/files`, { signal });
  const data = files.filter((f) => !f.name.endsWith(".png")).map(({ name }) => {
    const link = h("a", {}, name);
    makeDownload(link, `${base}/files/${encodeURIComponent(name)}`, `${forFile(job)}-${name}`, complain);
    return link;
  });
  main.append(
    h("div", { class: "head" }, headingOf(job),
      h("a", { class: "button", href: `#/render/${job.id}` }, "Render"),
      job.session ? h("a", { class: "button", href: `#/session/${job.session}` }, "Session") : null),
    h("div", { class: "columns result" },
      h("div", { class: "stack" }, viewer.element, h("details", { id: "again" }, h("summary", {}, "Again with other options"), nextPanel(job))),
      h("div", { class: "stack" }, viewer.aside,
        panel("Report", null, (job.method === "spots" ? reportOfSpots : reportOfFlash)(report)),
        panel("Pixels", null, shares(job)),
        job.method === "flash" ? panel("Directions of the flash", null, directions(report)) : null,
        report.worst?.length ? panel("Largest residuals", null, residuals(report, (x, y) => viewer.mark(x, y, null))) : null,
        panel("Files", null, h("p", { class: "row downloads" }, data)))));
}

/** Shares of the pixels by class, as a bar with its legend. */
function shares(/** @type {Job} */ { method, report }) {
  const total = report.width * report.height;
  const share = (key) => (method === "spots" ? report.pixels[key] / total : key === "known" ? 1 - report.masked.all : report.masked[key]);
  const classes = CLASSES[method].map(([key, label, color]) => ({ label, color, share: share(key) })).filter((c) => c.share > 0);
  let from = 0;
  const parts = classes.map(({ color, label, share: part }) => {
    const rect = svg("rect", { x: 400 * from, y: 0, width: 400 * part, height: 18, fill: color }, svg("title", {}, `${label}: ${percent(part, 1)}`));
    from += part;
    return rect;
  });
  return h("div", { class: "stack", id: "pixel-shares" },
    svg("svg", { viewBox: "0 0 400 18", preserveAspectRatio: "none", class: "shares", role: "img", "aria-label": classes.map((c) => `${c.label} ${percent(c.share, 1)}`).join(", ") }, ...parts),
    h("ul", { class: "share-list" }, classes.map((c) => h("li", {}, h("span", { class: "swatch", style: `background:${c.color}` }), h("span", { class: "grow" }, c.label), percent(c.share, 1)))));
}

/** Pixels with the largest residuals; each button marks its pixel on the map. */
function residuals({ worst, residual }, mark) {
  return h("div", { class: "stack", id: "worst-residuals" },
    h("p", { class: "soft" }, `Reduced χ² of resolved pixels: the median is ${fixed(residual, 2)}, noise alone gives 1. Pixels above 2 are masked, as no single grating explains them.`),
    h("ol", { class: "share-list" }, worst.slice(0, LISTED).map((p) => h("li", {}, h("button", { type: "button", class: "quiet grow", onclick: () => mark(p.x, p.y) }, `x ${p.x}, y ${p.y}`), fixed(p.residual, 2)))));
}

/** Where the flash stood over the sheet, seen from above. */
function directions({ lights_mm: lights, highlights = [] }) {
  const reach = Math.max(1, ...lights.map(([x, y]) => Math.hypot(x, y))) * 1.2;
  const at = (mm) => 100 + (90 * mm) / reach;
  const degrees = ([x, y, z]) => [Math.hypot(x, y) < 1e-6 ? "any" : `${fixed((Math.atan2(y, x) * 180) / Math.PI, 0)}°`, `${fixed((Math.atan2(Math.hypot(x, y), z) * 180) / Math.PI, 0)}°`];
  return h("div", { class: "stack", id: "flash-directions" },
    svg("svg", { viewBox: "0 0 200 200", class: "flashes", role: "img", "aria-label": `${lights.length} positions of the flash, seen from above the sheet` },
      svg("rect", { x: 85, y: 88, width: 30, height: 24, class: "sheet" }),
      ...lights.map(([x, y], k) => svg("g", {}, svg("path", { d: `M100 100L${at(x)} ${200 - at(y)}` }), svg("circle", { cx: at(x), cy: 200 - at(y), r: 5 }), svg("text", { x: at(x) + 7, y: 200 - at(y) - 6 }, String(k + 1))))),
    h("div", { class: "scroll" }, h("table", {},
      h("thead", {}, h("tr", {}, ["Flash", "x, y, z (mm)", "Azimuth", "From the normal", "Highlight"].map((t) => h("th", { scope: "col" }, t)))),
      h("tbody", {}, lights.map((light, k) => h("tr", {}, h("td", {}, String(k + 1)), h("td", {}, light.map((v) => fixed(v, 0)).join(", ")),
        degrees(light).map((d) => h("td", {}, d)), h("td", {}, highlights[k] ? "in view" : "not in view")))))));
}

const assumed = (report) => h("details", {}, h("summary", {}, "Taken for granted"), h("ul", {}, (report.assumptions ?? []).map((a) => h("li", { class: "soft" }, a))));

/** A report about fringes. */
function reportOfSpots(report) {
  const { pixels, seconds = {}, warnings = [], mirror_offset_deg: mirror, discs } = report;
  const percents = (value) => (value === null ? "unknown" : percent(value, 2));
  return h("div", { class: "stack" }, warned(warnings),
    figures([
      ["of the pixels resolved", percent(pixels.resolved / (report.width * report.height), 1)],
      ["σ of the period", percents(report.period_sigma)],
      ["σ of the orientation", report.orientation_sigma_deg === null ? "unknown" : `${fixed(report.orientation_sigma_deg, 2)}°`],
    ]),
    facts([
      ["Patterns", `${report.patterns}, of which ${report.fringes} different fringes`],
      ["Wavelength", `${plain(report.wavelength_nm)} nm`],
      ["Shared by all periods", percents(report.period_scale_sigma)],
      ["Shortest in reach", reach(report.shortest_um)],
      ["Discs", discs && `${discs.discs}: decided ${count(discs.decided)} pixels, contradicted ${count(discs.contradicted)}`],
      ["Mirror direction", mirror && `${fixed(mirror[0], 3)}°, ${fixed(mirror[1], 3)}° from the geometry`],
      ["Aperture", `${fixed(report.aperture_mm, 1)} mm`],
      ["Took", seconds.total && duration(seconds.total)],
    ]), assumed(report));
}

/** Range over directions of the shortest periods in reach. */
export function reach(/** @type {(number | null)[] | null | undefined} */ shortest) {
  const known = /** @type {number[]} */ ((shortest ?? []).filter((um) => um !== null));
  if (!known.length) return shortest ? "none" : null;
  const [least, most] = [Math.min(...known), Math.max(...known)].map((um) => fixed(um, 2));
  return `${least === most ? least : `${least} to ${most}`} µm, by direction${known.length < (shortest ?? []).length ? "; in some directions none" : ""}`;
}

/** The report of tiles under a flash. */
function reportOfFlash(report) {
  const { period, masked, directions: shared, seconds = {}, warnings = [] } = report;
  return h("div", { class: "stack" }, warned(warnings),
    figures([
      ["σ of an orientation", report.sigma_deg === null ? "unknown" : `${fixed(report.sigma_deg, 2)}°`],
      period.um === null ? ["median of the periods", period.median_um === null ? "unknown" : `${fixed(period.median_um, 3)} µm`]
        : ["period", `${fixed(period.um, 3)} ± ${fixed(period.sigma_um ?? 0, 3)} µm`],
      ["of the pixels known", percent(1 - masked.all, 1)],
    ]),
    facts([
      ["Tiles", `${report.tiles}, moved by up to ${fixed(report.registration?.most_px ?? 0, 2)} pixels`],
      ["Wavelength", `${plain(report.wavelength_nm)} nm`],
      ["Periods", period.why],
      ["σ of a period", report.period_sigma === null ? "unknown" : percent(report.period_sigma, 2)],
      ["Directions", shared?.why],
      ["Periods searched", report.searched_um && `${report.searched_um.map((v) => fixed(v, 2)).join(" to ")} µm`],
      ["Periods are", report.relative ? "relative" : "absolute"],
      ["Took", seconds.total && duration(seconds.total)],
    ]), assumed(report));
}
