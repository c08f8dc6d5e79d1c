// #/calibrate/light: where the light is, from its images in a mirror, and its wavelength, from what is known of lamp, filter and camera.

import { field, h, number, say, select } from "./dom.js";
import { fixed, plain } from "./format.js";
import { guided, photographs, startOf, stepOf } from "./wizard.js";

const NAMES = { E: "E (equal energy)", A: "A (tungsten)", "A-inverse": "Inverse of A", D65: "D65 (daylight)" };
const LIGHTS = ["E", "A", "A-inverse", "D65", ...Array.from({ length: 12 }, (_, i) => `FL${i + 1}`), "LED-B1", "LED-B3"].map((name) => [name, NAMES[name] ?? name]);

/** All steps. */
export function lightWizard() {
  const camera = cameraStep();
  const place = lightStep(camera);
  const color = wavelengthStep();
  return guided([camera, place, color, computeStep(camera, place, color)]);
}

const judge = (/** @type {{ element: HTMLElement }} */ step) => step.element.dispatchEvent(new Event("judge"));

function cameraStep() {
  /** @type {any} */
  let geometry = null;
  let wrong = "";
  const input = h("input", { type: "file", id: "light-geometry", accept: ".json", onchange: read });
  async function read() {
    [geometry, wrong] = [null, ""];
    const file = input.files?.[0];
    if (file) {
      try {
        geometry = JSON.parse(await file.text());
        if (!geometry?.camera?.focal_px) wrong = `${file.name} is no geometry.json: choose the file that a calibration wrote`;
        else if (geometry.relative) wrong = `${file.name} was made without a calibrated camera: calibrate camera and sample first`;
      } catch {
        wrong = `${file.name} is no JSON: choose the geometry.json that a calibration wrote`;
      }
      if (wrong) geometry = null;
    }
    judge(step);
  }
  const size = () => (geometry?.image_px ? geometry.image_px.join(" × ") : "");
  const step = stepOf("1. The camera", "the geometry.json of this camera, which has not been moved since", () => {
    if (!geometry) return [false, wrong || "geometry.json is not chosen yet"];
    return [true, `focal length ${fixed(geometry.camera.focal_px[0], 0)} pixels${size() && `, pictures of ${size()}`}`];
  },
  h("ol", { class: "todo" },
    h("li", {}, "Calibrate ", h("a", { href: "#/calibrate" }, "camera and sample"), " first, and keep its geometry.json."),
    h("li", {}, "Choose that file. All that it knows is kept; light and wavelength are added.")),
  field("Calibration (geometry.json)", input));
  return { ...step, geometry: () => geometry, size };
}

/** @param {{ size: () => string, element: HTMLElement }} camera */
function lightStep(camera) {
  const how = select([["mirror", "Photographs of it in a mirror"], ["keep", "It is known already, or not needed"]], "mirror", { id: "light-how" });
  /** @type {WeakMap<File, HTMLInputElement>} */
  const heights = new WeakMap();
  const taken = photographs("light-photographs", (file) => {
    const height = number({ value: 0, min: -1000, max: 10000, "aria-label": `Height of the mirror in ${file.name}, in mm` });
    heights.set(file, height);
    return h("label", { class: "height" }, "Mirror (mm) ", height);
  });
  const height = number({ id: "light-height", value: "", min: 0 });
  const sigma = number({ id: "light-height-sigma", value: 5, min: 0 });
  const byMirror = h("div", { class: "stack" },
    h("ol", { class: "todo" },
      h("li", {}, "Lay a flat mirror where the sample lies: one silvered on its front, or a polished plate. Switch the light on as for measurements, and darken the room."),
      h("li", {}, "Shorten the exposure until the light in the mirror is the only bright thing, and take a photograph."),
      h("li", {}, "Raise the mirror on blocks of a known height, by a third of the light's distance if you can, and take another. More heights tell more."),
      h("li", {}, "Say for each photograph how high the mirror lay above the sample's surface. One photograph is enough where a ruler says how high the light is.")),
    taken.element,
    h("div", { class: "fields" }, field("Light above the sample (mm)", height, { hint: "If a ruler says it" }), field("Off by about (mm)", sigma, { hint: "How well the ruler does" })));
  const step = stepOf("2. Where the light is", "two photographs with the mirror at different heights, or one and the light's own height", () => {
    byMirror.hidden = how.value !== "mirror";
    if (how.value !== "mirror") return [true, "stays as it is"];
    const files = taken.files();
    const unlike = taken.unlike(camera.size());
    if (unlike) return [false, unlike];
    const at = files.map((file) => heights.get(file)?.valueAsNumber ?? NaN);
    if (at.some((mm) => !Number.isFinite(mm))) return [false, "a mirror's height is missing"];
    const ruled = height.valueAsNumber > 0;
    if (ruled && !(sigma.valueAsNumber > 0)) return [false, "how far the light's height may be off is missing"];
    if (!files.length) return [false, "no photograph yet"];
    if (ruled) return [true, `${files.length} ${files.length === 1 ? "photograph" : "photographs"} and a ruler`];
    if (files.length < 2) return [false, "1 of 2 photographs, or say the light's height"];
    return Math.max(...at) > Math.min(...at) ? [true, `${files.length} photographs`] : [false, "the mirror's heights are alike: say how high it lay in each"];
  }, field("How its place is known", how), byMirror);
  taken.element.addEventListener("photographs", () => judge(step));
  camera.element.addEventListener("judge", () => judge(step));
  step.element.addEventListener("input", () => judge(step));
  const used = () => (how.value === "mirror" ? taken.files() : []);
  return {
    ...step, files: used,
    options: () => (used().length ? {
      highlights: used().map((file) => ({ file: file.name, height_mm: heights.get(file)?.valueAsNumber ?? 0 })),
      ...(height.valueAsNumber > 0 ? { light_height_mm: [height.valueAsNumber, sigma.valueAsNumber] } : {}),
    } : {}),
  };
}

