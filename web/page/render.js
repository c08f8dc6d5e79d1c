// #/render: a scene of the gallery or your own; #/render/ID: the maps of a result on a sheet, or the scene of a rendering;
// #/render/scene-ID: the scene of an upload, which is edited and rendered.

import { get } from "./api.js";
import { check, field, h, panel, say } from "./dom.js";
import { problemMessage } from "./feedback.js";
import { bytes } from "./format.js";
import { sceneEditor, uploadScene } from "./sceneedit.js";

/** Scenes in the order of the tiles of gallery.jpg. */
const GALLERY = [
  ["cd", "Compact disc", "Tracks around a hole"], ["phone", "Telephone", "The subpixels of a screen"], ["tv", "Television", "Coarser subpixels, one way"],
  ["star-paper", "Star paper", "Polygons and stars of twelve orientations"], ["kinematic-tile", "Kinematic tile", "Light runs around when it is tilted"],
  ["logo", "Logo", "Letters on rays"], ["emblem", "Emblem", "A shield with a star"], ["spiral-foil", "Spiral foil", "Random dots"],
  ["rolled", "Rolled sheet", "Star paper around a cylinder"], ["snake", "Snake", "A mesh whose scales diffract"],
];
const FILES = ".toml,.exr,.hdr,.png,.tif,.tiff,.jpg,.jpeg,.bmp,.obj,.ply,.gltf,.glb,.bin,.csv,.txt,.asc,.dat";

/**
 * Shows the choice or the scene until the signal fires.
 * @param {HTMLElement} main
 * @param {Visit} visit
 */
export async function renderPage(main, { id, signal }) {
  if (!id) return choose(main, signal);
  if (id.startsWith("scene-")) return sceneEditor(main, id.slice("scene-".length), { signal });
  const { method, upload, options } = await get(`/reconstructions/${id}`, { signal });
  if (method === "render") {
    const { scene: text, ...given } = options;
    return sceneEditor(main, upload, { text, given, signal });
  }
  main.append(h("p", { class: "soft", role: "status" }, "Laying the maps on a sheet…"));
  const made = await uploadScene([["result", id]], signal);
  location.replace(`#/render/scene-${made.id}`);
}

function choose(main, signal) {
  /** @type {File[]} */
  let files = [];
  const room = check("In a room, not under small lights", { id: "render-room" });
  const tiles = GALLERY.map(([name, title, hint], k) => {
    const picture = h("span", { class: "tile" });
    picture.style.backgroundPosition = `${(100 * k) / (GALLERY.length - 1)}% 0`;
    return h("button", { type: "button", class: "scene-choice", "data-scene": name, onclick: () => open([["gallery", name + (room.box.checked ? "-room" : "")]], "Making the scene…") },
      picture, h("strong", {}, title), h("small", {}, hint));
  });
  const problems = h("div", { role: "status", "aria-live": "polite" });
  const progress = h("p", { role: "status", "aria-live": "polite", class: "soft" });
  const input = h("input", { type: "file", id: "scene-files", multiple: true, accept: FILES, onchange: () => add(input.files) });
  const body = h("tbody");
  const listing = h("table", { hidden: true }, h("thead", {}, h("tr", {}, h("th", { scope: "col" }, "File"), h("th", { scope: "col", class: "number" }, "Size"), h("th", { scope: "col" }))), body);
  const begin = h("button", { type: "button", id: "scene-open", disabled: true, onclick: () => open(files.map((file) => ["file", file, file.name]), `Uploading ${bytes(files.reduce((sum, file) => sum + file.size, 0))}…`) }, "Open the scene");
  main.append(h("div", { class: "head" }, h("h1", { class: "grow" }, "Render a scene")), h("div", { class: "stack" }, problems, progress,
    panel("To start from", room, h("p", { class: "soft" }, "Measured surfaces are not needed: the maps of these scenes are made by formulas."), h("div", { class: "scene-choices" }, tiles)),
    panel("Your own", null, h("div", { class: "stack" },
      h("p", { class: "soft" }, "One scene (TOML) and every file that it names: maps, tables, meshes, environments. They lie side by side, so that the scene gives plain names."),
      h("div", { class: "drop", ondragover: (event) => event.preventDefault(), ondrop: (event) => { event.preventDefault(); add(event.dataTransfer.files); } },
        field("The scene and its files", input, { hint: "Or drop them here. On the command line, nacre schema scene describes all keys." })),
      h("div", { class: "scroll tall" }, listing), h("p", {}, begin)))));

  function add(more) {
    const names = new Set([...more].map((file) => file.name));
    files = [...files.filter((file) => !names.has(file.name)), ...more].sort((a, b) => a.name.localeCompare(b.name));
    input.value = "";
    paint();
  }

  function paint() {
    listing.hidden = files.length === 0;
    body.replaceChildren(...files.map((file) => h("tr", {}, h("td", {}, file.name), h("td", { class: "number" }, bytes(file.size)),
      h("td", {}, h("button", { type: "button", class: "quiet icon", "aria-label": `Remove ${file.name}`, onclick: () => {
        files = files.filter((other) => other !== file);
        paint();
      } }, "✕")))));
    const tables = files.filter((file) => /\.toml$/i.test(file.name)).length;
    const wrong = files.length === 0 || tables === 1 ? "" : tables === 0 ? "None of the files is a scene: add the .toml file." : "Several files end in .toml: keep the one scene.";
    problems.replaceChildren(...(wrong ? [h("ul", { class: "problems" }, h("li", {}, wrong))] : []));
    begin.disabled = wrong !== "" || files.length === 0;
  }

  async function open(parts, doing) {
    for (const button of [...tiles, begin]) button.disabled = true;
    problems.replaceChildren();
    say(progress, doing);
    try {
      const made = await uploadScene(parts, signal);
      location.hash = `#/render/scene-${made.id}`;
    } catch (problem) {
      if (problem.name === "AbortError") return;
      problems.replaceChildren(problemMessage(problem));
      for (const tile of tiles) tile.disabled = false;
      begin.disabled = files.length === 0;
    }
    say(progress, "");
  }
}
