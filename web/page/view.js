// #/view/ID?…: a result under a light. What follows the question mark restores a view.

import { get, hasToken, picture, query, send } from "./api.js";
import { field, h, panel, save, select } from "./dom.js";
import { complain, tell } from "./feedback.js";
import { viewable } from "./finding.js";
import { forFile } from "./naming.js";
import { parseView } from "./parsed.js";
import { stateOf, stateText, viewer } from "./viewer.js";

const METALS = ["perfect", "aluminium", "silver", "gold", "copper", "nickel", "chromium", "silicon"];
const PROFILES = ["sinusoid", "blazed", "rectangular"];
const SPECTRA = ["D65", "E", "A", "A-inverse", "LED-B1", "LED-B3", ...Array.from({ length: 12 }, (_, k) => `FL${k + 1}`)];
const LOOK = ["depth_um", "period_um", "profile", "reflectance", "spectrum", "light_sigma_mm", "side_mm"];

/**
 * Shows a result under a light until the signal fires.
 * @param {HTMLElement} main
 * @param {Visit} visit
 */
export async function viewPage(main, { id: given, signal }) {
  const [id, after = ""] = given.split("?");
  const asked = new URLSearchParams(after);
  const look = Object.fromEntries(LOOK.filter((k) => asked.get(k)).map((k) => [k, asked.get(k)]));
  let state = stateOf(after);
  let beside = asked.get("with") ?? "";
  const fetched = async (of = id) => (await send(`/reconstructions/${of}/view${query(look)}`, { signal })).arrayBuffer();
  const [job, first, results] = await Promise.all([get(`/reconstructions/${id}`, { signal }), fetched(), viewable(signal)]);
  const view = parseView(first);
  const [kind] = view.uniforms.what[0];
  const [, , , hasPeriod] = view.uniforms.same[0];

  const link = () => history.replaceState(null, "", `#/view/${id}${query({ ...state, ...look, with: beside })}`);
  let parts;
  const input = (key, value, attributes) => h("input", { type: "number", id: `look-${key}`, value: look[key] ?? value, onchange: (e) => change(key, e.target.value), ...attributes });
  const list = (key, options, value) => select(options.map((o) => [o, o]), look[key] ?? value, { id: `look-${key}`, onchange: (e) => change(key, e.target.value) });
  async function change(key, value) {
    look[key] = value;
    try {
      parts.load(parseView(await fetched()));
      if (beside) await compare(beside);
      link();
    } catch (problem) {
      complain(problem);
    }
  }
  const assumed = panel("Assumed", null, h("div", { class: "fields" },
    kind === 1 && field("Depth (µm)", input("depth_um", 0.1, { min: 0, max: 5, step: 0.01 })),
    kind === 1 && !hasPeriod && field("Period (µm)", input("period_um", 1, { min: 0.05, max: 200, step: 0.05 })),
    kind === 1 && field("Cross-section", list("profile", PROFILES, "sinusoid")),
    kind === 1 && field("Reflectance", list("reflectance", METALS, "aluminium")),
    field("Spectrum of the light", list("spectrum", SPECTRA, "D65")),
    field("Size of the light (σ, mm)", input("light_sigma_mm", 10, { min: 0, max: 100, step: 1 })),
    field("Longer side of the sample (mm)", input("side_mm", 100, { min: 10, max: 500, step: 1 }))));

  /** Puts another result beside this one; "" takes it away. */
  async function compare(other) {
    try {
      const next = other ? parseView(await fetched(other)) : null;
      parts.compare(next, [called(id), called(other)]);
      beside = other;
      link();
    } catch (problem) {
      if (problem.name !== "AbortError") complain(problem);
    }
    others.value = beside;
  }
  const names = new Map(results.map((r) => [r.id, `${r.title} · ${r.about}`]));
  const called = (which) => names.get(which) ?? which;
  const options = [["", "Nothing"], ...[...names].filter(([which]) => which !== id)];
  const others = select(options, "", { id: "view-with", onchange: (e) => compare(e.target.value) });
  const comparison = panel("Compare", null, field("Beside it, under the same light", others, { hint: "Drag the line between them, or move it with the arrow keys." }));

  const name = `${forFile(job)}-view`;
  const keep = h("button", { type: "button", id: "view-export", onclick: async () => {
    keep.disabled = true;
    try {
      save((await picture(`/reconstructions/${id}/view.html${query({ ...look, state: stateText(state) })}`, { signal })).blob, `${name}.html`);
      tell("The file opens in any browser, from disk.");
    } catch (problem) {
      complain(problem);
    } finally {
      keep.disabled = false;
    }
  } }, "Export as one file");
  const copy = h("button", { type: "button", onclick: async () => {
    link();
    await navigator.clipboard?.writeText(location.href).catch(complain);
    tell(hasToken() ? "The link is copied; whoever opens it needs the token." : "The link is copied.");
  } }, "Copy link");
  main.append(h("div", { class: "head" }, h("h1", { class: "grow" }, `${job.name}, under a light`), copy, keep, h("a", { class: "button", href: `#/result/${id}` }, "Result")));
  const changed = (now) => {
    state = now;
    link();
  };
  parts = await viewer(main, { view, state, name, aside: [comparison, assumed], signal, changed, anew: (now) => {
    changed(now);
    location.reload();
  } });
  if (beside) await compare(beside);
}
