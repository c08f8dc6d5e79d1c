// The options of a lookup table: wavelength, scale, light, observer, size.

import { field, h, number, select } from "./dom.js";

const LIGHTS = ["E", "A", "A-inverse", "D65", ...Array.from({ length: 12 }, (_, i) => `FL${i + 1}`), "LED-B1", "LED-B3"].map((l) => [l, l]);
const NAMES = { E: "E (equal energy)", A: "A (tungsten)", "A-inverse": "Inverse of A", D65: "D65 (daylight)" };
const OBSERVERS = [["1931", "CIE 1931, 2°"], ["1964", "CIE 1964, 10°"]];

/** The fields, as an earlier table left them if there is one; `options()` is what the service takes. */
export function tableFields(given = {}) {
  const wavelength = number({ id: "table-wavelength", value: given.wavelength_nm ?? 680, min: 300, max: 1100 });
  const scale = number({ id: "table-scale", value: given.scale ?? 0.002, min: 0 });
  const light = select(LIGHTS.map(([v]) => [v, NAMES[v] ?? v]), given.illuminant ?? "E", { id: "table-light" });
  const observer = select(OBSERVERS, given.observer ?? "1931", { id: "table-observer" });
  const size = number({ id: "table-size", value: given.size ?? 1024, min: 16, max: 8192, step: 1 });
  const extent = number({ id: "table-extent", value: given.extent ?? 1, min: 0 });
  const exponent = number({ id: "table-exponent", value: given.exponent ?? 4 });
  const element = h("div", { class: "fields" },
    field("Wavelength of the photograph (nm)", wavelength), field("Half vector per pixel", scale, { hint: "2 sin θ at normal incidence" }),
    field("Light", light), field("Observer", observer), field("Size (pixels)", size), field("Extent", extent, { hint: "Half vectors from -extent to extent" }),
    field("Exponent", exponent, { hint: "4 is exact for shallow gratings" }));
  return {
    element,
    options: () => ({
      ...given, wavelength_nm: wavelength.valueAsNumber, scale: scale.valueAsNumber, illuminant: light.value, observer: observer.value,
      size: size.valueAsNumber, extent: extent.valueAsNumber, exponent: exponent.valueAsNumber,
    }),
  };
}
