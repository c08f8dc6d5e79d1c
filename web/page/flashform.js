// The options of photographs of tiles under a flash: where everything is, tiles, corners, periods.

import { geometryField } from "./assetforms.js";
import { field, h, number, select } from "./dom.js";
import { picker } from "./picker.js";

/** The fields, as an earlier reconstruction left them if there is one; `options()` is what the service takes. Of what is only planned there
 * is no photograph yet to pick in. */
export function flashFields(given = {}, { planned = false } = {}) {
  const pair = (id, values, attributes) => [0, 1].map((k) => number({ id: `${id}-${k}`, value: values?.[k] ?? "", ...attributes }));
  const tiles = pair("flash-tiles", given.tiles, { min: 1, step: 1 });
  const size = pair("flash-size", given.size_mm, { min: 0 });
  const periods = pair("flash-period", given.period_um, { min: 0 });
  const camera = number({ id: "flash-camera", value: given.camera_mm ?? "", min: 0 });
  const light = number({ id: "flash-light", value: given.light_height_mm ?? "", min: 0 });
  const wavelength = number({ id: "flash-wavelength", value: given.wavelength_nm ?? "", min: 200, max: 2000 });
  const shared = select([["auto", "As the photographs tell"], ["sample", "One for all"], ["pixel", "One per pixel"]], given.period ?? "auto", { id: "flash-shared" });
  const frames = h("input", { type: "file", id: "flash-frames", accept: ".json" });
  const geometry = geometryField("flash-geometry", given.geometry);
  const kind = select([["corners", "Corners of the sheet"], ["tile", "One tile"]], "corners", { id: "flash-pick", onchange: paint });
  const corners = picker(["top left corner", "top right corner", "bottom right corner", "bottom left corner"]);
  const tile = picker(["one corner of a tile", "the opposite corner"]);
  const pickers = { corners: h("div", {}, corners.element), tile: h("div", {}, tile.element) };
  const pick = field("Pick in the photograph by room light", kind, { hint: "Or nothing: corners are found" });
  function paint() {
    pickers.corners.hidden = kind.value !== "corners";
    pickers.tile.hidden = kind.value !== "tile";
  }
  paint();
  const element = h("div", { class: "stack" },
    h("div", { class: "fields" },
      !planned && field("Description of the photographs", frames, { hint: "frames.json: exposures, and where the flash was" }),
      field("Calibration", geometry.input, { hint: given.geometry ? "As before, or another geometry.json" : "geometry.json, if there is one" }),
      field("Tiles across", tiles[0], { hint: "Empty: from one picked tile" }), field("Tiles down", tiles[1]),
      field("Sheet, width (mm)", size[0]), field("Sheet, height (mm)", size[1]),
      field("Camera above it (mm)", camera, { hint: "Without a calibration" }), field("Light above it (mm)", light, { hint: "Empty: as described" }),
      field("Wavelength (nm)", wavelength, { hint: "Empty: as described" }),
      field("Shortest period (µm)", periods[0], { hint: "Empty: all that are in reach" }), field("Longest period (µm)", periods[1]),
      field("Periods", shared)),
    !planned && [pick, pickers.corners, pickers.tile]);
  const both = (inputs) => {
    const values = inputs.map((input) => input.valueAsNumber);
    return values.every(Number.isFinite) ? values : null;
  };
  const one = (input) => (Number.isFinite(input.valueAsNumber) ? input.valueAsNumber : null);
  return {
    element,
    /** The photograph to pick in. */
    show: (file) => Promise.all([corners.show(file), tile.show(file)]),
    /** A frames.json, if one was given. */
    frames: () => frames.files?.[0] ?? null,
    options: () => {
      /** @type {Record<string, unknown>} */
      const options = { ...given, period: shared.value };
      const set = (name, value) => { if (value === null) delete options[name]; else options[name] = value; };
      set("geometry", geometry.value());
      set("tiles", both(tiles));
      set("size_mm", both(size));
      set("period_um", both(periods));
      set("camera_mm", one(camera));
      set("light_height_mm", one(light));
      set("wavelength_nm", one(wavelength));
      if (kind.value === "corners" && corners.points().length === 4) options.corners_px = corners.points();
      if (kind.value === "tile" && tile.points().length === 2) {
        const [a, b] = tile.points();
        options.reference_px = [Math.min(a[0], b[0]), Math.min(a[1], b[1]), Math.abs(a[0] - b[0]), Math.abs(a[1] - b[1])];
      }
      return options;
    },
  };
}
