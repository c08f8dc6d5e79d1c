// The options of photographs of tiles under a flash: those of the operation, and picking in a photograph.

import { field, h, select } from "./dom.js";
import { operationForm } from "./operationform.js";
import { picker } from "./picker.js";

const CORNERS = ["top left corner", "top right corner", "bottom right corner", "bottom left corner"];

/**
 * The form, as an earlier reconstruction left it if there is one; `options()` is what the service takes.
 * @param {Record<string, any>} [given]
 * @param {{ described?: boolean }} more `described` if frames.json comes with the photographs
 */
export function flashForm(given = {}, { described = false } = {}) {
  const form = operationForm("flash", given, { without: ["corners_px", "reference_px"] });
  const frames = h("input", { type: "file", id: "flash-frames", accept: ".json" });
  const rectangle = given.reference_px;
  const kind = select([["corners", "Corners of the sheet"], ["tile", "One tile"]], rectangle ? "tile" : "corners", { id: "flash-pick", onchange: paint });
  const corners = picker("flash-corner", CORNERS, { given: Array.isArray(given.corners_px) ? given.corners_px : null });
  const tile = picker("flash-tile", ["one corner of a tile", "the opposite corner"],
    { given: rectangle ? [[rectangle[0], rectangle[1]], [rectangle[0] + rectangle[2], rectangle[1] + rectangle[3]]] : null });
  function paint() {
    corners.element.hidden = kind.value !== "corners";
    tile.element.hidden = kind.value !== "tile";
  }
  paint();
  const description = described ? null : h("div", { class: "fields" }, field("Description of the photographs", frames, { hint: "frames.json: exposures, and positions of the flash. It is found among the photographs, too" }));
  const element = h("div", { class: "stack" }, description,
    form.element, field("Pick in the photograph by room light", kind, { hint: "Or nothing: corners are detected" }), corners.element, tile.element);
  return {
    element,
    /** The photograph to pick in. */
    show: (file, wide = 0) => Promise.all([corners.show(file, wide), tile.show(file, wide)]),
    /** A frames.json, if one was given. */
    frames: () => frames.files?.[0] ?? null,
    options: () => {
      /** @type {Record<string, unknown>} */
      const options = form.options();
      if (kind.value === "corners" && corners.points().length === 4) options.corners_px = corners.points();
      if (kind.value === "tile" && tile.points().length === 2) {
        const [a, b] = tile.points();
        options.reference_px = [Math.min(a[0], b[0]), Math.min(a[1], b[1]), Math.abs(a[0] - b[0]), Math.abs(a[1] - b[1])];
      }
      return options;
    },
  };
}
