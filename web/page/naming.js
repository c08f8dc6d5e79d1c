// Names of sessions, results and uploads: shown, and changed where they are shown.

import { send } from "./api.js";
import { h, say } from "./dom.js";
import { complain } from "./feedback.js";

/** Longest name that the service takes, in characters. */
const LONGEST = 200;

/**
 * A name with a button that changes it; an empty name restores the derived one. `path` is the thing in the interface.
 * @param {HTMLElement} title
 * @param {string} name
 * @param {string} path
 * @param {(name: string) => void} [changed]
 */
export function renameable(title, name, path, changed = () => {}) {
  say(title, name);
  const input = h("input", { "aria-label": "Name", maxlength: LONGEST, placeholder: "Empty: the derived name", autocomplete: "off", onkeydown: (e) => e.key === "Escape" && edit(false) });
  const form = h("form", { class: "row", onsubmit: (e) => { e.preventDefault(); save(); } },
    input, h("button", { class: "primary" }, "Save"), h("button", { type: "button", onclick: () => edit(false) }, "Cancel"));
  const rename = h("button", { type: "button", class: "quiet rename", onclick: () => edit(true) }, "Rename");
  const shown = h("div", { class: "row" }, title, rename);
  const element = h("div", { class: "naming" }, shown);

  function edit(on) {
    element.replaceChildren(on ? form : shown);
    if (on) {
      input.value = title.textContent ?? "";
      input.select();
    } else rename.focus();
  }

  async function save() {
    try {
      const answer = await send(path, { method: "PATCH", body: JSON.stringify({ name: input.value }), headers: { "Content-Type": "application/json" } });
      const { name: now } = await answer.json();
      say(title, now);
      edit(false);
      changed(now);
    } catch (problem) {
      complain(problem);
    }
  }
  return element;
}

/**
 * The heading of a page, and its title in the browser.
 * @param {string} name
 * @param {string} path
 * @param {boolean} changeable
 */
export function heading(name, path, changeable = true) {
  const entitle = (now) => (document.title = `${now} · Nacre`);
  entitle(name);
  if (!changeable) return h("h1", { class: "grow" }, name);
  const element = renameable(h("h1"), name, path, entitle);
  element.classList.add("grow");
  return element;
}

/**
 * The heading of a result. Results of a session are called as the session, and renamed with it.
 * @param {Job} job
 */
export const headingOf = (job) => heading(job.name, `/reconstructions/${job.id}`, job.id !== job.session);

/**
 * The beginning of the names of a thing's downloads.
 * @param {{ name: string, id: string }} thing
 */
export const forFile = ({ name, id }) => name.replace(/[^\p{L}\p{N}._-]+/gu, "-").replace(/^[-.]+|[-.]+$/g, "").slice(0, 80) || id;