/**
 * Wavelengths and values of a CSV file, or a sentence that says what is wrong with it.
 * @param {File} file
 * @returns {Promise<[number, number][] | string>}
 */
async function spectrum(file) {
  if (file.size > 1 << 20) return `${file.name} is larger than 1 MB: no spectrum is`;
  const rows = (await file.text()).split(/\r?\n/).map((line) => line.split(/[,;\t]/).map((v) => v.trim())).filter((row) => row.some(Boolean));
  const numbers = rows.map(([nm, value]) => [Number(nm || NaN), Number(value || NaN)]);
  // One line of names may come first.
  const found = Number.isFinite(numbers[0]?.[0]) ? numbers : numbers.slice(1);
  const odd = found.findIndex((row) => !row.every(Number.isFinite));
  if (odd >= 0) return `${file.name} has no two numbers in row ${odd + 1 + rows.length - found.length}: give rows of wavelength in nm and value`;
  if (found.length < 2) return `${file.name} has ${found.length} rows: a spectrum has at least two`;
  return /** @type {[number, number][]} */ (found);
}

function wavelengthStep() {
  const how = select([["known", "I know it"], ["spectra", "From spectra of filter or camera"], ["keep", "It is known already, or not needed"]], "known", { id: "color-how" });
  const nm = number({ id: "color-nm", value: "", min: 200, max: 2000 });
  const off = number({ id: "color-sigma", value: 0.5, min: 0, max: 200 });
  const lamp = select([["", "I do not know: taken for white"], ...LIGHTS], "", { id: "color-lamp" });
  /** @type {Record<string, [number, number][] | null>} */
  const spectra = { filter: null, response: null };
  let wrong = "";
  const file = (/** @type {string} */ key) => {
    const input = h("input", { type: "file", id: `color-${key}`, accept: ".csv,.txt", onchange: async () => {
      const chosen = input.files?.[0];
      const found = chosen ? await spectrum(chosen) : null;
      wrong = typeof found === "string" ? found : "";
      spectra[key] = typeof found === "string" ? null : found;
      judge(step);
    } });
    return input;
  };
  const known = h("div", { class: "fields" }, field("Wavelength (nm)", nm, { hint: "Of a laser, or a filter's centre" }), field("Off by about (nm)", off, { hint: "0.5 is what data sheets are good for" }));
  const bySpectra = h("div", { class: "fields" },
    field("Transmission of the filter (CSV)", file("filter"), { hint: "Rows of nm and value" }), field("Response of the camera's channel (CSV)", file("response"), { hint: "If it is known" }),
    field("Lamp", lamp, { hint: "Unknown counts as uncertainty" }));
  const told = h("p", { class: "soft" });
  const step = stepOf("3. Its wavelength", "known to half a percent: each percent is a percent of every period", () => {
    known.hidden = how.value !== "known";
    bySpectra.hidden = how.value !== "spectra";
    told.hidden = how.value !== "spectra";
    if (how.value === "keep") return [true, "stays as it is"];
    if (how.value === "known") {
      if (!(nm.valueAsNumber >= 200 && nm.valueAsNumber <= 2000)) return [false, "a wavelength of 200 to 2000 nm is missing"];
      return off.valueAsNumber >= 0 ? [true, `${plain(nm.valueAsNumber)} ± ${plain(off.valueAsNumber)} nm`] : [false, "how far it may be off is missing"];
    }
    const given = Object.values(spectra).filter((s) => s !== null);
    if (wrong) return [false, wrong];
    if (!given.length) return [false, "a spectrum of the filter or the camera is missing"];
    const rows = given.reduce((sum, s) => sum + (s?.length ?? 0), 0);
    say(told, `${rows} rows are read. The wavelength is the mean of what passes all of them.`);
    return [true, `${given.length} ${given.length === 1 ? "spectrum" : "spectra"}`];
  },
  h("ol", { class: "todo" },
    h("li", {}, "Say the wavelength that the camera sees of this light: behind a narrow filter its centre."),
    h("li", {}, "Or give the filter's data sheet as a table of wavelength and transmission, and likewise the camera's channel if it has colours.")),
  field("How it is known", how), known, bySpectra, told);
  step.element.addEventListener("input", () => judge(step));
  return {
    ...step,
    options: () => {
      if (how.value === "known") return { wavelength_nm: nm.valueAsNumber, wavelength_sigma_nm: off.valueAsNumber };
      if (how.value === "keep") return {};
      return { ...Object.fromEntries(Object.entries(spectra).filter(([, s]) => s)), ...(lamp.value ? { lamp: lamp.value } : {}) };
    },
  };
}

/**
 * @param {{ geometry: () => object, element: HTMLElement }} camera
 * @param {{ files: () => File[], options: () => object, element: HTMLElement }} place
 * @param {{ options: () => object, element: HTMLElement }} color
 */
function computeStep(camera, place, color) {
  const asked = () => ({ ...place.options(), ...color.options() });
  const start = startOf("light-start", () => ({
    files: place.files().map((file) => ({ file, name: file.name })),
    options: { geometry: camera.geometry(), ...asked() },
  }));
  const step = stepOf("4. Calibrate", "the light's place known to a percent of its distance", () => {
    const something = Object.keys(asked()).length > 0;
    start.hidden = !something;
    return [false, something ? "ready" : "neither light nor wavelength is to be changed: say one of them above"];
  }, start);
  for (const before of [place, color]) for (const what of ["change", "judge"]) before.element.addEventListener(what, () => judge(step));
  return step;
}
