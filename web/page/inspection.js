// #/result/ID of an inspection: verdict, pictures with defects, their table, downloads; of a folder, its summary.

import { makeDownload, get } from "./api.js";
import { warned } from "./assetreports.js";
import { defectTable } from "./defecttable.js";
import { facts, h, panel } from "./dom.js";
import { complain } from "./feedback.js";
import { degrees, fixed, moment, percent, plain, words } from "./format.js";
import { forFile, headingOf } from "./naming.js";
import { sheetPictures } from "./sheetpictures.js";

const OTHERS = [["reference.png", "Reference"], ["deviation.png", "Deviation"], ["brightness.png", "Brightness"]];
const CLASSES = ["missing", "wrong_orientation", "wrong_period", "scratch", "dirt"];
const WORD = { accept: "Accept", reject: "Reject" };

/**
 * Shows a finished inspection.
 * @param {HTMLElement} main
 * @param {Job} job
 * @param {AbortSignal} signal
 */
export async function showInspection(main, job, signal) {
  /** @type {InspectionReport} */
  const report = job.report;
  const base = `/reconstructions/${job.id}`;
  /** @type {{ name: string }[]} */
  const files = await get(`${base}/files`, { signal });
  if (signal.aborted) return;
  const names = new Set(files.map((file) => file.name));
  main.append(h("div", { class: "head" }, headingOf(job),
    names.has("difference.exr") ? h("a", { class: "button", href: `#/maps/${job.id}` }, "Maps of differences") : null,
    h("a", { class: "button", id: "inspect-again", href: `#/inspect/${job.id}` }, "Inspect again")));
  const detail = h("div", { class: "stack", id: "sheet" });
  const show = (/** @type {SheetReport} */ sheet, folder) => {
    detail.replaceChildren(...sheetPanels({ job, report, sheet, folder, names, signal }));
  };
  if (report.trained) return main.append(h("div", { class: "stack" }, trainedPanel(job, report, names), panel("Good samples", null, batchTable(report, null))));
  const batch = !names.has("sample.png");
  main.append(h("div", { class: "stack" }, batch ? batchPanel(job, report, names, (sheet) => show(sheet, `${sheet.sample.name}/`)) : null, detail));
  const worst = report.sheets.find((sheet) => sheet.verdict === "reject") ?? report.sheets[0];
  show(worst, batch ? `${worst.sample.name}/` : "");
}

function download(job, names, file, label) {
  if (!names.has(file)) return null;
  const link = h("a", { class: "button", "data-download": file.split("/").pop() }, label);
  makeDownload(link, `/reconstructions/${job.id}/files/${encodeURIComponent(file)}`, `${forFile(job)}-${file.replace("/", "-")}`, complain);
  return link;
}

/** Verdict, pictures and defects of one sheet. */
function sheetPanels({ job, report, sheet, folder, names, signal }) {
  const choose = (k) => {
    const next = pictures.marked === k ? -1 : k;
    pictures.mark(next);
    table.mark(next);
  };
  const there = /** @type {[string, string][]} */ (OTHERS.filter(([file]) => names.has(folder + file)));
  const pictures = sheetPictures({ base: `/reconstructions/${job.id}`, folder, sheet, others: there, pick: choose, signal });
  const table = defectTable(sheet, choose);
  const links = [["report.pdf", "PDF"], ["report.html", "HTML"], ["defects.csv", "CSV"]].map(([file, label]) => download(job, names, folder + file, label));
  const json = download(job, names, "report.json", "JSON");
  return [
    panel(sheet.sample.name, h("div", { class: "row downloads" }, links, json), h("div", { class: "stack" },
      h("p", { class: "inspected", "data-verdict": sheet.verdict }, WORD[sheet.verdict]),
      sheet.exceeded.length ? h("ul", { class: "reasons" }, sheet.exceeded.map((reason) => h("li", {}, reason))) : h("p", {}, "No limit is exceeded."),
      sheet.warnings.length ? warned(sheet.warnings) : null)),
    panel("Pictures", null, pictures.element),
    panel(`Defects (${sheet.defects.length})`, null, h("div", { class: "stack" }, table.element,
      h("p", { class: "soft" }, `Positions are right of and above the middle of the reference. Polarization, brightness and period are relative to the reference. Smallest deviation ${fixed(sheet.threshold, 2)} σ.`))),
    h("div", { class: "columns pair" }, panel("Registration and differences", null, measured(report, sheet)), panel("Inputs", null, h("div", { class: "stack" }, inputs("Reference", report.reference, job.named?.[0]), inputs("Sample", sheet.sample, sampleOf(job, report, sheet))))),
  ];
}

/** The result that a sheet was: results have the order of the names of their folders only where there is one. */
const sampleOf = (/** @type {Job} */ job, /** @type {InspectionReport} */ report, /** @type {SheetReport} */ sheet) =>
  report.sheets.length === 1 ? job.results?.[0] : job.results?.find(({ name }) => name === sheet.sample.name);

