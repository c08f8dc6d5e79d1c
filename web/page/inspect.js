// #/inspect/ID: compares results of samples with that of a reference. ID is a sample, or an inspection to repeat.

import { get, post, query } from "./api.js";
import { field, h, panel, say, segments, select } from "./dom.js";
import { problemMessage } from "./feedback.js";
import { INSPECTED, viewable } from "./finding.js";
import { limitsForm } from "./limitsform.js";
import { operationForm } from "./operationform.js";

/** Smallest number of good samples from which limits follow. */
const LEAST = 3;
const MODES = [["inspect", "Inspect"], ["train", "Train limits"]];
/** Inspections that are searched for limits. */
const MOST = 500;

/**
 * Shows the form until the signal fires.
 * @param {HTMLElement} main
 * @param {Visit} visit
 */
export async function inspectPage(main, { id, signal }) {
  /** @type {[Job | null, { id: string, title: string, about: string }[], { items: Job[] }]} */
  const [given, results, jobs] = await Promise.all([
    id ? get(`/reconstructions/${id}`, { signal }) : null, viewable(signal, INSPECTED), get(`/reconstructions${query({ limit: MOST })}`, { signal })]);
  if (signal.aborted) return;
  const again = given?.method === "inspect" ? given : null;
  const trained = jobs.items.filter((job) => job.method === "inspect" && job.state === "done" && job.options?.train);
  const picked = new Set(again ? again.results?.map((result) => result.id) : id ? [id] : []);
  const before = again?.named?.find((result) => again.options.reference === `result:${result.id}`)?.id ?? "";
  let mode = again?.options.train ? "train" : "inspect";

  const reference = select([["", "Choose a result"], ...results.map((r) => [r.id, `${r.title} · ${r.about}`])], before, { id: "reference", onchange: judge });
  const search = h("input", { type: "search", id: "sample-search", placeholder: "Name or method", oninput: paint });
  const boxes = results.map((result) => {
    const box = h("input", { type: "checkbox", value: result.id, checked: picked.has(result.id), onchange: judge });
    return { result, box, element: h("li", {}, h("label", { class: "check" }, box, h("span", {}, result.title, " ", h("span", { class: "soft" }, result.about)))) };
  });
  const shown = () => boxes.filter(({ element }) => !element.hidden);
  const all = h("button", { type: "button", onclick: () => { for (const { box } of shown()) box.checked = true; judge(); } }, "Select all shown");
  const none = h("button", { type: "button", onclick: () => { for (const { box } of boxes) box.checked = false; judge(); } }, "Select none");
  const list = h("ul", { class: "choices scroll tall", id: "samples" }, boxes.map(({ element }) => element));
  const options = operationForm("inspect", again?.options ?? {}, { without: ["reference", "limits", "train"] });
  const limits = limitsForm(trained, again?.options.limits ?? "");
  const said = h("p", { class: "soft", role: "status", "aria-live": "polite" });
  const problems = h("div", { role: "status", "aria-live": "polite" });
  const start = h("button", { type: "button", class: "primary", id: "inspect-start", onclick: begin }, "Inspect");
  const choice = segments("Purpose", MODES, mode, (key) => {
    mode = key;
    judge();
  });
  const empty = h("p", {}, "No result holds orientations yet. Capture a session, or upload photographs.");
  main.append(h("div", { class: "head" }, h("h1", { class: "grow" }, "Inspect sheets"), start),
    h("div", { class: "columns planning" },
      panel("Samples", h("div", { class: "row" }, all, none), results.length ? h("div", { class: "stack" }, field("Search", search), list) : empty),
      h("div", { class: "stack" },
        panel("Reference", null, field("Good sheet to compare with", reference)),
        panel("Inspection", null, h("div", { class: "stack" }, choice, said, options.element, limits.element, problems)))));
  judge();

  function paint() {
    const wanted = search.value.trim().toLowerCase();
    for (const { result, element } of boxes) element.hidden = !`${result.title} ${result.about}`.toLowerCase().includes(wanted);
  }

  /** Samples in the order of the list, without the reference itself. */
  function samples() {
    return boxes.filter(({ box }) => box.checked && box.value !== reference.value).map(({ box }) => box.value);
  }

  function judge() {
    const count = samples().length;
    limits.element.hidden = mode === "train";
    say(start, mode === "train" ? "Train limits" : "Inspect");
    const missing = !reference.value ? "Choose a reference." : mode === "train" && count < LEAST ? `Choose at least ${LEAST} good samples.` : count === 0 ? "Choose a sample." : "";
    const counted = count === 1 ? "1 sample" : `${count} samples`;
    say(said, missing || (mode === "train" ? `${counted}, all of them good: limits will allow their differences.` : `${counted} to be compared with the reference.`));
    start.disabled = missing !== "";
  }

  async function begin() {
    start.disabled = true;
    problems.replaceChildren();
    try {
      const given = mode === "train" ? { limits: undefined, upload: null } : await limits.option(signal);
      const order = { ...options.options(), reference: `result:${reference.value}`, ...(given.limits && { limits: given.limits }), ...(mode === "train" && { train: true }) };
      /** @type {Job} */
      const job = await post("/operations/inspect", { results: samples(), upload: given.upload, options: order });
      location.hash = `#/result/${job.id}`;
    } catch (problem) {
      if (problem.name === "AbortError") return;
      problems.replaceChildren(problemMessage(problem));
      judge();
    }
  }
}
