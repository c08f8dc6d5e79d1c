// The options of a lookup table: wavelength, scale or distances, light, observer, size, error, sums.

import { field, h, number, select } from "./dom.js";
import { send } from "./api.js";

const NAMES = { E: "E (equal energy)", A: "A (tungsten)", "A-inverse": "Inverse of A", D65: "D65 (daylight)" };
export const LIGHTS = ["E", "A", "A-inverse", "D65", ...Array.from({ length: 12 }, (_, i) => `FL${i + 1}`), "LED-B1", "LED-B3"].map((name) => [name, NAMES[name] ?? name]);
const CHANNELS = [["", "That of the wavelength"], ["r", "Red"], ["g", "Green"], ["b", "Blue"]];
// `method` as the service takes it, by name and value.
const SUMS = [["auto", "The cheapest that is exact enough"], ["rays", "Along rays, so many pixels apart"], ["single", "Each entry by itself, samples so many pixels apart"], ["fixed", "In steps of so many nm, as in the paper"]];
const GEOMETRY = [["camera_mm", "Surface to camera (mm)"], ["flash_mm", "Surface to flash (mm)"], ["pixel_um", "A pixel on the surface (µm)"]];
const OBSERVERS = [["1931", "CIE 1931, 2°"], ["1964", "CIE 1964, 10°"]];

/** The fields, as an earlier table left them if there is one; `options()` is what the service takes. `inputs()` uploads the photograph of a light
    and says what stands for it in the request; an earlier light stays. What is only planned has none yet.
    @param {any} given
    @param {{ planned?: boolean, light?: Partial<LightUpload> | null }} more */
