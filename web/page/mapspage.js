// #/maps/ID: all maps of a result in the viewer, whatever method made them.

import { get, makeDownload } from "./api.js";
import { h, panel } from "./dom.js";
import { complain } from "./feedback.js";
import { mapViewer, mapsOf } from "./mapviewer.js";
import { forFile } from "./naming.js";

/** Maps that come first, where a result has them. */
const FIRST = ["orientation", "period", "height", "hdr.Y", "sigma", "period_sigma"];
const FORMATS = [["exr", "EXR"], ["png", "PNG"], ["csv", "CSV"], ["npy", "NumPy"]];

/**
 * Shows the maps until the signal fires.
 * @param {HTMLElement} main
 * @param {Visit} visit
 */
export async function mapsPage(main, { id, signal }) {
  /** @type {[Job, MapInfo[]]} */
  const [job, maps] = await Promise.all([get(`/reconstructions/${id}`, { signal }), mapsOf(id, FIRST, signal)]);
  if (signal.aborted) return;
  const back = h("a", { class: "button", href: `#/result/${id}` }, "Result");
  main.append(h("div", { class: "head" }, h("h1", { class: "grow" }, `${job.name}, maps`), back));
  if (!maps.length) return main.append(panel("Maps", null, h("p", {}, "This result has no maps.")));
  const links = FORMATS.map(([ending, label]) => h("a", { class: "button", "data-download": ending }, label));
  const shown = (/** @type {MapInfo} */ { name }) => {
    for (const link of links) makeDownload(link, `/reconstructions/${id}/maps/${encodeURIComponent(name)}.${link.dataset.download}`, `${forFile(job)}-${name}.${link.dataset.download}`, complain);
  };
  const viewer = mapViewer({ id, method: job.method, maps, first: FIRST, palette: job.report?.palette ?? "cyclic", title: job.name, named: forFile(job), shown, signal,
    pick: (x, y) => viewer.mark(x, y, null), under: h("div", { class: "row" }, h("span", { class: "soft" }, "Download this map"), links) });
  main.append(h("div", { class: "columns result" }, viewer.element, h("div", { class: "stack" }, viewer.aside)));
}
