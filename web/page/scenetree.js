// The tree of a scene and the form of the part that is chosen in it. Forms are made of the scene's JSON Schema.

import { field, h, select } from "./dom.js";
import { plain } from "./format.js";
import { kindsOf, schemaForm } from "./operationform.js";
import { STARTS, addPart, partAt, putPart, removePart, renameMaterial } from "./sceneparts.js";

const GROUPS = [["shape", "Shapes"], ["light", "Lights"], ["material", "Materials"]];
/** Keys of the camera and of the scene that have fields of their own. */
const AT_TOP = ["position", "target", "fov_deg", "width", "height"];
const PARTS = ["version", "camera", "shape", "light", "material"];
/** Keys that name files, by the endings of these. */
const FILE_KEYS = { file: /\.(exr|hdr|obj|ply|gltf|glb|png|tiff?|txt|asc|csv|dat)$/i, albedo: /\.(exr|png|jpe?g|tiff?|bmp)$/i, normals: /\.(exr|png|tiff?)$/i, coverage: /\.(exr|png|jpe?g|tiff?|bmp)$/i };

const key = (place) => place.join("/");
const vector = (values) => (values ?? []).map(plain).join(", ");
const named = (word) => word.replace(/^./, (c) => c.toUpperCase()).replaceAll("_", " ");

/** What tells a part from others of its group. */
function titleOf(group, part, at) {
  if (group === "material") return String(at);
  const name = named(part.type ?? "part");
  if (group === "shape") return `${name} of ${part.material ?? "no material"}`;
  const where = part.position ?? part.center;
  if (part.direction) return `${name} from ${vector(part.direction)}`;
  return where ? `${name} at ${vector(where)}` : `${name}${part.file ? ` ${part.file}` : ""}`;
}

/** The schema with the names of this scene's materials and files where it asks for them. */
function tailored(schema, scene, files) {
  const own = structuredClone(schema);
  const folders = [...new Set(files.filter((file) => file.endsWith(".exr")).map((file) => file.split("/").slice(0, -1).join("/") || file))];
  const walk = (/** @type {any} */ at) => {
    if (!at || typeof at !== "object") return;
    for (const [name, property] of Object.entries(at.properties ?? {})) {
      if (name === "material" && property.type === "string") property.enum = Object.keys(scene.material ?? {});
      if (name === "maps") property.examples = folders;
      else if (FILE_KEYS[name]) property.examples = files.filter((file) => FILE_KEYS[name].test(file));
    }
    Object.values(at).forEach(walk);
  };
  walk(own.$defs);
  return own;
}

/**
 * Tree and form of a document.
 * @param {any} doc
 * @param {any} schema
 */
