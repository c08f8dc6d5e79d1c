// #/upload: photographs taken elsewhere → a map of their angles, one merged photograph, a table, a grating's lines, the light of a height field, a calibration, other maps.

import { post, send } from "./api.js";
import { boardFields, foilFields, mapFields } from "./assetforms.js";
import { field, h, number, panel, say, select } from "./dom.js";
import { complain, problemMessage } from "./feedback.js";
import { bytes } from "./format.js";
import { optionFields } from "./options.js";
import { bokehFields } from "./bokehform.js";
import { brdfFields } from "./brdfform.js";
import { flashFields } from "./flashform.js";
import { tableFields } from "./tableform.js";

const LIKELY = /\.(png|tiff?|jpe?g|exr|bmp|txt|asc|csv|dat|tsv|xyz|gwy|ibw|x3p|spm|sdf|nid|ezd|grd|bcrf?|00\d)$/i;

/** The angle that a file name tells: the last number in it that can be one. */
function guess(name) {
  const numbers = name.replace(LIKELY, "").match(/-?\d+(\.\d+)?/g) ?? [];
  const fitting = numbers.map(Number).filter((n) => Math.abs(n) <= 360);
  return fitting.length ? fitting.at(-1) : null;
}

/**
 * Shows the form until the signal fires.
 * @param {HTMLElement} main
 * @param {Visit} visit
 */
