// #/upload: photographs taken elsewhere → a map of their angles, one merged photograph, a table, a grating's lines, the light of a height field, a calibration, other maps.

import { post, send } from "./api.js";
import { field, h, number, panel, say, select } from "./dom.js";
import { complain, problemMessage } from "./feedback.js";
import { bytes } from "./format.js";
import { describedBy, dropped, flattened, operationOf } from "./described.js";
import { flashForm } from "./flashform.js";
import { byRoomLight, flashLights } from "./flashlights.js";
import { lutForm } from "./lutform.js";
import { operationForm, titleOf } from "./operationform.js";

/** Endings of photographs and height fields; others are left out of a folder that is dropped. */
const ENDINGS = "png tif tiff jpg jpeg exr webp fits fit fts npy dng cr2 cr3 nef nrw arw raf orf rw2 pef bmp hdr txt asc csv dat tsv xyz gwy ibw x3p spm sdf nid ezd grd bcr bcrf 000 001 002 003 004 005 006 007 008 009".split(" ").map((ending) => `.${ending}`);

/** Polarization sensors by name, as `nacre import --layout` knows them; others are described by their angles. */
const SENSORS = [
  ["sony", "Sony IMX250MZR, IMX253MZR, IMX264MZR"], ["sony-colour", "Sony IMX250MYR, IMX253MYR, IMX264MYR (colour)"],
  ["lucid", "Lucid Phoenix, Triton (-P)"], ["lucid-colour", "Lucid Phoenix, Triton (-Q, colour)"],
  ["flir", "FLIR Blackfly S (S5P)"], ["flir-colour", "FLIR Blackfly S (S5PC, colour)"],
  ["4d-v1", "4D PolarCam, version 1"], ["4d-v2", "4D PolarCam, version 2"], ["4d-u4", "4D PolarCam U4"], ["", "Another one"],
];
const FILTERS = [["", "None: a monochrome sensor"], ...["rggb", "bggr", "grbg", "gbrg"].map((order) => [order, order.toUpperCase()])];

/** Whether a file has one of them. */
function likely(name) {
  return ENDINGS.some((ending) => name.toLowerCase().endsWith(ending));
}

/** Operations of uploaded photographs, height fields and maps. */
const OFFERED = ["polarization", "hdr", "stack", "lut", "bokeh", "flash", "spots", "foil", "brdf", "calibrate", "map", "factor", "synthesize"];

/**
 * Shows the form until the signal fires.
 * @param {HTMLElement} main
 * @param {Visit} visit
 */