export function sceneTree(doc, schema) {
  /** @type {(string | number)[]} */
  let chosen = ["camera"];
  const list = h("div", { class: "scene-tree" });
  const form = h("div", { class: "stack", id: "scene-part", onchange: (event) => event.target.dataset.own === undefined && read() });
  /** @type {() => void} */
  let read = () => {};
  const self = { list, form, paint, choose };

  function choose(place) {
    chosen = place;
    paint();
  }

  /** Shows the present scene; a form that made the change itself stays as it is. */
  function paint(own) {
    const { scene } = doc.now();
    if (chosen[0] !== "scene" && partAt(scene, chosen) === undefined) chosen = ["camera"];
    paintList(scene);
    if (own !== self) paintForm(scene);
  }

  function item(place, label, ...more) {
    const current = key(place) === key(chosen);
    return h("li", {}, h("button", { type: "button", class: "quiet", "data-place": key(place), "aria-current": current ? "true" : null, onclick: () => choose(place) }, label), ...more);
  }

  function paintList(scene) {
    const held = /** @type {HTMLElement | null} */ (document.activeElement)?.dataset.place;
    const layer = (name, { diffraction }) => diffraction && h("ul", {}, item(["material", name, "diffraction"], `Diffraction: ${named(diffraction.type)}`));
    const group = (/** @type {string[]} */ [name, title]) => {
      const parts = Object.entries(scene[name] ?? {});
      return h("section", { "aria-label": title }, h("div", { class: "row between" }, h("h3", {}, title), adder(name)),
        h("ul", {}, parts.map(([at, part]) => item([name, name === "material" ? at : Number(at)], titleOf(name, part, at), name === "material" && layer(at, part)))));
    };
    list.replaceChildren(h("ul", {}, item(["camera"], "Camera"), item(["scene"], "Observer, exposure, turn")), ...GROUPS.map(group));
    if (held) /** @type {HTMLElement | null} */ (list.querySelector(`[data-place="${CSS.escape(held)}"]`))?.focus();
  }

  /** What adds a part to a group. */
  function adder(group) {
    const add = (/** @type {string} */ kind) => {
      let place;
      doc.edit((scene) => (place = addPart(scene, group, kind)));
      choose(place);
    };
    if (group === "material") return h("button", { type: "button", id: "add-material", onclick: () => add("") }, "Add material");
    const choices = select([["", `Add ${group}…`], ...Object.keys(STARTS[group]).map((kind) => [kind, named(kind)])], "", { id: `add-${group}`, "aria-label": `Add ${group}`, onchange: () => choices.value && add(choices.value) });
    return choices;
  }

  function paintForm(scene) {
    const part = partAt(scene, chosen);
    const own = tailored(schema, scene, doc.files);
    const [group, at, layer] = chosen;
    if (group === "camera") return plainForm("Camera: lens and direction", own.properties.camera, part, own, AT_TOP);
    if (group === "scene") return sceneForm(scene, own);
    if (group === "material" && !layer) return materialForm(part, String(at), own);
    kindForm(part, layer ?? group, own);
  }

  function show(title, ...content) {
    const fixed = ["camera", "scene"].includes(String(chosen[0]));
    const remove = fixed ? null : h("button", { type: "button", class: "danger", id: "remove-part", onclick: () => doc.edit((scene) => removePart(scene, chosen)) }, "Remove");
    form.replaceChildren(h("div", { class: "row between" }, h("h3", {}, title), remove), ...content.filter((part) => part !== null));
  }

  function plainForm(title, part, given, own, without) {
    const made = schemaForm("part", part, given, own, without);
    const kept = () => Object.fromEntries(without.filter((name) => given[name] !== undefined).map((name) => [name, partAt(doc.now().scene, chosen)[name]]));
    read = () => doc.edit((scene) => putPart(scene, chosen, { ...kept(), ...made.value() }), self);
    show(title, made.element);
  }

  function sceneForm(scene, own) {
    const made = schemaForm("part", own, scene, own, PARTS);
    const change = (now) => {
      for (const name of Object.keys(now)) if (!PARTS.includes(name)) delete now[name];
      Object.assign(now, made.value());
    };
    read = () => doc.edit(change, self);
    show("Observer, exposure, turn", made.element);
  }

  function materialForm(part, name, own) {
    const made = schemaForm("part", own.$defs.Material, part, own, ["diffraction"]);
    const title = h("input", { id: "part-name", value: name, "data-own": "", autocomplete: "off", spellcheck: "false", onchange: () => rename(title.value.trim()) });
    const rename = (to) => {
      const taken = Object.keys(doc.now().scene.material).includes(to);
      title.setCustomValidity(to === "" ? "Give a name" : taken && to !== name ? "Another material has this name" : "");
      if (!title.reportValidity() || to === name) return;
      chosen = ["material", to];
      doc.edit((scene) => renameMaterial(scene, name, to));
    };
    const layers = part.diffraction ? null : select([["", "Add diffraction…"], ...Object.keys(STARTS.diffraction).map((kind) => [kind, named(kind)])], "", {
      id: "add-diffraction", "data-own": "", "aria-label": "Add diffraction", onchange: (event) => {
        const kind = event.target.value;
        const material = chosen;
        chosen = [...material, "diffraction"];
        doc.edit((scene) => (partAt(scene, material).diffraction = { type: kind, ...structuredClone(STARTS.diffraction[kind]) }));
      } });
    read = () => doc.edit((scene) => {
      const { diffraction } = partAt(scene, chosen);
      putPart(scene, chosen, { ...made.value(), ...(diffraction && { diffraction }) });
    }, self);
    show(`Material ${name}`, field("Name", title), made.element, layers);
  }

  /** The form of a part that is one of several kinds; another kind keeps the values of common keys. */
  function kindForm(part, group, own) {
    const kinds = kindsOf(own.$defs[named(group)], own);
    const kind = kinds.get(part.type);
    const made = schemaForm("part", kind ?? {}, part, own);
    const list = select([...kinds.keys()].map((word) => [word, named(word)]), part.type, { id: "part-kind", "data-own": "", onchange: () => {
      const common = Object.entries(partAt(doc.now().scene, chosen)).filter(([name]) => name !== "type" && kinds.get(list.value).properties[name]);
      doc.edit((scene) => putPart(scene, chosen, { type: list.value, ...structuredClone(STARTS[group][list.value]), ...Object.fromEntries(common) }));
    } });
    read = () => doc.edit((scene) => putPart(scene, chosen, { type: part.type, ...made.value() }), self);
    show(named(group), field("Kind", list), made.element);
  }
  return self;
}
