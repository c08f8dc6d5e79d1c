// Results that are pictures rather than maps of orientations: merged exposures, lookup tables, bokeh photographs.

import { get, makeDownload, picture, post, show } from "./api.js";
import { facts, figures, h, panel, say, segments } from "./dom.js";
import { complain, problemMessage, tell } from "./feedback.js";
import { bytes, duration, percent, significant } from "./format.js";
import { tableFields } from "./tableform.js";

const TITLES = { hdr: "Merged exposures", lut: "Lookup table", bokeh: "Bokeh photograph" };
const MEANING = {
  "hdr.png": "The merged light, tone-mapped for the eye: measure on hdr.exr. White where every exposure is saturated.",
  "lut.png": "The table under the chosen light, over the half vector from -1 to 1, y up; grey where nothing was measured.",
  "coverage.png": "How much of each entry was measured: the rest lies outside the photograph, or is saturated there.",
  "profile.png": "Along the radius: the table's mean over all directions, and its coverage.",
  "height.png": "Dark is deep: the height under the light, for the eye.",
  "deconvolved.png": "The photograph with the lens' blur taken out.",
};

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
      show(image, blob);
    } catch (problem) {
      if (problem.name !== "AbortError") well.replaceChildren(problemMessage(problem));
    }
  }
  const label = (name) => name.replace(/\.png$/, "").replace(/^\w/, (c) => c.toUpperCase());
  const links = files.map(({ name, bytes: size }) => {
    const link = h("a", { title: bytes(size) }, name);
    makeDownload(link, `${base}/${encodeURIComponent(name)}`, `${job.id}-${name}`, complain);
    return link;
  });
  main.append(
    h("div", { class: "head" }, h("h1", { class: "grow" }, TITLES[job.method] ?? "Result"),
      job.session ? h("a", { class: "button", href: `#/session/${job.session}` }, "Session") : null,
      job.reconstruction ? h("a", { class: "button", href: `#/result/${job.reconstruction}` }, "Photograph") : null),
    h("div", { class: "columns result" },
      h("section", { class: "panel", "aria-label": "Picture" },
        h("header", {}, pictures.length > 1 ? segments("Picture", pictures.map((p) => [p, label(p)]), shown, change) : h("h2", {}, "Picture")),
        well, meaning, h("p", { class: "row downloads" }, h("span", { class: "soft" }, "Download"), links)),
      h("div", { class: "stack" },
        panel("Report", null, reportOf(job.method, report)),
        next(job))));
  if (shown) await change(shown);
}

/** What can be made of it: a table of a merged photograph, or another table of the same photograph. */
function next(job) {
  if (job.method !== "hdr" && job.method !== "lut") return null;
  const fields = tableFields(job.method === "lut" ? job.options ?? {} : {});
  const source = job.method === "hdr" ? { reconstruction: job.id } : { reconstruction: job.reconstruction, upload: job.upload, file: job.file };
  const start = h("button", { type: "button", class: "primary", id: "make-table", onclick: async () => {
    try {
      const made = await post("/reconstructions", { method: "lut", ...source, options: fields.options() });
      tell("Computing the table.");
      location.hash = `#/result/${made.id}`;
    } catch (problem) {
      complain(problem);
    }
  } }, job.method === "hdr" ? "Make a lookup table" : "Compute again");
  return panel(job.method === "hdr" ? "Lookup table" : "Light and options", null, fields.element, h("div", { class: "row end" }, start));
}

const rel = (v) => (v === null || v === undefined ? null : percent(v, 2));

function reportOf(method, report) {
  const warnings = report.warnings ?? [];
  const { samples, seconds = {} } = report;
  const large = {
    hdr: [["σ of a typical value", rel(report.error_estimate) ?? "unknown"], ["measured range", report.dynamic_range ? `${significant(report.dynamic_range, 3)} : 1` : "none"], ["exposures", String(report.frames?.length ?? "")]],
  }[method] ?? [["expected error", rel(report.error_estimate) ?? "unknown"]];
  const flat = Object.entries(report).filter(([key, value]) => !["warnings", "method"].includes(key) && (typeof value !== "object" || value === null));
  const text = (value) => (typeof value === "number" ? significant(value, 4) : String(value));
  return h("div", { class: "stack" },
    warnings.length
      ? h("ul", { class: "problems" }, warnings.map((w) => h("li", { class: "message", "data-tone": "warn" }, w)))
      : h("p", { class: "message", "data-tone": "good" }, "No warnings."),
    figures(large),
    facts([
      ...flat.filter(([, value]) => value !== null).map(([key, value]) => [key.replaceAll("_", " ").replace(/^\w/, (c) => c.toUpperCase()), text(value)]),
      ["Saturated everywhere", samples && percent(samples.saturated / samples.all, 2)],
      ["Dark everywhere", samples && percent(samples.dark / samples.all, 2)],
      ["Took", seconds.total && duration(seconds.total)],
    ]));
}
