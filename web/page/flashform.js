// The options of photographs of tiles under a flash: those of the operation, and picking in a photograph.

import { field, h, select } from "./dom.js";
import { operationForm } from "./operationform.js";
import { picker } from "./picker.js";

/** The form, as an earlier reconstruction left it if there is one; `options()` is what the service takes. */
export function flashForm(given = {}) {
  const form = operationForm("flash", given, { without: ["corners_px", "reference_px"] });
  const frames = h("input", { type: "file", id: "flash-frames", accept: ".json" });
  const kind = select([["corners", "Corners of the sheet"], ["tile", "One tile"]], "corners", { id: "flash-pick", onchange: paint });
  const corners = picker(["top left corner", "top right corner", "bottom right corner", "bottom left corner"]);
  const tile = picker(["one corner of a tile", "the opposite corner"]);
  const pickers = { corners: h("div", {}, corners.element), tile: h("div", {}, tile.element) };
  function paint() {
    pickers.corners.hidden = kind.value !== "corners";
    pickers.tile.hidden = kind.value !== "tile";
  }
  paint();
  const element = h("div", { class: "stack" },
    h("div", { class: "fields" }, field("Description of the photographs", frames, { hint: "frames.json: exposures, and positions of the flash" })),
    form.element, field("Pick in the photograph by room light", kind, { hint: "Or nothing: corners are detected" }), pickers.corners, pickers.tile);
  return {
    element,
    /** The photograph to pick in. */
    show: (file) => Promise.all([corners.show(file), tile.show(file)]),
    /** A frames.json, if one was given. */
    frames: () => frames.files?.[0] ?? null,
    options: () => {
      const { corners_px, reference_px } = given;
      /** @type {Record<string, unknown>} */
      const options = { ...(corners_px && { corners_px }), ...(reference_px && { reference_px }), ...form.options() };
      if (kind.value === "corners" && corners.points().length === 4) options.corners_px = corners.points();
      if (kind.value === "tile" && tile.points().length === 2) {
        const [a, b] = tile.points();
        options.reference_px = [Math.min(a[0], b[0]), Math.min(a[1], b[1]), Math.abs(a[0] - b[0]), Math.abs(a[1] - b[1])];
      }
      return options;
    },
  };
}
