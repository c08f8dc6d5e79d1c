// #/render: a scene to start from, your own, or the maps of a result (#/render/ID) → a picture.

import { post, send } from "./api.js";
import { check, field, h, panel, say, segments } from "./dom.js";
import { problemMessage } from "./feedback.js";
import { bytes } from "./format.js";
import { operationForm } from "./operationform.js";

const GALLERY = [
  ["cd", "Compact disc", "Tracks around a hole"], ["phone", "Telephone", "The subpixels of a screen"], ["tv", "Television", "Coarser subpixels, one way"],
  ["star-paper", "Star paper", "Polygons and stars of twelve orientations"], ["kinematic-tile", "Kinematic tile", "Light runs around when it is tilted"],
  ["logo", "Logo", "Letters on rays"], ["emblem", "Emblem", "A shield with a star"], ["spiral-foil", "Spiral foil", "Random dots"],
  ["rolled", "Rolled sheet", "Star paper around a cylinder"], ["snake", "Snake", "A mesh whose scales diffract"],
];
const FILES = ".toml,.exr,.hdr,.png,.tif,.tiff,.jpg,.jpeg,.bmp,.obj,.ply,.gltf,.glb,.bin,.csv,.txt,.asc,.dat";
const ABOUT = {
  gallery: "Measured surfaces are not needed: their maps are made by formulas.",
  files: "One scene (TOML) and every file that it names: maps, tables, meshes, environments. They lie side by side, so that the scene gives plain names.",
  result: "Orientations, periods or a table of the result on a sheet under three small lights; or in a scene of your own, beside which they lie as orientation.exr, period.exr and lut.exr.",
};

/**
 * Shows the form until the signal fires; `id` is that of a result whose maps are to be seen.
 * @param {HTMLElement} main
 * @param {Visit} visit
 */
export async function renderPage(main, { id, signal }) {
  let from = id ? "result" : "gallery";
  let files = [];
  const about = h("p", { class: "soft" });
  const radios = GALLERY.map(([name], k) => h("input", { type: "radio", name: "gallery", value: name, checked: k === 0 }));
  const scenes = h("div", { class: "kinds" }, GALLERY.map(([, title, hint], k) => h("label", { class: "kind" }, radios[k], h("span", {}, title, h("small", {}, hint)))));
  const room = check("In a room, not under small lights", { id: "render-room" });
  const start = h("button", { type: "button", class: "primary", id: "render-start", onclick: begin }, "Render");
  const gallery = h("div", { class: "stack" }, scenes, room);
  const input = h("input", { type: "file", id: "scene-files", multiple: true, accept: FILES, onchange: () => add(input.files) });
  const body = h("tbody");
  const listing = h("table", {}, h("thead", {}, h("tr", {}, h("th", { scope: "col" }, "File"), h("th", { scope: "col", class: "number" }, "Size"), h("th", { scope: "col" }))), body);
  const own = h("div", { class: "stack" }, h("div", { class: "drop", ondragover: (e) => e.preventDefault(), ondrop: (e) => { e.preventDefault(); add(e.dataTransfer.files); } },
    field("The scene and its files", input, { hint: "Or drop them here. On the command line, nacre schema scene says what a scene may hold." })), h("div", { class: "scroll tall" }, listing));
  const options = operationForm("render");
  const problems = h("div", { role: "status", "aria-live": "polite" });
  const progress = h("p", { role: "status", "aria-live": "polite", class: "soft" });
  const choices = [...(id ? [["result", "Maps of the result"]] : []), ["gallery", "To start from"], ["files", "Your own"]];
  main.append(h("div", { class: "head" }, h("h1", { class: "grow" }, "Render a scene"), start),
    h("div", { class: "columns planning" },
      panel("Scene", segments("Scene", choices, from, (key) => { from = key; paint(); }), h("div", { class: "stack" }, about, gallery, own)),
      panel("Options", null, h("div", { class: "stack" }, options.element, problems, progress))));
  paint();

  function add(more) {
    const names = new Set([...more].map((file) => file.name));
    files = [...files.filter((file) => !names.has(file.name)), ...more].sort((a, b) => a.name.localeCompare(b.name));
    input.value = "";
    paint();
  }

  function paint() {
    say(about, ABOUT[from]);
    gallery.hidden = from !== "gallery";
    own.hidden = from === "gallery";
    listing.hidden = files.length === 0;
    body.replaceChildren(...files.map((file) => h("tr", {}, h("td", {}, file.name), h("td", { class: "number" }, bytes(file.size)),
      h("td", {}, h("button", { type: "button", class: "quiet icon", "aria-label": `Remove ${file.name}`, onclick: () => {
        files = files.filter((f) => f !== file);
        paint();
      } }, "✕")))));
    const tables = files.filter((file) => /\.toml$/i.test(file.name)).length;
    const wrong = from === "files" && files.length > 0 && tables === 0 ? "None of the files is a scene: add the .toml file."
      : from !== "gallery" && tables > 1 ? "Several files end in .toml: keep the one scene." : "";
    problems.replaceChildren(...(wrong ? [h("ul", { class: "problems" }, h("li", {}, wrong))] : []));
    start.disabled = wrong !== "" || (from === "files" && files.length === 0);
  }

  async function begin() {
    start.disabled = true;
    problems.replaceChildren();
    const form = new FormData();
    form.append("kind", "scene");
    if (from === "gallery") form.append("gallery", radios.find((radio) => radio.checked)?.value + (room.box.checked ? "-room" : ""));
    else for (const file of files) form.append("file", file, file.name);
    if (from === "result") form.append("result", id);
    say(progress, from === "gallery" ? "Making the scene…" : `Uploading ${bytes(files.reduce((sum, file) => sum + file.size, 0))}…`);
    try {
      const upload = await (await send("/uploads", { method: "POST", body: form, signal })).json();
      const job = await post("/operations/render", { session: null, upload: upload.id, options: options.options() });
      location.hash = `#/result/${job.id}`;
    } catch (problem) {
      if (problem.name === "AbortError") return;
      problems.replaceChildren(problemMessage(problem));
      start.disabled = false;
    }
    say(progress, "");
  }
}
