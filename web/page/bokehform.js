// The options of a bokeh photograph: blur, iterations, light, part, scale, lens, known grating, slice.

import { field, h, number, select } from "./dom.js";

const CHANNELS = [["blue", "Blue (finest lines)"], ["green", "Green"], ["red", "Red"], ["luminance", "Luminance"]];
const SHAPES = [["", "Not known"], ["sinusoid", "Sinusoid"], ["blazed", "Blazed"], ["rectangular", "Rectangular"]];

/** The fields, as an earlier reconstruction left them if there is one; `options()` is what the service takes. */
export function bokehFields(given = {}) {
  const { psf = {}, scale = {}, lens = {}, known = {} } = given;
  const blur = number({ id: "bokeh-blur", value: psf.sigma ?? 2, min: 0 });
  const light = select(CHANNELS, given.light ?? "blue", { id: "bokeh-light" });
  const part = ["column", "row", "width", "height"].map((name, k) => number({ id: `bokeh-${name}`, value: given.crop?.[k] ?? "", min: 0, step: 1 }));
  const rotate = number({ id: "bokeh-rotate", value: given.rotate_deg ?? 0 });
  const pixel = number({ id: "bokeh-pixel", value: scale.pixel ?? "", min: 0 });
  const lines = number({ id: "bokeh-lines", value: scale.lines?.per_mm ?? "", min: 0 });
  const counted = number({ id: "bokeh-count", value: scale.lines?.count ?? "", min: 0 });
  const rounds = number({ id: "bokeh-iterations", value: given.iterations?.count ?? "", min: 1, max: 10000, step: 1 });
  const ends = ["x0", "y0", "x1", "y1"].map((name, k) => number({ id: `bokeh-slice-${name}`, value: given.slice?.[k] ?? "" }));
  const across = number({ id: "bokeh-slice-width", value: given.slice_width ?? 15, min: 1, step: 1 });
  const focal = number({ id: "bokeh-focal", value: lens.focal_mm ?? "", min: 0 });
  const stop = number({ id: "bokeh-stop", value: lens.f_number ?? "", min: 0 });
  const distance = number({ id: "bokeh-distance", value: lens.distance_m ?? "", min: 0 });
  const shape = select(SHAPES, known.shape ?? "", { id: "bokeh-shape", onchange: paint });
  const depth = number({ id: "bokeh-depth", value: known.depth_um ?? "", min: 0 });
  const depthField = field("Its depth (µm)", depth, { hint: "From its lowest to its highest point" });
  function paint() {
    depthField.hidden = shape.value === "";
  }
  paint();
  const element = h("div", { class: "fields" },
    field("Blur, standard deviation (pixels)", blur), field("Iterations", rounds, { hint: "Empty: until another one fits noise" }), field("Light", light),
    ["Part: first column", "Part: first row", "Part: width", "Part: height"].map((label, k) => field(label, part[k], k === 0 ? { hint: "Empty: all of it" } : {})),
    field("Turn anticlockwise (°)", rotate, { hint: "So that the lines stand upright" }),
    field("Pixel on the sample (µm)", pixel, { hint: "Or the next" }), field("Lines per mm", lines, { hint: "They are counted, which tells the scale" }),
    field("Lines that the slice crosses", counted, { hint: "Empty: counted by the program" }),
    field("Focal length (mm)", focal, { hint: "With the next two: what the lens can show" }), field("F-number", stop), field("Lens to sample (m)", distance),
    field("Shape of the grating", shape, { hint: "A known one calibrates heights" }), depthField,
    ["Slice: from column", "Slice: from row", "Slice: to column", "Slice: to row"].map((label, k) => field(label, ends[k], k === 0 ? { hint: "Empty: across the middle" } : {})),
    field("Slice: pixels across", across, { hint: "That it is the mean of" }));
  const value = (input) => (Number.isFinite(input.valueAsNumber) ? input.valueAsNumber : null);
  return {
    element,
    options: () => {
      /** @type {Record<string, any>} */
      const options = { ...given, psf: { sigma: value(blur) ?? 0 }, light: light.value, rotate_deg: value(rotate) ?? 0 };
      for (const name of ["crop", "scale", "lens", "known", "slice"]) delete options[name];
      const crop = part.map(value);
      if (crop.every((v) => v !== null)) options.crop = crop;
      if (value(pixel) !== null) options.scale = { pixel: value(pixel) };
      else if (value(lines) !== null) options.scale = { lines: { per_mm: value(lines), count: value(counted) } };
      const told = { focal_mm: value(focal), f_number: value(stop), distance_m: value(distance) };
      if (Object.values(told).some((v) => v !== null)) options.lens = told;
      if (value(rounds) !== null) options.iterations = { count: value(rounds) };
      else if (options.iterations?.count) delete options.iterations;
      const line = ends.map(value);
      if (line.every((v) => v !== null)) options.slice = line;
      if (value(across) !== null) options.slice_width = value(across);
      if (shape.value) options.known = { shape: shape.value, depth_um: value(depth) };
      return options;
    },
  };
}
