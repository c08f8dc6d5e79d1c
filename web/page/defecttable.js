// The defects of a sheet as a table that can be sorted; a click on a row marks the defect.

import { h } from "./dom.js";
import { fixed, percent, words } from "./format.js";

/**
 * Columns: title, key to sort by, and text.
 * @type {[string, (d: Defect, k: number, sheet: SheetReport) => number | string, (d: Defect, k: number, sheet: SheetReport) => string][]}
 */
const COLUMNS = [
  ["No.", (_, k) => k, (_, k) => String(k + 1)],
  ["Class", (d) => d.class, (d) => words(d.class)],
  ["Area", (d) => d.area_px, (d) => (d.area_mm2 === null ? `${fixed(d.area_px, 0)} px` : `${fixed(d.area_mm2, 3)} mm²`)],
  ["x, y", (d) => d.at_px[0], (d, _, sheet) => placeOf(d, sheet)],
  ["Length × width", (d) => d.size_px[0], (d) => (d.size_mm ? `${fixed(d.size_mm[0], 2)} × ${fixed(d.size_mm[1], 2)} mm` : `${fixed(d.size_px[0], 1)} × ${fixed(d.size_px[1], 1)} px`)],
  ["Deviation", (d) => d.deviation, (d) => `${fixed(d.deviation, 1)} σ`],
  ["Turned", (d) => d.orientation_deg ?? 0, (d) => (d.orientation_deg === null ? "–" : `${fixed(d.orientation_deg, 1)}°`)],
  ["Polarization", (d) => d.polarization, (d) => percent(d.polarization, 0)],
  ["Brightness", (d) => d.brightness ?? 0, (d) => (d.brightness === null ? "–" : percent(d.brightness, 0))],
  ["Period", (d) => d.period ?? 0, (d) => (d.period === null ? "–" : percent(d.period, 0))],
];

/** Centre of a defect, right of and above the middle of the reference. */
function placeOf(/** @type {Defect} */ { at_px: [x, y] }, /** @type {SheetReport} */ { pixel_um: um, size_px: [width, height] }) {
  if (!um) return `${fixed(x, 0)}, ${fixed(y, 0)} px`;
  return `${fixed(((x - (width - 1) / 2) * um) / 1000, 2)}, ${fixed((((height - 1) / 2 - y) * um) / 1000, 2)} mm`;
}

/**
 * The table. `mark(k)` marks a row; `chosen(k)` is called for a row that is clicked.
 * @param {SheetReport} sheet
 * @param {(k: number) => void} chosen
 */
export function defectTable(sheet, chosen) {
  const rows = sheet.defects.map((d, k) => h("tr", { "data-defect": k + 1, onclick: () => chosen(k) },
    COLUMNS.map(([title, , text], c) => h("td", {}, c === 0 ? h("button", { type: "button", class: "quiet", "aria-label": `Mark defect ${k + 1}`, onclick: (e) => { e.stopPropagation(); chosen(k); } }, text(d, k, sheet)) : text(d, k, sheet)))));
  const body = h("tbody", {}, rows);
  let [by, down] = [0, false];
  const heads = COLUMNS.map(([title], c) => h("th", { scope: "col" }, h("button", { type: "button", class: "quiet sort", onclick: () => sort(c) }, title)));
  function sort(c) {
    [by, down] = [c, c === by ? !down : false];
    const key = COLUMNS[c][1];
    const order = sheet.defects.map((d, k) => ({ value: key(d, k, sheet), k }));
    order.sort((a, b) => (a.value < b.value ? -1 : a.value > b.value ? 1 : a.k - b.k));
    if (down) order.reverse();
    body.replaceChildren(...order.map(({ k }) => rows[k]));
    heads.forEach((head, i) => (i === c ? head.setAttribute("aria-sort", down ? "descending" : "ascending") : head.removeAttribute("aria-sort")));
  }
  const mark = (/** @type {number} */ marked) => rows.forEach((row, k) => row.classList.toggle("marked", k === marked));
  if (!rows.length) return { element: h("p", {}, "No defect."), mark };
  return { element: h("div", { class: "scroll" }, h("table", { id: "defects" }, h("thead", {}, h("tr", {}, heads)), body)), mark };
}
