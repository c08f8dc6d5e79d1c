// The options of a lookup table: wavelength, scale, light, observer, size.

import { field, h, number, select } from "./dom.js";

const NAMES = { E: "E (equal energy)", A: "A (tungsten)", "A-inverse": "Inverse of A", D65: "D65 (daylight)" };
export const LIGHTS = ["E", "A", "A-inverse", "D65", ...Array.from({ length: 12 }, (_, i) => `FL${i + 1}`), "LED-B1", "LED-B3"].map((name) => [name, NAMES[name] ?? name]);
const OBSERVERS = [["1931", "CIE 1931, 2°"], ["1964", "CIE 1964, 10°"]];

/** The fields, as an earlier table left them if there is one; `options()` is what the service takes. */
export function tableFields(given = {}) {
  const band = typeof given.wavelength_nm === "number" ? given.wavelength_nm : "";
  const wavelength = number({ id: "table-wavelength", value: band, min: 200, max: 2000 });
  const scale = number({ id: "table-scale", value: given.scale ?? "", min: 0 });
  const light = select(LIGHTS, given.illuminant ?? "E", { id: "table-light" });
  const observer = select(OBSERVERS, given.observer ?? "1931", { id: "table-observer" });
  const size = number({ id: "table-size", value: given.size ?? 1024, min: 16, max: 8192, step: 1 });
  const extent = number({ id: "table-extent", value: given.extent ?? "", min: 0, max: 2 });
  const exponent = number({ id: "table-exponent", value: given.exponent ?? 4 });
  const center = [0, 1].map((k) => number({ id: `table-center-${"xy"[k]}`, value: given.center?.[k] ?? "", min: 0 }));
  const element = h("div", { class: "fields" },
    field("Light", light), field("Observer", observer),
    field("Wavelength of the photograph (nm)", wavelength, { hint: "Empty: as the session says" }),
    field("Half vector per pixel", scale, { hint: "2 × pixel size ÷ distance. Empty: from the session's geometry" }),
    field("Size (entries)", size), field("Extent", extent, { hint: "Empty: as far as was measured" }),
    field("Exponent", exponent, { hint: "4 is exact for shallow gratings" }),
    field("Zero order, from the left (pixels)", center[0], { hint: "Empty: the brightest lobe" }), field("Zero order, from the top (pixels)", center[1]));
  // Whatever has no field stays as it was; empty fields are left to the service.
  const values = () => ({ wavelength_nm: wavelength, scale, size, extent, exponent });
  return {
    element,
    options: () => {
      const options = { ...given, illuminant: light.value, observer: observer.value };
      for (const [name, input] of Object.entries(values())) {
        if (Number.isFinite(input.valueAsNumber)) options[name] = input.valueAsNumber;
        else if (name !== "wavelength_nm" || typeof given.wavelength_nm === "number") delete options[name];
      }
      const place = center.map((input) => input.valueAsNumber);
      if (place.every(Number.isFinite)) options.center = place;
      else delete options.center;
      if ("scale" in options) delete options.geometry;
      return options;
    },
  };
}
