// Steps that lead through something: each says what to do, what is expected, and whether it was met; the next one opens then.

import { post, send } from "./api.js";
import { field, h, panel, say } from "./dom.js";
import { problemMessage } from "./feedback.js";
import { bytes } from "./format.js";

/**
 * @typedef {{ element: HTMLElement, body: HTMLElement, lamp: HTMLElement, judge: () => [boolean, string] }} Step
 */

/**
 * A step: what to do, what is expected, and whether it was met.
 * @param {string} title
 * @param {string} expected
 * @param {() => [boolean, string]} judge
 * @param {...Child} parts
 * @returns {Step}
 */
export function stepOf(title, expected, judge, ...parts) {
  const lamp = h("span", { class: "lamp", role: "status" });
  const body = h("div", { class: "stack" }, parts, h("p", { class: "soft" }, h("strong", {}, "Expected: "), expected));
  return { element: panel(title, lamp, body), body, lamp, judge };
}

/**
 * Steps one after the other: one opens once those before it are done. A step is judged anew after a `change` or `judge` event in it.
 * @param {Step[]} steps
 */
export function guided(steps) {
  for (const step of steps) for (const what of ["change", "judge"]) step.element.addEventListener(what, paint);
  paint();
  return h("div", { class: "stack wizard" }, steps.map((step) => step.element));

  function paint() {
    let open = true;
    for (const step of steps) {
      const [met, text] = step.judge();
      step.body.hidden = !open;
      step.lamp.dataset.tone = !open ? "quiet" : met ? "good" : "warn";
      say(step.lamp, open ? text : "after the step before");
      open &&= met;
    }
  }
}

/**
 * Photographs that are chosen, as a list of pictures; `more(file)` are fields of each. Tells `photographs` when the list changes.
 * @param {string} id
 * @param {(file: File) => Child} more
 */
export function photographs(id, more = () => null) {
  /** @type {{ file: File, url: string, size: string, more: Child }[]} */
  let chosen = [];
  const input = h("input", { type: "file", id, multiple: true, accept: ".png,.tif,.tiff,.jpg,.jpeg", onchange: () => add([...(input.files ?? [])]) });
  const list = h("ul", { class: "thumbs" });
  const element = h("div", { class: "shots" }, field("Photographs (PNG, TIFF, JPEG)", input), list);

  const changed = () => {
    list.replaceChildren(...chosen.map((one) => h("li", {}, h("img", { src: one.url, alt: "" }), h("span", {}, one.file.name),
      h("button", { type: "button", class: "quiet icon", "aria-label": `Remove ${one.file.name}`, onclick: () => {
        URL.revokeObjectURL(one.url);
        chosen = chosen.filter((p) => p !== one);
        changed();
      } }, "✕"), one.more)));
    element.dispatchEvent(new Event("photographs"));
  };
  /** @param {File[]} files */
  async function add(files) {
    const names = new Set(chosen.map((p) => p.file.name));
    const fresh = await Promise.all(files.filter((file) => !names.has(file.name)).map(async (file) => {
      // Browsers do not read every TIFF; the service does, and judges.
      const bitmap = await createImageBitmap(file).catch(() => null);
      const size = bitmap ? `${bitmap.width} × ${bitmap.height}` : "";
      bitmap?.close();
      return { file, url: URL.createObjectURL(file), size, more: more(file) };
    }));
    chosen = [...chosen, ...fresh].sort((a, b) => a.file.name.localeCompare(b.file.name));
    input.value = "";
    changed();
  }
  return {
    element,
    files: () => chosen.map((p) => p.file),
    /** What is wrong with their sizes, `wanted` being that of the camera; "" if nothing. */
    unlike(wanted = "") {
      const sizes = new Set(chosen.map((p) => p.size).filter(Boolean));
      if (sizes.size > 1) return `sizes differ: ${[...sizes].join(", ")} pixels`;
      const [one] = sizes;
      return wanted && one && one !== wanted ? `they are ${one} pixels, and the camera was calibrated at ${wanted}` : "";
    },
  };
}

/**
 * A button that asks for a calibration, and leads to what comes of it. Without files none are uploaded.
 * @param {string} id
 * @param {() => { files: { file: File, name: string }[], options: object }} asked
 */
export function startOf(id, asked) {
  const start = h("button", { type: "button", id, class: "primary", onclick: begin }, "Calibrate");
  const progress = h("p", { class: "soft", role: "status" });
  const problems = h("div", { role: "status" });
  const element = h("div", {}, h("div", { class: "row" }, start, progress), problems);
  async function begin() {
    start.disabled = true;
    problems.replaceChildren();
    try {
      const { files, options } = asked();
      let upload = null;
      if (files.length) {
        say(progress, `Uploading ${bytes(files.reduce((sum, { file }) => sum + file.size, 0))}…`);
        const form = new FormData();
        form.append("kind", "photographs");
        for (const { file, name } of files) form.append("file", file, name);
        upload = (await (await send("/uploads", { method: "POST", body: form })).json()).id;
      }
      /** @type {Job} */
      const job = await post("/reconstructions", { session: null, upload, method: "calibrate", options });
      // Whoever has gone elsewhere meanwhile finds it among the results.
      if (element.isConnected) location.hash = `#/calibrate/${job.id}`;
    } catch (problem) {
      problems.replaceChildren(problemMessage(problem));
    }
    start.disabled = false;
    say(progress, "");
  }
  return element;
}