export async function uploadPage(main, { signal }) {
  let photographs = [];
  let picked = null;
  /** The frames.json and geometry.json among the files. */
  let described = { frames: /** @type {any} */ (null), geometry: /** @type {any} */ (null) };
  const input = h("input", { type: "file", id: "photographs", multiple: true, accept: [...ENDINGS, ".json"].join(","), onchange: () => add([...(input.files ?? [])]) });
  const folder = h("input", { type: "file", id: "photographs-folder", webkitdirectory: true, onchange: () => {
    const files = [...(folder.files ?? [])];
    call(files[0]?.webkitRelativePath.split("/")[0]);
    add(files);
  } });
  const skipped = h("p", { role: "status", "aria-live": "polite", class: "soft" });
  const body = h("tbody");
  const listing = h("table", { hidden: true }, h("thead", {}, h("tr", {}, ["Photograph", "Size", "Analyser (°)", ""].map((t) => h("th", { scope: "col", class: t === "Size" && "number" }, t)))), body);
  const transfer = select([["", "As the files state, or as usual for their type"], ["linear", "Linear, as from measuring cameras"], ["srgb", "sRGB, as in JPEG and most pictures"]], "", { id: "transfer" });
  const channel = select([["", "Grey, or green of colour files and sensors"], ["r", "Red"], ["g", "Green"], ["b", "Blue"], ["luminance", "Mean of a colour sensor's filters"]], "", { id: "channel" });
  const light = select([["", "Unknown"], ["circular_panel", "A display behind a quarter-wave retarder"], ["linear_panel", "A bare LCD"], ["other", "Other light"]], "", { id: "illumination" });
  const source = select([["analyser", "A rotating analyser"], ["sensor", "A polarization sensor (raw frames)"]], "analyser", { id: "source", onchange: paint });
  const known = select(SENSORS, "sony", { id: "sensor", onchange: paint });
  const layout = h("input", { id: "layout", value: "90, 45, 135, 0", onchange: judge });
  const layoutField = field("Angles of a 2 × 2 block (°)", layout, { hint: "Top left, top right, bottom left, bottom right; the data sheet has them" });
  const filters = select(FILTERS, "", { id: "filters" });
  const filtersField = field("Colour filters", filters, { hint: "Each covers 2 × 2 polarizers" });
  const sensor = h("div", { class: "fields" }, field("Sensor", known), layoutField, filtersField);
  let refusal = "";
  const method = select(OFFERED.map((name) => [name, titleOf(name)]), "polarization", { id: "method", onchange: paint });
  const flash = flashForm();
  const lut = lutForm();
  const lights = flashLights(() => judge());
  let called = "";
  const forms = Object.fromEntries(OFFERED.map((name) => [name, name === "flash" ? flash : name === "lut" ? lut : operationForm(name)]));
  const values = field("Values", transfer);
  const angled = h("div", { class: "stack" }, field("Polarization by", source), sensor, field("Illumination", light, { hint: "Under a display behind a quarter-wave retarder, gratings get orientations; else plain polarimetry" }), field("Channel", channel));
  const name = h("input", { id: "upload-name", maxlength: 200, placeholder: "From the names of the files", autocomplete: "off" });
  const about = h("p", { class: "soft" }, "Exposure times are read from the photographs (Exif); the camera's response is recovered from them where they have 8 bits.");
  const told = h("p", { class: "message", "data-tone": "good", id: "described", hidden: true });
  const lit = h("div", { class: "stack" }, h("h3", {}, "Where the flash was"), h("p", { class: "soft" }, "Millimetres from the middle of the sheet. Without positions give the height of the light below; the highlights show the rest."), lights.element);
  const problems = h("div", { role: "status", "aria-live": "polite" });
  const start = h("button", { type: "button", class: "primary", id: "upload-start", disabled: true, onclick: begin }, "Upload and reconstruct");
  const progress = h("p", { role: "status", "aria-live": "polite", class: "soft" });
  const drop = h("div", { class: "drop", ondragover: (e) => e.preventDefault(), ondrop: async (e) => {
    e.preventDefault();
    const { files, folder: from } = await dropped(e.dataTransfer);
    call(from);
    add(files);
  } },
    field("Photographs (PNG, TIFF, JPEG, EXR), or a height field (BMP, text and files of AFMs as well)", input, { hint: "Or drop them here. Angles are read from names such as 045.png." }),
    field("Or all of a folder", folder, { hint: "Folders inside it are left out, as nacre import does." }), skipped);
  main.append(h("div", { class: "head" }, h("h1", { class: "grow" }, "Upload photographs"), start),
    h("div", { class: "columns planning" },
      panel("Photographs", null, h("div", { class: "stack" }, drop, h("div", { class: "scroll tall" }, listing))),
      h("div", { class: "stack" },
        panel("Reconstruction", null, h("div", { class: "stack" }, field("What to make of them", method), field("Name", name, { hint: "Of the sample; results are called by it" }), told, values, angled, lit, Object.values(forms).map((form) => form.element), about, problems, progress)))));

  for (const form of Object.values(forms)) {
    for (const event of ["input", "change"]) form.element.addEventListener(event, judge);
  }
  paint();

  /** Takes the name of a folder, unless the user gave one. */
  function call(from) {
    if (from && (!name.value || name.value === called)) called = name.value = from;
  }

  async function add(/** @type {File[]} */ files) {
    input.value = folder.value = "";
    const { photographs: taken, frames, geometry, problems: unread } = await describedBy(files);
    described = { frames: frames ?? described.frames, geometry: geometry ?? described.geometry };
    if (operationOf(frames)) method.value = operationOf(frames);
    const names = new Set(photographs.map((p) => p.file.name));
    const left = [];
    for (const file of taken) {
      // "folder/name" of a folder that was chosen, or empty.
      const inner = (file.webkitRelativePath ?? "").split("/").length > 2;
      if (inner || !likely(file.name)) left.push(inner ? file.webkitRelativePath : file.name);
      else if (!names.has(file.name)) photographs.push({ file, deg: null });
    }
    const more = left.length > 5 ? ` and ${left.length - 5} more` : "";
    const outside = left.length ? `Left out, as no photographs of the folder: ${left.slice(0, 5).join(", ")}${more}.` : "";
    say(skipped, [outside, ...unread.map((problem) => `${problem}.`)].filter(Boolean).join(" "));
    photographs.sort((a, b) => a.file.name.localeCompare(b.file.name));
    paint();
    readAngles();
  }

  /** Has the service read the angles in the names, by the same rules as everywhere; all names together tell what is a sign or a decimal. */
  async function readAngles() {
    const asked = photographs.slice();
    if (!polarizedBy("analyser") || !asked.length || asked.every((p) => p.deg !== null)) return;
    refusal = "";
    try {
      const { angles_deg } = await post("/uploads/angles", { names: asked.map((p) => p.file.name) });
      asked.forEach((photograph, k) => (photograph.deg ??= angles_deg[k]));
      photographs.sort((a, b) => (a.deg ?? Infinity) - (b.deg ?? Infinity));
    } catch (problem) {
      if (problem.name === "AbortError") return;
      refusal = asked.length === 1 ? "" : (problem.message ?? "");
    }
    paint();
  }

  /** Whether polarization is asked for, and the photographs were taken by this. */
  function polarizedBy(how) {
    return method.value === "polarization" && source.value === how;
  }

  function paint() {
    const polarized = method.value === "polarization";
    angled.hidden = !polarized;
    sensor.hidden = source.value !== "sensor";
    layoutField.hidden = filtersField.hidden = known.value !== "";
    values.hidden = described.frames !== null || (!polarized && method.value !== "flash" && !alone());
    for (const [name, form] of Object.entries(forms)) form.element.hidden = name !== method.value;
    about.hidden = !["hdr", "lut", "bokeh", "foil"].includes(method.value) || photographs.length < 2;
    angled.hidden ||= described.frames !== null;
    lit.hidden = method.value !== "flash" || described.frames !== null || photographs.length === 0;
    lights.show(photographs.map((p) => p.file.name));
    told.hidden = !described.frames && !described.geometry;
    say(told, `${Object.entries(described).filter(([, value]) => value).map(([key]) => `${key}.json`).join(" and ")} found: what it says need not be entered.`);
    if (method.value === "flash") pickable(flash);
    if (method.value === "lut") pickable(lut);
    listing.hidden = photographs.length === 0;
    listing.querySelectorAll("th")[2].hidden = !polarizedBy("analyser");
    body.replaceChildren(...photographs.map((photograph) => h("tr", {},
      h("td", {}, photograph.file.name), h("td", { class: "number" }, bytes(photograph.file.size)),
      h("td", { hidden: !polarizedBy("analyser") }, number({ value: photograph.deg ?? "", "aria-label": `Analyser angle of ${photograph.file.name}`, oninput: (e) => {
        photograph.deg = Number.isFinite(e.target.valueAsNumber) ? e.target.valueAsNumber : null;
        judge();
      } })),
      h("td", {}, h("button", { type: "button", class: "quiet icon", "aria-label": `Remove ${photograph.file.name}`, onclick: () => {
        photographs = photographs.filter((p) => p !== photograph);
        paint();
      } }, "✕")))));
    judge();
  }

  /** Shows the photograph to pick in: that by room light if its name says so, else the first. */
  function pickable(form) {
    const file = (photographs.find((p) => byRoomLight(p.file.name)) ?? photographs[0])?.file ?? null;
    if (file === picked?.file && form === picked?.form) return;
    picked = { file, form };
    form.show(file);
  }

  /** Whether the values of one photograph are taken as they are, without others to merge it with. */
  function alone() {
    return ["lut", "bokeh"].includes(method.value) && photographs.length === 1 && !/\.exr$/i.test(photographs[0].file.name);
  }

  function judge() {
    if (method.value !== "polarization" || described.frames) return show(missing());
    if (source.value === "sensor") {
      const right = known.value !== "" || blockAngles().length === 4;
      return show(right ? [] : ["The block needs four angles, such as 90, 45, 135, 0."]);
    }
    const unknown = photographs.filter((p) => p.deg === null).length;
    const distinct = new Set(photographs.map((p) => (((p.deg ?? 0) % 180) + 180) % 180)).size;
    const wrong = [
      refusal,
      photographs.length === 1 && "Is this one raw frame of a polarization sensor? Then choose that under “Polarization by”.",
      unknown && `${unknown} of the photographs ${unknown === 1 ? "has" : "have"} no angle.`,
      photographs.length > 0 && !unknown && distinct < 3 && "At least three different angles within the half turn are needed.",
    ].filter(Boolean);
    show(/** @type {string[]} */ (wrong));
  }

  /** Lists what is missing; without photographs nothing is. */
  function show(/** @type {string[]} */ wrong) {
    const listed = photographs.length ? wrong : [];
    problems.replaceChildren(...(listed.length ? [h("ul", { class: "problems" }, listed.map((w) => h("li", {}, w)))] : []));
    start.disabled = photographs.length === 0 || listed.length > 0;
  }

  /** What the chosen operation needs to know and nobody has said. */
  function missing() {
    const options = forms[method.value].options();
    const frames = described.frames ?? (method.value === "flash" && flash.frames() ? {} : null);
    const names = photographs.map((p) => p.file.name);
    const wavelength = options.wavelength_nm || described.frames?.wavelength_nm || described.geometry?.wavelength_nm || (frames && !described.frames);
    const geometry = options.geometry || described.geometry || described.frames?.geometry;
    const needs = {
      flash: [
        !wavelength && "Wavelength: that of the filter.",
        !options.size_mm && !options.reference_px && "Size: width and height of the sheet, or pick one tile.",
        !geometry && !options.camera_mm && "Camera: its height above the sheet, or a calibration.",
        !frames && !options.light_height_mm && !lights.complete(names) && "Light: the position of every flash, or the height of the light.",
      ],
      lut: [
        !wavelength && "Wavelength: that of the filter, or three for a colour photograph.",
        !options.scale && !geometry && "Scale: the half vector per pixel, or a geometry with the distances of camera and flash.",
      ],
      spots: [!described.frames && "frames.json: add it to the photographs. It says which fringes each one shows."],
    }[method.value] ?? [];
    return /** @type {string[]} */ (needs.filter(Boolean));
  }

  /** What the values of such files usually are. */
  const usualTransfer = () => (/\.jpe?g$/i.test(photographs[0].file.name) ? "srgb" : "linear");

  /** Angles of the sensor's block; fewer than four where one is no number. */
  function blockAngles() {
    return layout.value.split(/[,;\s]+/).filter(Boolean).map(Number).filter(Number.isFinite);
  }

  /** Polarizers and colours of the sensor, as `frames.json` has them. */
  function filtersOnPixels() {
    if (known.value) return { layout: known.value };
    const [a, b, c, d] = blockAngles();
    return { layout: [[a, b], [c, d]], ...(filters.value && { colour: filters.value }) };
  }

  async function begin() {
    start.disabled = true;
    const total = photographs.reduce((sum, p) => sum + p.file.size, 0);
    say(progress, `Uploading ${bytes(total)}…`);
    /** @type {Record<string, any>} */
    const description = source.value === "sensor"
      ? { kind: "division_of_focal_plane", ...filtersOnPixels(), frames: photographs.map((p) => ({ file: p.file.name })) }
      : { kind: "polarization", frames: photographs.map((p) => ({ file: p.file.name, analyser_deg: p.deg })) };
    if (transfer.value) description.transfer = transfer.value;
    if (light.value) description.illumination = light.value;
    if (channel.value) description.channel = channel.value;
    const form = new FormData();
    const polarized = method.value === "polarization";
    const json = (/** @type {any} */ value) => new Blob([JSON.stringify(value)], { type: "application/json" });
    form.append("kind", { polarization: "polarization", brdf: "surface", map: "maps", factor: "table", synthesize: "table" }[method.value] ?? "photographs");
    if (name.value.trim()) form.append("name", name.value.trim());
    if (described.frames) form.append("frames", json(flattened(described.frames)), "frames.json");
    else if (polarized) form.append("frames", json(description), "frames.json");
    else if (method.value === "flash") form.append("frames", flash.frames() ?? json({ kind: "flash", transfer: transfer.value || usualTransfer(), frames: lights.frames(photographs.map((p) => p.file.name)) }), "frames.json");
    for (const { file } of photographs) form.append("file", file, file.name);
    try {
      const upload = await (await send("/uploads", { method: "POST", body: form, signal })).json();
      const options = forms[method.value].options();
      if (alone()) options.transfer ??= transfer.value || usualTransfer();
      if (described.geometry && ["flash", "spots", "lut", "foil"].includes(method.value)) options.geometry ??= described.geometry;
      const others = (await forms[method.value].inputs?.(signal)) ?? {};
      const job = await post(`/operations/${method.value}`, { session: null, upload: upload.id, options, ...others });
      location.hash = `#/result/${job.id}`;
    } catch (problem) {
      if (problem.name === "AbortError") return;
      problems.replaceChildren(problemMessage(problem));
      complain(problem);
      start.disabled = false;
    }
    say(progress, "");
  }
}
