// #/charts: how fast, how exact, and where it breaks, as `nacre chart` has measured it.

import { get, makeDownload, picture, show } from "./api.js";
import { field, h, panel, select } from "./dom.js";
import { complain, problemMessage } from "./feedback.js";
import { studyView } from "./study.js";

/**
 * Shows the charts of one folder until the signal fires; `id` is its name.
 * @param {HTMLElement} main
 * @param {Visit} visit
 */
export async function chartsPage(main, { id, signal }) {
  const list = h("div", { class: "charts" });
  const head = h("div", { class: "head" }, h("h1", { class: "grow" }, "Charts"));
  main.append(head, list);
  const { items } = await get("/charts", { signal });
  if (!items.length) {
    list.append(h("section", { class: "panel" }, h("p", {}, "No charts yet. Measure some on the command line, into the service's data folder:"),
      h("p", {}, h("code", {}, "nacre chart all --out DATA/charts/today"))));
    return;
  }
  const chosen = items.find((i) => i.folder === id) ?? items[0];
  if (items.length > 1) {
    const folders = select(items.map((i) => [i.folder, i.folder]), chosen.folder, { onchange: (e) => { location.hash = `#/charts/${encodeURIComponent(e.target.value)}`; } });
    head.append(field("Folder", folders));
  }
  const seen = new IntersectionObserver((entries) => {
    for (const { isIntersecting, target } of entries) {
      if (!isIntersecting) continue;
      seen.unobserve(target);
      load(target);
    }
  }, { rootMargin: "400px" });
  signal.addEventListener("abort", () => seen.disconnect());

  async function load(well) {
    try {
      if (well.dataset.study) well.replaceChildren(studyView(await get(well.dataset.study, { signal })));
      else show(well.querySelector("img"), (await picture(well.dataset.path, { signal })).blob);
    } catch (problem) {
      if (problem.name !== "AbortError") well.replaceChildren(problemMessage(problem));
    }
  }

  function section(chart) {
    const path = (file) => `/charts/${[chosen.folder, ...file.split("/")].map(encodeURIComponent).join("/")}`;
    const image = chart.files.find((f) => f.endsWith(".png"));
    const well = image && h("div", { class: "well", "data-path": path(image) }, h("img", { alt: chart.title, hidden: true }));
    // A study has its numbers beside its picture; what is computed and not measured has a picture alone.
    const numbers = chart.files.find((f) => f.endsWith(".json"));
    const interactive = numbers && h("div", { class: "interactive", "data-study": path(numbers) });
    const drawn = well && interactive ? h("details", {}, h("summary", {}, "Picture, as in the file"), well) : well;
    for (const waits of [interactive, well]) if (waits) seen.observe(waits);
    const links = chart.files.map((file) => {
      const name = file.split("/").pop();
      const link = h("a", {}, name);
      makeDownload(link, path(file), name, complain);
      return link;
    });
    const quick = chart.quick && h("span", { class: "badge", title: "Measured on small scenes; not for conclusions" }, "quick look");
    return panel(chart.title, quick, h("p", { class: "soft" }, chart.text), interactive, drawn, h("p", { class: "row downloads" }, links),
      chart.measured && h("p", { class: "soft" }, h("small", {}, chart.measured)));
  }
  list.append(...chosen.charts.map(section));
}
