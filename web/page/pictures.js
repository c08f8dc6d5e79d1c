// Results that are pictures rather than maps of orientations: merged exposures.

import { get, makeDownload, picture, show } from "./api.js";
import { facts, figures, h, panel, say, segments } from "./dom.js";
import { complain, problemMessage } from "./feedback.js";
import { bytes, duration, fixed, percent, significant, words } from "./format.js";

const TITLES = { hdr: "Merged exposures" };
const MEANING = {
  "hdr.png": "The merged light, tone-mapped for the eye: measure on hdr.exr. White where every exposure is saturated.",
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
      image.classList.toggle("small", report.width < 640);
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
      job.session ? h("a", { class: "button", href: `#/session/${job.session}` }, "Session") : null),
    h("div", { class: "columns result" },
      h("section", { class: "panel", "aria-label": "Picture" },
        h("header", {}, pictures.length > 1 ? segments("Picture", pictures.map((p) => [p, label(p)]), shown, change) : h("h2", {}, "Picture")),
        well, meaning, h("p", { class: "row downloads" }, h("span", { class: "soft" }, "Download"), links)),
      panel("Report", null, reportOf(report))));
  if (shown) await change(shown);
}

/** Warnings, the figures that count, and the rest as facts. */
function reportOf(report) {
  const { samples, seconds = {}, registration, frames = [], warnings = [] } = report;
  const share = (n) => percent(n / samples.all, 2);
  const shifted = registration?.corrected && "Moved back onto each other";
  return h("div", { class: "stack" },
    warnings.length
      ? h("ul", { class: "problems" }, warnings.map((w) => h("li", { class: "message", "data-tone": "warn" }, w)))
      : h("p", { class: "message", "data-tone": "good" }, "No warnings."),
    figures([
      ["σ of a typical value", report.error_estimate === null ? "unknown" : percent(report.error_estimate, 2)],
      ["measured range", report.dynamic_range === null ? "none" : `${significant(report.dynamic_range)} : 1`],
      ["exposures", String(frames.length)],
    ]),
    facts([
      ["Response", `${words(report.response)}${report.response_sigma === null ? "" : `, known to ${percent(report.response_sigma, 2)}`}`],
      ["Saturated in all", share(samples.saturated)],
      ["Dark in all", share(samples.dark)],
      ["Exposures agree", report.chi2 === null ? "nothing was measured twice" : `reduced χ² ${fixed(report.chi2, 2)}`],
      ["Noise", words(report.noise)],
      ["Shifts", shifted || registration?.doubt],
      ["Times", frames.map((f) => duration(f.exposure)).join(", ")],
      ["Size", `${report.width} × ${report.height}, ${report.channels.join(" ")}`],
      ["Took", seconds.total && duration(seconds.total)],
    ]));
}
