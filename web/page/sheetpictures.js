// Two pictures of a sheet beside each other, with numbered defects; both show the same part.

import { picture } from "./api.js";
import { h, segments, svg } from "./dom.js";
import { complain } from "./feedback.js";

/** Margin of a box around a defect, in pixels of the map. */
const MARGIN = 4;
/** Smallest part that is shown, in pixels of the map. */
const LEAST = 24;
const STEP = 1.25;
/** Height of a number, as a share of the height of the part that is shown. */
const NUMBER = 0.045;

/**
 * The pictures of one sheet. `pick(k)` is called for a defect that is clicked.
 * @param {{ base: string, folder: string, sheet: SheetReport, others: [string, string][], pick: (k: number) => void, signal: AbortSignal }} options
 *   `others` are files and titles of the pictures beside that of the sample
 */
export function sheetPictures({ base, folder, sheet, others, pick, signal }) {
  const [width, height] = sheet.size_px;
  /** @type {Map<string, string>} */
  const urls = new Map();
  const part = { x: 0, y: 0, width };
  const sides = [side("Sample", "sample.png"), side("Beside the sample", others[0][0])];
  let marked = -1;

  signal.addEventListener("abort", () => urls.forEach((url) => URL.revokeObjectURL(url)));

  /** @param {SVGImageElement} image */
  async function load(image, file) {
    image.dataset.file = file;
    try {
      const path = `${base}/files/${encodeURIComponent(folder + file)}`;
      const url = urls.get(file) ?? URL.createObjectURL((await picture(path, { signal })).blob);
      urls.set(file, url);
      if (image.dataset.file === file) image.setAttribute("href", url);
    } catch (problem) {
      if (problem.name !== "AbortError") complain(problem);
    }
  }

  function side(label, file) {
    const image = svg("image", { width, height, preserveAspectRatio: "none" });
    const marks = sheet.defects.map((defect, k) => {
      const half = defect.size_px[0] / 2 + MARGIN;
      const [x, y] = defect.at_px.map((v) => v - half);
      return svg("g", { class: "defect", "data-defect": k + 1, onclick: () => pick(k) },
        svg("rect", { x, y, width: 2 * half, height: 2 * half }), svg("text", { x, y }, k + 1));
    });
    const view = svg("svg", { class: "sheet", role: "img", "aria-label": `${label}, with numbered defects`, preserveAspectRatio: "xMidYMid meet" }, image, marks);
    view.addEventListener("wheel", (event) => {
      event.preventDefault();
      zoom(event.deltaY < 0 ? 1 / STEP : STEP, at(view, event));
    }, { passive: false, signal });
    let from = /** @type {number[] | null} */ (null);
    view.addEventListener("pointerdown", (event) => (from = at(view, event)), { signal });
    view.addEventListener("pointermove", (event) => {
      if (!from || !event.buttons) return;
      const [x, y] = at(view, event);
      move(part.x + from[0] - x, part.y + from[1] - y);
    }, { signal });
    load(image, file);
    return { view, image, marks };
  }

  /**
   * The pixel of the map below the pointer.
   * @returns {[number, number]}
   */
  function at(view, event) {
    const matrix = view.getScreenCTM()?.inverse();
    const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(matrix);
    return [point.x, point.y];
  }

  function zoom(factor, /** @type {[number, number]} */ [x, y] = [part.x + part.width / 2, part.y + (part.width * height) / width / 2]) {
    const to = Math.min(width, Math.max(Math.min(LEAST, width), part.width * factor));
    const ratio = to / part.width;
    part.width = to;
    move(x - (x - part.x) * ratio, y - (y - part.y) * ratio);
  }

  function move(x, y) {
    const tall = (part.width * height) / width;
    part.x = Math.min(width - part.width, Math.max(0, x));
    part.y = Math.min(height - tall, Math.max(0, y));
    const size = NUMBER * tall;
    for (const { view, marks } of sides) {
      view.setAttribute("viewBox", `${part.x} ${part.y} ${part.width} ${tall}`);
      for (const mark of marks) {
        const text = mark.querySelector("text");
        const box = mark.querySelector("rect");
        const top = Number(box?.getAttribute("y"));
        text?.setAttribute("font-size", String(size));
        // Above the box, or below it at the upper edge.
        text?.setAttribute("y", String(top > 1.3 * size ? top - 0.25 * size : top + Number(box?.getAttribute("height")) + size));
      }
    }
  }

  /** Marks one defect, and brings it into view; -1 for none. */
  function mark(k) {
    marked = k;
    for (const { marks } of sides) marks.forEach((mark, i) => mark.classList.toggle("marked", i === k));
    if (k < 0 || part.width === width) return;
    const [x, y] = sheet.defects[k].at_px;
    move(x - part.width / 2, y - (part.width * height) / width / 2);
  }

  const choice = segments("Beside the sample", others, others[0][0], (file) => load(sides[1].image, file));
  const button = (label, title, act) => h("button", { type: "button", class: "icon", "aria-label": title, title, onclick: act }, label);
  const tools = h("div", { class: "row" }, button("+", "Enlarge", () => zoom(1 / STEP)), button("−", "Reduce", () => zoom(STEP)),
    h("button", { type: "button", onclick: () => zoom(width) }, "All"));
  move(0, 0);
  const element = h("div", { class: "sheets" },
    h("div", { class: "stack" }, h("div", { class: "row sheethead" }, h("h3", { class: "grow" }, "Sample"), tools), h("div", { class: "well" }, sides[0].view)),
    h("div", { class: "stack" }, h("div", { class: "row sheethead" }, choice), h("div", { class: "well" }, sides[1].view)));
  return { element, mark, get marked() { return marked; } };
}
