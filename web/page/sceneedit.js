// A scene that is edited: camera and draft, tree and forms, text, undo; then rendered.

import { get, post, send } from "./api.js";
import { field, h, panel, save, say, select, settle } from "./dom.js";
import { complain, problemMessage, tell } from "./feedback.js";
import { bytes, duration } from "./format.js";
import { operationForm } from "./operationform.js";
import { cameraFields } from "./scenecamera.js";
import { sceneDocument } from "./scenedoc.js";
import { sceneDraft } from "./scenedraft.js";
import { materialOfFiles, unused } from "./sceneparts.js";
import { sceneTree } from "./scenetree.js";

/** Operations whose results may hold maps or a table. */
const WITH_MAPS = ["polarization", "flash", "spots", "map", "lut", "foil"];
/** Where an unsaved scene waits for a reload of the page. */
const kept = (upload) => `nacre-scene-${upload}`;

function stored(upload) {
  try {
    return sessionStorage.getItem(kept(upload)) || undefined;
  } catch {
    return undefined;
  }
}

/** Uploads what a scene starts from or needs; resolves to the new upload. */
export async function uploadScene(parts, signal) {
  const form = new FormData();
  form.append("kind", "scene");
  for (const [name, value, file] of parts) file ? form.append(name, value, file) : form.append(name, value);
  return (await send("/uploads", { method: "POST", body: form, signal })).json();
}

/**
 * Shows the scene of an upload; `text` is an edited one, `given` are options of an earlier rendering.
 * @param {HTMLElement} main
 * @param {string} upload
 * @param {{ text?: string, given?: Record<string, any>, signal: AbortSignal }} how
 */
