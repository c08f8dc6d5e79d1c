// The two ways to begin: a simulated sample, or photographs that exist. Large for a new user, one line for others.

import { get, picture, post, show } from "./api.js";
import { h } from "./dom.js";
import { complain } from "./feedback.js";
import { words } from "./format.js";

/** Sample whose photographs illustrate the second door. */
const PHOTOGRAPHED = "kinematic";

/** Names of samples that are no plain words. */
const NAMES = { cd: "CD", stochastic: "random foil" };

/** Results that photographs can give, as on the upload page. */
const PHOTOGRAPHS = [
  "Through a polarizer at three or more angles: a map of grating orientations",
  "At several exposures: one photograph of high dynamic range",
  "Of the mirror image of a light: a lookup table for rendering",
];

/**
 * The doors; resolves once it is known whether there are results.
 * @param {AbortSignal} signal
 */
export async function doors(signal) {
  const element = h("section", { "aria-label": "Begin" });
  try {
    const [sessions, results, { items }] = await Promise.all([
      get("/sessions?limit=1", { signal }), get("/reconstructions?limit=1", { signal }), get("/samples", { signal })]);
    if (sessions.items.length || results.items.length) line(element, items, signal);
    else large(element, items, signal);
  } catch (problem) {
    // The page's own messages say why the service does not answer; the bench is shown without the doors.
    if (problem.name !== "AbortError") element.hidden = true;
  }
  return element;
}

/**
 * @param {HTMLElement} element
 * @param {Sample[]} samples
 * @param {AbortSignal} signal
 */
function large(element, samples, signal) {
  const strip = h("img", { alt: "Four photographs of a simulated sample, at analyser angles of 0°, 45°, 90° and 135°", class: "strip", width: 512, height: 128 });
  fill(strip, `/samples/${PHOTOGRAPHED}/photographs.png`, signal);
  element.className = "doors";
  element.replaceChildren(
    h("div", { class: "panel door" },
      h("h2", {}, "Try a sample"),
      h("p", { class: "soft" }, "Choose a simulated sample. Nacre photographs it and computes its map of orientations, in about 15 seconds."),
      gallery(samples, signal)),
    h("div", { class: "panel door" },
      h("h2", {}, "Use my photographs"),
      h("p", { class: "soft" }, "Upload photographs that you have taken; no bench is needed."),
      strip,
      h("ul", { class: "bullets" }, PHOTOGRAPHS.map((text) => h("li", {}, text))),
      h("a", { class: "button primary", id: "door-photographs", href: "#/upload" }, "Use my photographs")));
}

/**
 * @param {HTMLElement} element
 * @param {Sample[]} samples
 * @param {AbortSignal} signal
 */
function line(element, samples, signal) {
  // The pictures are fetched once they are wanted.
  const tried = h("details", { class: "try", ontoggle: () => tried.children.length < 2 && tried.append(gallery(samples, signal)) },
    h("summary", {}, "Try a sample"));
  element.className = "doors line";
  element.replaceChildren(tried, h("a", { href: "#/upload" }, "Use my photographs"));
}

/**
 * A button with picture for each sample.
 * @param {Sample[]} samples
 * @param {AbortSignal} signal
 */
function gallery(samples, signal) {
  const begin = async (/** @type {HTMLButtonElement} */ button, /** @type {string} */ kind) => {
    button.setAttribute("aria-busy", "true");
    try {
      const { id } = await post(`/samples/${kind}/sessions`);
      location.hash = `#/session/${id}`;
    } catch (problem) {
      complain(problem);
    }
    button.removeAttribute("aria-busy");
  };
  return h("ul", { class: "samples" }, samples.map(({ kind, about }) => {
    const image = h("img", { alt: "", width: 96, height: 96 });
    fill(image, `/samples/${kind}/picture.png?width=192`, signal);
    const button = h("button", { type: "button", "data-sample": kind, title: about, onclick: () => begin(button, kind) }, image, h("span", {}, NAMES[kind] ?? words(kind)));
    return h("li", {}, button);
  }));
}

/**
 * Fetches a picture, as a link could not carry the token. Without it the text beside it still says all.
 * @param {HTMLImageElement} image
 * @param {string} path
 * @param {AbortSignal} signal
 */
async function fill(image, path, signal) {
  try {
    show(image, (await picture(path, { signal })).blob);
  } catch (problem) {
    if (problem.name !== "AbortError" && problem.slug === undefined) throw problem;
  }
}
