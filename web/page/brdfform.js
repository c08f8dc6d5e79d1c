// The options of a BRDF map: scale of the height field, light, material, method.

import { field, h, number, select } from "./dom.js";
import { LIGHTS } from "./tableform.js";

const METHODS = [["auto", "Auto (cheapest)"], ["chebyshev", "Chebyshev"], ["fft", "FFT"], ["taylor", "Taylor (FLSS)"], ["nmm", "NMM: one period"], ["pq", "PQ"], ["reference", "Direct sums (slow)"]];
const MATERIALS = [["perfect", "All of it"], ...["aluminium", "silver", "gold", "copper", "nickel", "chromium", "silicon"].map((m) => [m, m])];

/** The fields, as an earlier map left them if there is one; `options()` is what the service takes. */
export function brdfFields(given = {}) {
  const { settings = {} } = given;
  const pixel = number({ id: "brdf-pixel", value: given.pixel_um ?? "", min: 0 });
  const range = number({ id: "brdf-range", value: given.range_um ?? "", min: 0 });
  const channel = h("input", { id: "brdf-channel", value: given.channel ?? "", autocomplete: "off" });
  const gaps = number({ id: "brdf-gaps", value: given.fill_gaps ?? "", min: 0, max: 0.5 });
  const theta = number({ id: "brdf-theta", value: settings.light_deg?.[0] ?? 30, min: 0, max: 89 });
  const phi = number({ id: "brdf-phi", value: settings.light_deg?.[1] ?? 0 });
  const light = select(LIGHTS, settings.illuminant ?? "D65", { id: "brdf-light" });
  const material = select(MATERIALS, settings.reflectance ?? "perfect", { id: "brdf-material" });
  const method = select(METHODS, settings.method ?? "auto", { id: "brdf-method" });
  const coherence = number({ id: "brdf-coherence", value: settings.coherence_um ?? 65, min: 1 });
  const error = number({ id: "brdf-error", value: settings.max_error ?? 0.01, min: 0 });
  const size = number({ id: "brdf-size", value: given.size ?? 512, min: 8, max: 4096, step: 1 });
  const level = h("input", { type: "checkbox", id: "brdf-level", checked: given.level ?? false });
  const element = h("div", { class: "stack" }, h("div", { class: "fields" },
    field("Pixel of the height field (µm)", pixel, { hint: "Empty: as the file says" }), field("White above black (µm)", range, { hint: "Empty: as the file says" }),
    field("Channel of the height field", channel, { hint: "Of a file with several: its name, or its number from 1. Empty: the first channel of heights" }),
    field("Share of gaps to fill", gaps, { hint: "By interpolation, up to 0.5. Empty: gaps are refused" }),
    field("Light from the normal (°)", theta), field("Its azimuth (°)", phi, { hint: "Anticlockwise from the right" }),
    field("Light", light), field("Reflects", material), field("Coherence (µm)", coherence, { hint: "Four standard deviations; sunlight 65" }),
    field("Error asked for", error, { hint: "Of lobes with a thousandth of the light" }), field("Size (pixels)", size), field("Method", method)),
    h("label", { class: "check" }, level, h("span", {}, "Take the plane that fits best away")));
  const value = (input) => (Number.isFinite(input.valueAsNumber) ? input.valueAsNumber : null);
  return {
    element,
    options: () => ({
      ...given, pixel_um: value(pixel), range_um: value(range), channel: channel.value.trim() || null, fill_gaps: value(gaps), level: level.checked, size: value(size) ?? 512,
      settings: {
        ...settings, light_deg: [value(theta) ?? 0, value(phi) ?? 0], illuminant: light.value, reflectance: material.value, method: method.value,
        coherence_um: value(coherence) ?? 65, max_error: value(error) ?? 0.01,
      },
    }),
  };
}
