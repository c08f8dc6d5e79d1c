// #/charts: how fast, how exact, and where it breaks, as `nacre chart` has measured it.

import { get, makeDownload, picture, query, send, show } from "./api.js";
import { field, h, panel, say, select } from "./dom.js";
import { complain, confirmed, problemMessage, tell } from "./feedback.js";
import { bytes } from "./format.js";
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
  const search = h("input", { id: "search", type: "search", placeholder: "Method, knob, scene", oninput: () => filter() });
  const remove = h("button", { type: "button", "aria-label": `Delete the charts in ${chosen.folder}`, onclick: () => erase() }, "Delete");
  const said = h("p", { class: "soft", role: "status" });
  head.append(field("Search", search), remove);
  list.before(said);
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

  /** Shows the charts whose words hold all that are sought. */
  function filter() {
    const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
    const hold = ({ name, group, title, text }) => words.every((word) => `${name} ${group} ${title} ${text}`.toLowerCase().includes(word));
    chosen.charts.forEach((chart, i) => { sections[i].hidden = !hold(chart); });
    const left = sections.filter((s) => !s.hidden).length;
    say(said, left === sections.length ? "" : left ? `${left} of ${sections.length} charts` : "No chart matches.");
  }

  async function erase() {
    const path = `/charts/${encodeURIComponent(chosen.folder)}`;
    try {
      const { token, bytes: size, files } = await get(`${path}/deletion`, { signal });
      if (!(await confirmed(`Delete the charts in “${chosen.folder}”?`, `${files} files, ${bytes(size)}, with the measurements behind them. They are gone for good.`, "Delete"))) return;
      await send(`${path}${query({ token })}`, { method: "DELETE" });
      tell(`The charts in “${chosen.folder}” are deleted.`);
      if (location.hash === "#/charts") dispatchEvent(new HashChangeEvent("hashchange"));
      else location.hash = "#/charts";
    } catch (problem) {
      complain(problem);
    }
  }

  const sections = chosen.charts.map(section);
  list.append(...sections);
}