export async function uploadPage(main, { signal }) {
  let photographs = [];
  let picked = null;
  const input = h("input", { type: "file", id: "photographs", multiple: true, accept: ".png,.tif,.tiff,.jpg,.jpeg,.exr,.bmp,.txt,.asc,.csv,.dat,.tsv,.xyz,.gwy,.ibw,.x3p,.spm,.sdf,.nid,.ezd,.grd,.bcr,.bcrf,.000,.001,.002,.003,.004,.005,.006,.007,.008,.009", onchange: () => add(input.files) });
  const body = h("tbody");
  const listing = h("table", { hidden: true }, h("thead", {}, h("tr", {}, ["Photograph", "Size", "Analyser (°)", ""].map((t) => h("th", { scope: "col", class: t === "Size" && "number" }, t)))), body);
  const transfer = select([["linear", "Linear, as from measuring cameras"], ["srgb", "sRGB, as in JPEG and most pictures"]], "linear", { id: "transfer", onchange: () => (chosen = true) });
  const channel = select([["", "Grey"], ["r", "Red"], ["g", "Green"], ["b", "Blue"]], "", { id: "channel" });
  let chosen = false;
  const method = select([["polarization", "Orientations, from photographs behind an analyser"], ["hdr", "One photograph from several exposures"], ["lut", "A diffraction table, from one photograph in narrow-band light or its exposures"], ["bokeh", "Lines and heights of a grating, from an out-of-focus highlight"], ["flash", "Orientations and periods of tiles, under a flash"], ["foil", "Orientations and periods of a foil's random dots, from one photograph under a flash"], ["brdf", "The light that a surface diffracts, from an image of its heights"], ["calibrate", "A camera, from photographs of a board"], ["map", "Other maps, from orientation.exr and period.exr"]], "polarization", { id: "method", onchange: paint });
  const options = optionFields();
  const forms = { lut: tableFields({ wavelength_nm: 680, scale: 0.002 }), bokeh: bokehFields(), flash: flashFields(), foil: foilFields(), brdf: brdfFields(), calibrate: boardFields(), map: mapFields() };
  const values = field("Values", transfer);
  const angled = h("div", { class: "stack" }, field("Channel", channel, { hint: "Colour files need one" }), options.element);
  const about = h("p", { class: "soft" }, "Exposure times are read from the photographs (Exif); the camera's response is recovered from them where they have 8 bits.");
  const problems = h("div", { role: "status", "aria-live": "polite" });
  const start = h("button", { type: "button", class: "primary", id: "upload-start", disabled: true, onclick: begin }, "Upload and reconstruct");
  const progress = h("p", { role: "status", "aria-live": "polite", class: "soft" });
  const drop = h("div", { class: "drop", ondragover: (e) => e.preventDefault(), ondrop: (e) => { e.preventDefault(); add(e.dataTransfer.files); } },
    field("Photographs (PNG, TIFF, JPEG, EXR), or a height field (BMP, text and files of AFMs as well)", input, { hint: "Or drop them here. Angles are read from names such as 045.png." }));
  main.append(h("div", { class: "head" }, h("h1", { class: "grow" }, "Upload photographs"), start),
    h("div", { class: "columns planning" },
      panel("Photographs", null, h("div", { class: "stack" }, drop, h("div", { class: "scroll tall" }, listing))),
      h("div", { class: "stack" },
        panel("Reconstruction", null, h("div", { class: "stack" }, field("What to make of them", method), values, angled, Object.values(forms).map((form) => form.element), about, problems, progress)))));

  paint();

  function add(files) {
    const names = new Set(photographs.map((p) => p.file.name));
    for (const file of files) if (LIKELY.test(file.name) && !names.has(file.name)) photographs.push({ file, deg: guess(file.name) });
    photographs.sort((a, b) => (a.deg ?? Infinity) - (b.deg ?? Infinity));
    input.value = "";
    if (!chosen && photographs.some((p) => /\.jpe?g$/i.test(p.file.name))) transfer.value = "srgb";
    paint();
  }

  function paint() {
    const polarized = method.value === "polarization";
    angled.hidden = !polarized;
    values.hidden = !polarized && !alone();
    for (const [name, form] of Object.entries(forms)) form.element.hidden = name !== method.value;
    about.hidden = !["hdr", "lut", "bokeh", "foil"].includes(method.value) || photographs.length < 2;
    if (method.value === "flash") pickable();
    listing.hidden = photographs.length === 0;
    listing.querySelectorAll("th")[2].hidden = !polarized;
    body.replaceChildren(...photographs.map((photograph) => h("tr", {},
      h("td", {}, photograph.file.name), h("td", { class: "number" }, bytes(photograph.file.size)),
      h("td", { hidden: !polarized }, number({ value: photograph.deg ?? "", "aria-label": `Analyser angle of ${photograph.file.name}`, oninput: (e) => {
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
  function pickable() {
    const file = (photographs.find((p) => /room/i.test(p.file.name)) ?? photographs[0])?.file ?? null;
    if (file === picked) return;
    picked = file;
    forms.flash.show(file);
  }

  /** Whether the values of one photograph are taken as they are, without others to merge it with. */
  function alone() {
    return ["lut", "bokeh"].includes(method.value) && photographs.length === 1 && !/\.exr$/i.test(photographs[0].file.name);
  }

  function judge() {
    if (method.value !== "polarization") {
      problems.replaceChildren();
      start.disabled = photographs.length === 0;
      return;
    }
    const unknown = photographs.filter((p) => p.deg === null).length;
    const distinct = new Set(photographs.map((p) => (((p.deg ?? 0) % 180) + 180) % 180)).size;
    const wrong = [
      unknown && `${unknown} of the photographs ${unknown === 1 ? "has" : "have"} no angle.`,
      photographs.length > 0 && !unknown && distinct < 3 && "At least three different angles within the half turn are needed.",
    ].filter(Boolean);
    problems.replaceChildren(...(wrong.length ? [h("ul", { class: "problems" }, wrong.map((w) => h("li", {}, w)))] : []));
    start.disabled = photographs.length === 0 || wrong.length > 0;
  }

  async function begin() {
    start.disabled = true;
    const total = photographs.reduce((sum, p) => sum + p.file.size, 0);
    say(progress, `Uploading ${bytes(total)}…`);
    const description = { kind: "polarization", transfer: transfer.value, frames: photographs.map((p) => ({ file: p.file.name, analyser_deg: p.deg })) };
    if (channel.value) description.channel = channel.value;
    const form = new FormData();
    const polarized = method.value === "polarization";
    form.append("kind", { polarization: "polarization", brdf: "surface", map: "maps" }[method.value] ?? "photographs");
    if (polarized) form.append("frames", new Blob([JSON.stringify(description)], { type: "application/json" }), "frames.json");
    const described = method.value === "flash" && forms.flash.frames();
    if (described) form.append("frames", described, "frames.json");
    for (const { file } of photographs) form.append("file", file, file.name);
    try {
      const upload = await (await send("/uploads", { method: "POST", body: form, signal })).json();
      const asked = polarized ? options.request() : { method: method.value };
      if (method.value in forms) asked.options = { ...forms[method.value].options(), ...(alone() ? { transfer: transfer.value } : {}) };
      const others = (await forms[method.value]?.inputs?.(signal)) ?? {};
      const job = await post("/reconstructions", { session: null, upload: upload.id, ...asked, ...others });
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
