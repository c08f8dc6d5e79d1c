// Parts that are added to a scene, as they start, and where they are in it.

/** Shapes, lights and diffracting layers by kind, with values of required keys that give a picture at once. */
export const STARTS = {
  shape: {
    plane: { size: [60, 60] }, disc: { inner: 20, outer: 58 }, sphere: { radius: 25 }, cylinder: { radius: 25, length: 80 }, mesh: { file: "" },
  },
  light: {
    point: { position: [0, 260, 420], sigma_mm: 10 },
    directional: { direction: [0, 0.5, 1], sigma_deg: 0.13 },
    spot: { position: [0, 260, 420], target: [0, 0, 0], beam_deg: 5, sigma_mm: 5 },
    rectangle: { center: [0, 260, 420], normal: [0, -0.53, -0.85], size: [100, 100] },
    environment: { color: [0.3, 0.3, 0.3] },
  },
  diffraction: {
    grating: { period_um: 1.5, orientation_deg: 0, relief: { depth_um: 0.15 }, coherence_um: 20 },
    cd: { period_um: 1.6, relief: { depth_um: 0.15 }, coherence_um: 20 },
    multislit: { spacing_um: 1.6 },
    lattice: { period_um: [78, 78], aperture_um: [18, 58], coherence_um: 600 },
    table: { file: "lut.exr" },
    heightfield: { file: "", coherence_um: 20 },
  },
};

/** A material of paper under foil. */
const PAPER = { base: { albedo: [0.35, 0.35, 0.37], roughness: 0.5 } };

/** A name for one more thing. */
export function unused(name, taken) {
  for (let k = 1; ; k++) {
    const tried = k === 1 ? name : `${name}-${k}`;
    if (!taken.includes(tried)) return tried;
  }
}

/** Adds a part of a kind; returns where it is. */
export function addPart(scene, group, kind) {
  if (group === "material") {
    scene.material ??= {};
    const name = unused("material", Object.keys(scene.material));
    scene.material[name] = structuredClone(PAPER);
    return ["material", name];
  }
  const part = { type: kind, ...structuredClone(STARTS[group][kind]) };
  if (group === "shape") part.material = materialFor(scene);
  (scene[group] ??= []).push(part);
  return [group, scene[group].length - 1];
}

/** The first material, or a new one. */
function materialFor(scene) {
  return Object.keys(scene.material ?? {})[0] ?? addPart(scene, "material", "")[1];
}

/**
 * Removes a part. Shapes of a removed material take another one.
 * @param {any} scene
 * @param {(string | number)[]} place
 */
export function removePart(scene, [group, at, layer]) {
  if (layer) return delete scene[group][at][layer];
  if (group !== "material") return scene[group].splice(Number(at), 1);
  delete scene.material[at];
  for (const shape of scene.shape ?? []) if (shape.material === at) shape.material = materialFor(scene);
}

/** Gives a material another name, also where shapes name it. */
export function renameMaterial(scene, before, after) {
  scene.material = Object.fromEntries(Object.entries(scene.material).map(([name, value]) => [name === before ? after : name, value]));
  for (const shape of scene.shape ?? []) if (shape.material === before) shape.material = after;
}

/** The material of maps or a table that lie in a subfolder; null without any of them. */
export function materialOfFiles(folder, files) {
  const has = (name) => files.includes(`${folder}/${name}`);
  if (has("orientation.exr") || has("period.exr")) {
    const constant = has("period.exr") ? (has("orientation.exr") ? {} : { orientation_deg: 0 }) : { period_um: 1.5 };
    return { coverage: 0.8, ...structuredClone(PAPER), diffraction: { type: "grating", relief: { depth_um: 0.15 }, maps: folder, coherence_um: 6, reflectance: "aluminium", ...constant } };
  }
  return has("lut.exr") ? { diffraction: { type: "table", file: `${folder}/lut.exr`, albedo: 0.7 } } : null;
}

/** The part at a place, or undefined. */
export const partAt = (scene, place) => place.reduce((at, key) => at?.[key], scene);

/** Puts a part where another one was. */
export function putPart(scene, place, part) {
  partAt(scene, place.slice(0, -1))[place.at(-1)] = part;
}
