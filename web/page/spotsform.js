// The options of a spot scan: wavelength, panel, periods.

import { field, h, number } from "./dom.js";

/** The fields, as an earlier scan left them if there is one; `options()` is what the service takes. */
export function spotsFields(given = {}) {
  const wavelength = number({ id: "spots-wavelength", value: given.wavelength_nm ?? "", min: 200, max: 2000 });
  const sigma = number({ id: "spots-sigma", value: given.wavelength_sigma_nm ?? "", min: 0, max: 100 });
  const panel = [0, 1].map((k) => number({ id: `spots-panel-${"wh"[k]}`, value: given.panel_mm?.[k] ?? "", min: 1 }));
  const periods = [0, 1].map((k) => number({ id: `spots-period-${k}`, value: given.periods_um?.[k] ?? [0.7, 4][k], min: 0.2, max: 1000 }));
  const aperture = number({ id: "spots-aperture", value: given.aperture_mm ?? "", min: 0 });
  const mirror = number({ id: "spots-mirror", value: given.mirror_deg ?? 0.2, min: 0.001, max: 5 });
  const element = h("div", { class: "fields" },
    field("Wavelength (nm)", wavelength, { hint: "Empty: as the session says" }),
    field("It may be off by (nm)", sigma, { hint: "1 nm is 0.2 % of all periods" }),
    field("Panel, width (mm)", panel[0], { hint: "Empty: as the session says" }), field("Panel, height (mm)", panel[1]),
    field("Shortest period (µm)", periods[0]), field("Longest period (µm)", periods[1]),
    field("Aperture of the camera (mm)", aperture, { hint: "Empty: found" }),
    field("Tilt of the surface (°)", mirror, { hint: "One standard deviation" }));
  return {
    element,
    options: () => {
      const options = { ...given, periods_um: periods.map((input) => input.valueAsNumber), mirror_deg: mirror.valueAsNumber };
      const set = (name, value, known) => { if (known) options[name] = value; else delete options[name]; };
      for (const [name, input] of Object.entries({ wavelength_nm: wavelength, wavelength_sigma_nm: sigma, aperture_mm: aperture })) {
        set(name, input.valueAsNumber, Number.isFinite(input.valueAsNumber));
      }
      const size = panel.map((input) => input.valueAsNumber);
      set("panel_mm", size, size.every(Number.isFinite));
      return options;
    },
  };
}