export async function sceneEditor(main, upload, { text, given = {}, signal }) {
  const schema = await get("/scenes/schema", { signal });
  const doc = sceneDocument(upload, { changed, checked, failed: complain, signal });
  const options = operationForm("render", given, { without: ["scene"] });
  const [camera, draft, tree] = [cameraFields(doc), sceneDraft(doc, signal), sceneTree(doc, schema)];
  const title = h("h1", { class: "grow" });
  const undo = h("button", { type: "button", id: "undo", title: "Undo (Ctrl+Z)", onclick: doc.undo }, "↶ Undo");
  const redo = h("button", { type: "button", id: "redo", title: "Redo (Ctrl+Shift+Z)", onclick: doc.redo }, "↷ Redo");
  const start = h("button", { type: "button", class: "primary", id: "render-start", onclick: render }, "Render");
  const estimate = h("p", { class: "soft", id: "scene-estimate", role: "status", "aria-live": "polite" });
  const problems = h("div", { role: "status", "aria-live": "polite", id: "scene-problems" });
  const hints = h("ul");
  const hinted = h("details", { hidden: true }, h("summary", {}, "Defaults that decide the picture"), hints);
  const source = h("textarea", { class: "code", id: "scene-text", rows: 18, spellcheck: "false", "aria-label": "Scene as TOML", onchange: typed });
  const download = h("button", { type: "button", onclick: () => save(new Blob([doc.now().toml ?? ""], { type: "application/toml" }), "scene.toml") }, "Download scene.toml");
  // Text of the focused field when it got the focus.
  let typedFrom = "";
  const order = () => ({ session: null, upload: doc.upload, options: { ...options.options(), scene: doc.now().toml } });

  const weigh = settle(300, async () => {
    const { toml, problem } = doc.now();
    if (toml === null || problem || signal.aborted) return say(estimate, "");
    try {
      const { seconds, memory_bytes: memory } = await post("/reconstructions/estimate", { ...order(), method: "render" }, { signal });
      say(estimate, `At most about ${duration(seconds)}, ${bytes(memory)} of memory`);
    } catch (refused) {
      if (refused.name !== "AbortError") say(estimate, refused.message);
    }
  });

  options.element.addEventListener("change", () => weigh());
  await doc.load(text ?? stored(upload));
  if (signal.aborted) return;
  main.append(
    h("div", { class: "head" }, title, undo, redo, h("a", { class: "button", href: "#/render" }, "Other scene"), start),
    h("div", { class: "columns scene" },
      h("div", { class: "beside" },
        panel("Camera and picture", estimate, h("div", { class: "stack" }, camera.element, problems, draft.element, camera.around))),
      h("div", { class: "stack" },
        panel("Scene", null, h("div", { class: "stack" }, tree.list, h("hr"), tree.form, hinted)),
        panel("More materials and files", null, more()),
        panel("Options of the picture", null, options.element),
        panel("Text", download, h("details", {}, h("summary", {}, "Scene as TOML"), source)))));
  addEventListener("keydown", keys, { signal });
  main.addEventListener("focusin", (event) => (typedFrom = /** @type {HTMLInputElement} */ (event.target).value ?? ""), { signal });

  /** Ctrl+Z within a field that is being typed in is the field's own. */
  function keys(event) {
    const target = event.target;
    if (!(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== "z") return;
    if (target.tagName === "TEXTAREA" || (target.tagName === "INPUT" && target.value !== typedFrom)) return;
    event.preventDefault();
    if (event.shiftKey) doc.redo();
    else doc.undo();
  }

  function changed(own) {
    typedFrom = /** @type {HTMLInputElement | null} */ (document.activeElement)?.value ?? "";
    say(title, doc.name ? `Scene: ${doc.name}` : "Scene");
    [undo.disabled, redo.disabled] = [!doc.canUndo(), !doc.canRedo()];
    camera.paint();
    tree.paint(own);
  }

  function checked() {
    const { toml, problem, hints: lines } = doc.now();
    source.value = toml ?? "";
    problems.replaceChildren(...(problem ? [h("ul", { class: "problems" }, h("li", {}, problem))] : []));
    hints.replaceChildren(...lines.map((line) => h("li", { class: "soft" }, line)));
    hinted.hidden = lines.length === 0;
    start.disabled = problem !== null;
    try {
      sessionStorage.setItem(kept(doc.upload), toml ?? "");
    } catch {
      // Storage can be full or forbidden; a reload then starts from the upload.
    }
    draft.draw();
    weigh();
  }

  async function typed() {
    try {
      const refused = await doc.editText(source.value);
      if (refused) problems.replaceChildren(h("ul", { class: "problems" }, h("li", {}, refused)));
    } catch (problem) {
      complain(problem);
    }
  }

  async function render() {
    start.disabled = true;
    try {
      await doc.check();
      const job = await post("/operations/render", order());
      location.hash = `#/result/${job.id}`;
    } catch (problem) {
      problems.replaceChildren(problemMessage(problem));
      start.disabled = false;
    }
  }

  /** Materials of results, and further files: both need another upload, with the files of this one. */
  function more() {
    const results = select([["", "Choose a result…"]], "", { id: "material-result", "aria-label": "Result" });
    const add = h("button", { type: "button", id: "add-result", onclick: addResult }, "Add as material");
    const input = h("input", { type: "file", id: "scene-more", multiple: true, onchange: addFiles });
    fill(results).catch(complain);
    return h("div", { class: "stack" }, field("Material from a result", h("div", { class: "row" }, results, add)),
      field("Add files", input, { hint: "Maps, tables, meshes, environments and spectra, which the scene then names." }));

    async function grow(parts) {
      const before = doc.upload;
      const next = await uploadScene([["upload", before], ...parts], signal);
      const { files } = await get(`/uploads/${next.id}/scene`, { signal });
      doc.rebase(next.id, files);
      history.replaceState(null, "", `#/render/scene-${next.id}`);
    }

    async function addResult() {
      const [id, label] = [results.value, results.selectedOptions[0].textContent];
      if (!id) return;
      add.disabled = true;
      try {
        const taken = [...Object.keys(doc.now().scene.material ?? {}), ...doc.files.map((file) => file.split("/")[0])];
        const folder = unused((label ?? "").toLowerCase().replace(/[^a-z0-9]+/g, "-").replace(/^-|-$/g, "").slice(0, 40) || "result", taken);
        await grow([["folder", folder], ["result", id]]);
        const material = materialOfFiles(folder, doc.files);
        doc.edit((scene) => ((scene.material ??= {})[folder] = material));
        tree.choose(["material", folder]);
        tell(`Material ${folder} added: choose it as the material of a shape.`);
      } catch (problem) {
        complain(problem);
      }
      add.disabled = false;
    }

    async function addFiles() {
      try {
        await grow([...(input.files ?? [])].map((file) => ["file", file, file.name]));
        input.value = "";
        tree.paint();
        await doc.check();
        tell("Files added: forms of the scene offer their names.");
      } catch (problem) {
        complain(problem);
      }
    }
  }

  async function fill(results) {
    const [{ items }, sessions] = await Promise.all([get("/reconstructions?limit=200", { signal }), get("/sessions?limit=200", { signal })]);
    const found = [...items.filter((job) => job.state === "done" && WITH_MAPS.includes(job.method)), ...sessions.items.filter((session) => session.has_results)];
    results.append(...found.map(({ id, name }) => h("option", { value: id }, name || id)));
    results.closest(".field").hidden = found.length === 0;
  }
}