export function tableFields(given = {}, { planned = false, light: earlier = null } = {}) {
  // One, or those of red, green and blue.
  const bands = [given.wavelength_nm ?? []].flat();
  const [wavelength, ...others] = ["wavelength", "green", "blue"].map((name, k) => number({ id: `table-${name}`, value: bands[k] ?? "", min: 200, max: 2000 }));
  const channel = select(CHANNELS, given.channel ?? "", { id: "table-channel" });
  const scale = number({ id: "table-scale", value: given.scale ?? "", min: 0 });
  const light = select(LIGHTS, given.illuminant ?? "E", { id: "table-light" });
  const observer = select(OBSERVERS, given.observer ?? "1931", { id: "table-observer" });
  const size = number({ id: "table-size", value: given.size ?? 1024, min: 16, max: 8192, step: 1 });
  const extent = number({ id: "table-extent", value: given.extent ?? "", min: 0, max: 2 });
  const exponent = number({ id: "table-exponent", value: given.exponent ?? 4 });
  const center = [0, 1].map((k) => number({ id: `table-center-${"xy"[k]}`, value: given.center?.[k] ?? "", min: 0 }));
  const shape = h("input", { type: "file", id: "table-shape", multiple: true, accept: ".png,.tif,.tiff,.jpg,.jpeg,.exr" });
  const shapeScale = number({ id: "table-shape-scale", value: earlier?.scale ?? "", min: 0 });
  const shapeValues = select([["", "As those of the pattern"], ["linear", "Linear"], ["srgb", "sRGB"]], typeof earlier?.transfer === "string" ? earlier.transfer : "", { id: "table-shape-values" });
  const distances = GEOMETRY.map(([name]) => number({ id: `table-${name.replace("_", "-")}`, value: given.geometry?.[name] ?? "", min: 0 }));
  const baseline = [0, 1].map((k) => number({ id: `table-baseline-${"xy"[k]}`, value: given.geometry?.baseline_mm?.[k] ?? "" }));
  const warp = number({ id: "table-warp", value: given.warp ?? 1, min: 1, max: 9, step: 2 });
  const error = number({ id: "table-error", value: 100 * (given.max_error ?? 0.01), min: 0 });
  const earlierSums = typeof given.method === "object" ? Object.entries(given.method)[0] : [given.method ?? "auto", ""];
  const sums = select(SUMS, earlierSums[0], { id: "table-sums", onchange: paint });
  const step = number({ id: "table-step", value: earlierSums[1] || 1, min: 0 });
  const stepField = field("So many", step);
  function paint() {
    stepField.hidden = sums.value === "auto";
  }
  paint();
  const element = h("div", { class: "fields" },
    field("Light", light), field("Observer", observer),
    field("Wavelength of the photograph (nm)", wavelength, { hint: "Empty: as the session says" }),
    field("Wavelength of green (nm)", others[0], { hint: "With the next, and red's above, for a colour photograph in three bands" }), field("Wavelength of blue (nm)", others[1]),
    field("Channel of a colour photograph", channel, { hint: "For one wavelength" }),
    field("Half vector per pixel", scale, { hint: "2 × pixel size ÷ distance. Empty: from the session's geometry" }),
    field("Size (entries)", size), field("Extent", extent, { hint: "Empty: as far as was measured" }),
    field("Exponent", exponent, { hint: "4 is exact for shallow gratings" }),
    field("Zero order, from the left (pixels)", center[0], { hint: "Empty: the brightest lobe" }), field("Zero order, from the top (pixels)", center[1]),
    GEOMETRY.map(([, label], k) => field(label, distances[k], k === 0 ? { hint: "With the next four in place of the half vector per pixel, for what is near" } : {})),
    field("Flash right of the camera (mm)", baseline[0]), field("Flash above the camera (mm)", baseline[1]),
    field("Warp of the entries", warp, { hint: "Odd; above 1 they lie closer in the middle" }),
    field("Error at the rim that is asked for (%)", error), field("Sums", sums), stepField,
    !planned && [
      field("Photograph of a light that is no point", shape, { hint: earlier ? "Empty: the same light as before" : "Its mirror image, or exposures of that. Empty: a point" }),
      field("Half vector per pixel of the light", shapeScale, { hint: "Empty: that of the pattern" }), field("Values of the light", shapeValues)]);
  // Whatever has no field stays as it was; empty fields are left to the service.
  const values = () => ({ scale, size, extent, exponent });
  return {
    element,
    options: () => {
      /** @type {Record<string, any>} */
      const options = { ...given, illuminant: light.value, observer: observer.value };
      for (const [name, input] of Object.entries(values())) {
        if (Number.isFinite(input.valueAsNumber)) options[name] = input.valueAsNumber;
        else delete options[name];
      }
      const told = [wavelength, ...others].map((input) => input.valueAsNumber);
      // A band that is missing is for the service to refuse.
      if (told.slice(1).some(Number.isFinite)) options.wavelength_nm = told.map((nm) => (Number.isFinite(nm) ? nm : 0));
      else if (Number.isFinite(told[0])) options.wavelength_nm = told[0];
      else delete options.wavelength_nm;
      if (channel.value) options.channel = channel.value;
      else delete options.channel;
      const place = center.map((input) => input.valueAsNumber);
      if (place.every(Number.isFinite)) options.center = place;
      else delete options.center;
      const lengths = distances.map((input) => input.valueAsNumber);
      // A distance that is missing is for the service to refuse.
      if (lengths.some(Number.isFinite)) {
        options.geometry = Object.fromEntries(GEOMETRY.map(([name], k) => [name, Number.isFinite(lengths[k]) ? lengths[k] : 0]));
        options.geometry.baseline_mm = baseline.map((input) => input.valueAsNumber || 0);
      } else if (given.geometry?.camera_mm !== undefined || "scale" in options) delete options.geometry; // A calibrated one has no fields here, and stays until a scale is given.
      options.warp = warp.valueAsNumber || 1;
      options.max_error = error.valueAsNumber / 100;
      options.method = sums.value === "auto" ? "auto" : { [sums.value]: step.valueAsNumber };
      return options;
    },
    inputs: async (signal) => {
      const chosen = shape.files ?? [];
      if (chosen.length === 0 && !earlier) return {};
      const light = { ...earlier };
      if (chosen.length > 0) {
        const form = new FormData();
        form.append("kind", "photographs");
        for (const file of chosen) form.append("file", file, file.name);
        light.upload = (await (await send("/uploads", { method: "POST", body: form, signal })).json()).id;
        delete light.center;
      }
      light.scale = Number.isFinite(shapeScale.valueAsNumber) ? shapeScale.valueAsNumber : null;
      // An exponent has no place in the list; it stays.
      light.transfer = shapeValues.value || (typeof earlier?.transfer === "object" ? earlier.transfer : null);
      return { light };
    },
  };
}
