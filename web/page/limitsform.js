// Limits of good sheets: none, trained ones, a file, or numbers.

import { send } from "./api.js";
import { field, h, number, select } from "./dom.js";
import { moment, words } from "./format.js";

const CLASSES = ["missing", "wrong_orientation", "wrong_period", "scratch", "dirt"];
/** Limits of a class: key, title. */
const OF_CLASS = [["max_count", "Largest number"], ["max_area_mm2", "Largest area (mm²)"], ["max_length_mm", "Largest length (mm)"]];
/** Limits of the whole sheet: key, title. */
const OF_SHEET = [["max_orientation_deg", "Orientation, RMS (°)"], ["max_presence", "Presence, RMS"], ["max_brightness", "Brightness, RMS of the logarithm"], ["min_overlap", "Least share of the reference"]];

/**
 * The form. `option(signal)` uploads the chosen file or the numbers, if any, and gives the value of the option and the id of the upload.
 * @param {Job[]} trained Inspections that trained limits.
 * @param {string} chosen Value of the option of an earlier inspection.
 */
export function limitsForm(trained, chosen) {
  const list = select([["", "No defect of any class"], ...trained.map((job) => [`result:${job.id}/limits.toml`, `${job.name}, ${moment(job.created)}`]), ["numbers", "Numbers"], ["file", "A file"]], "", { id: "limits", onchange: paint });
  if (trained.some((job) => chosen === `result:${job.id}/limits.toml`)) list.value = chosen;
  const file = h("input", { type: "file", id: "limits-file", accept: ".toml" });
  const one = (label, key, value) => number({ min: 0, step: "any", "aria-label": label, "data-key": key, value, placeholder: "any" });
  const classes = CLASSES.map((name) => ({ name, inputs: OF_CLASS.map(([key, title]) => one(`${words(name)}: ${title}`, key, key === "max_count" ? 0 : "")) }));
  const sheet = OF_SHEET.map(([key, title]) => ({ title, input: one(title, key, "") }));
  const numbers = h("div", { class: "stack", id: "limits-numbers" },
    h("div", { class: "scroll" }, h("table", { class: "limits" }, h("thead", {}, h("tr", {}, h("th", { scope: "col" }, "Class"), OF_CLASS.map(([, title]) => h("th", { scope: "col" }, title)))),
      h("tbody", {}, classes.map(({ name, inputs }) => h("tr", {}, h("th", { scope: "row" }, words(name)), inputs.map((input) => h("td", {}, input))))))),
    h("div", { class: "fields" }, sheet.map(({ title, input }) => field(title, input))),
    h("p", { class: "soft" }, "An empty field limits nothing."));
  const fileField = field("File of limits", file, { hint: "limits.toml of a training, or of nacre inspect --train" });
  function paint() {
    numbers.hidden = list.value !== "numbers";
    fileField.hidden = list.value !== "file";
  }
  paint();

  /** The numbers as a TOML file. */
  function toml() {
    const lines = (/** @type {HTMLInputElement[]} */ inputs) => inputs.filter((input) => Number.isFinite(input.valueAsNumber)).map((input) => `${input.dataset.key} = ${input.valueAsNumber}`);
    const parts = [["sheet", sheet.map(({ input }) => input)], ...classes.map(({ name, inputs }) => [`defects.${name}`, inputs])];
    return ["version = 1", ...parts.flatMap(([name, inputs]) => [`\n[${name}]`, ...lines(/** @type {HTMLInputElement[]} */ (inputs))])].join("\n") + "\n";
  }

  return {
    element: h("div", { class: "stack" }, field("Limits", list, { hint: "A sheet that exceeds one is rejected" }), numbers, fileField),
    async option(/** @type {AbortSignal} */ signal) {
      if (list.value !== "numbers" && list.value !== "file") return { limits: list.value || undefined, upload: null };
      const blob = list.value === "file" ? file.files?.[0] : new Blob([toml()], { type: "application/toml" });
      if (!blob) throw Object.assign(new Error("No file of limits is chosen."), { title: "Limits are missing", remedy: "Choose a file, or other limits." });
      const form = new FormData();
      form.append("kind", "limits");
      form.append("name", "Limits");
      form.append("file", blob, "limits.toml");
      const upload = await (await send("/uploads", { method: "POST", body: form, signal })).json();
      return { limits: "limits.toml", upload: upload.id };
    },
  };
}
