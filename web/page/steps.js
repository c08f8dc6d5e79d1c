// The frames of a free plan, one a row.

import { h } from "./dom.js";

const COLUMNS = [
  ["analyser_deg", "Analyser (°)", "as before"],
  ["display", "Panel", "as below"],
  ["exposure_ms", "Exposure (ms)", "as below"],
];

/** A table over `steps`, which it changes; `changed()` is called after each change. */
export function stepsEditor(steps, changed) {
  const body = h("tbody");
  const input = (step, key, label, placeholder, i) => h("td", {}, h("input", {
    value: step[key], placeholder, "aria-label": `${label}, frame ${i + 1}`, autocomplete: "off",
    oninput: (event) => {
      step[key] = event.target.value.trim();
      changed();
    },
  }));
  const act = (label, text, call) => h("button", { type: "button", class: "quiet icon", "aria-label": label, title: label, onclick: () => {
    call();
    paint();
    changed();
  } }, text);
  function paint() {
    body.replaceChildren(...steps.map((step, i) => h("tr", {},
      h("td", { class: "number soft" }, `${i + 1}`),
      COLUMNS.map(([key, label, placeholder]) => input(step, key, label, placeholder, i)),
      h("td", {}, h("input", { type: "checkbox", checked: step.flash, "aria-label": `Flash, frame ${i + 1}`, onchange: (event) => {
        step.flash = event.target.checked;
        changed();
      } })),
      h("td", { class: "number" },
        act(`Repeat frame ${i + 1}`, "+", () => steps.splice(i + 1, 0, { ...step })),
        steps.length > 1 && act(`Remove frame ${i + 1}`, "✕", () => steps.splice(i, 1))))));
  }
  paint();
  const problem = h("p", { class: "problem", role: "status" });
  return {
    element: h("div", { class: "field" },
      h("div", { class: "scroll" }, h("table", { class: "steps" },
        h("thead", {}, h("tr", {}, h("th", {}, ""), COLUMNS.map(([, label]) => h("th", { scope: "col" }, label)), h("th", { scope: "col" }, "Flash"), h("th", {}, ""))), body)),
      h("small", {}, "Panel: the diameter of a disc in mm, or “black”."), problem),
    mark(problems) {
      const wrong = Object.keys(problems).find((key) => key.startsWith("steps."));
      problem.textContent = wrong ? `Frame ${Number(wrong.slice(6)) + 1}: ${problems[wrong]}` : "";
    },
  };
}