function measured(/** @type {InspectionReport} */ report, /** @type {SheetReport} */ sheet) {
  const { registration: r, differences } = sheet;
  const limits = report.limits.sheet ?? {};
  const shift = r.shift_mm ? `${fixed(r.shift_mm[0], 3)} mm right, ${fixed(r.shift_mm[1], 3)} mm down` : `${fixed(r.shift_px[0], 2)} px right, ${fixed(r.shift_px[1], 2)} px down`;
  const row = (key, unit, digits) => {
    const found = differences[key];
    const limit = limits[`max_${key}`];
    return found && `${fixed(found.rms, digits)}${unit} (RMS), ${percent(found.beyond, 2)} beyond 3 σ${limit ? `, limit ${fixed(limit, digits)}${unit}` : ""}`;
  };
  return facts([
    ["Registration", `${r.kind}, likeness ${percent(r.likeness, 0)}`],
    ["Turned", degrees(r.turn_deg, 3)],
    ["Shifted", `${shift} (σ ${fixed(r.sigma_px, 3)} px)`],
    ["Scale", plain(r.scale)],
    ["Reference seen", percent(r.overlap, 1)],
    ["Common offset", `${degrees(sheet.offset_deg, 2)} ± ${degrees(sheet.offset_sigma_deg, 2)}`],
    ["Orientation", row("orientation_deg", "°", 3)],
    ["Presence", row("presence", "", 4)],
    ["Brightness", row("brightness", "", 4)],
    ["Period", row("period", "", 4)],
    ["Limits", report.limits.samples ? `trained from ${report.limits.samples} good samples` : report.limits_sha256 ? "from a file" : "no defect of any class"],
    ["False alarms", `${plain(report.false_alarms)} per sheet`],
    ["Smallest defect", `${report.min_area_px} pixels`],
  ]);
}

/** @param {SheetOrigin} origin */
function inputs(title, origin, /** @type {UsedResult | undefined} */ result) {
  return h("div", {}, h("h3", {}, `${title}: `, result ? h("a", { href: `#/result/${result.id}` }, origin.name) : origin.name),
    facts([["Captured", origin.captured_s === null ? null : moment(origin.captured_s)], ["Devices", origin.devices.length ? h("ul", {}, origin.devices.map((device) => h("li", {}, device))) : null],
      ...origin.files.map(({ file, sha256 }) => /** @type {[string, Child]} */ ([file, h("code", { class: "hash", title: "SHA-256" }, sha256)]))]));
}

/** All sheets; a click shows one. */
function batchTable(/** @type {InspectionReport} */ report, /** @type {((sheet: SheetReport) => void) | null} */ choose) {
  const count = (sheet, name) => sheet.defects.filter((d) => d.class === name).length || "";
  const rows = report.sheets.map((sheet) => h("tr", { class: choose && "choose", "data-verdict": report.trained ? null : sheet.verdict, onclick: choose && (() => pick(sheet)) },
    h("td", {}, choose ? h("button", { type: "button", class: "quiet", onclick: (e) => { e.stopPropagation(); pick(sheet); } }, sheet.sample.name) : sheet.sample.name),
    report.trained ? null : h("td", {}, h("strong", {}, WORD[sheet.verdict])),
    CLASSES.map((name) => h("td", { class: "number" }, count(sheet, name))),
    h("td", { class: "number" }, `${fixed(sheet.largest_deviation, 1)} σ`),
    report.trained ? null : h("td", {}, sheet.exceeded.join("; "))));
  function pick(sheet) {
    rows.forEach((row, k) => row.classList.toggle("marked", report.sheets[k] === sheet));
    choose?.(sheet);
  }
  const numbers = [...CLASSES.map(words), "Largest deviation"];
  const head = ["Sheet", ...(report.trained ? [] : ["Verdict"]), ...numbers, ...(report.trained ? [] : ["Limits exceeded"])];
  return h("div", { class: "scroll tall" }, h("table", { class: "batch", id: "batch" }, h("thead", {}, h("tr", {}, head.map((title) => h("th", { scope: "col", class: numbers.includes(title) && "number" }, title)))), h("tbody", {}, rows)));
}

function batchPanel(job, report, names, choose) {
  const good = report.sheets.length - report.rejected;
  return panel(`${report.sheets.length} sheets`, h("div", { class: "row downloads" }, download(job, names, "summary.csv", "CSV"), download(job, names, "index.html", "HTML"), download(job, names, "report.json", "JSON")),
    h("div", { class: "stack" }, h("p", { class: "inspected", "data-verdict": report.rejected ? "reject" : "accept" }, `${good} accepted, ${report.rejected} rejected`), batchTable(report, choose)));
}

/** Limits that good samples gave. */
function trainedPanel(job, report, names) {
  const { threshold, samples, sheet } = report.limits;
  return panel("Training", h("div", { class: "row downloads" }, download(job, names, "limits.toml", "limits.toml")),
    h("div", { class: "stack" }, h("p", { class: "inspected" }, `Limits from ${samples} good samples`),
      facts([["Smallest deviation of a defect", `${fixed(threshold, 2)} σ`], ["False alarms", `${plain(report.false_alarms)} per sheet`], ["Orientation", sheet.max_orientation_deg && `${fixed(sheet.max_orientation_deg, 3)}° (RMS)`],
        ["Presence", sheet.max_presence && fixed(sheet.max_presence, 4)], ["Brightness", sheet.max_brightness && fixed(sheet.max_brightness, 4)], ["Period", sheet.max_period && fixed(sheet.max_period, 4)], ["Reference", report.reference.name]]),
      warned(report.warnings),
      h("p", {}, "Choose this result as limits of the next inspection.")));
}
