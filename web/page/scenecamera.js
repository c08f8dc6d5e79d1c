// The camera of a scene and the size of its picture: numbers, usual sizes, and steps around the target.

import { field, h, number, select } from "./dom.js";

const SIZES = [[180, 180], [360, 360], [720, 720], [640, 480], [1280, 720], [1920, 1080], [3840, 2160]];
/** Angle of a step around the target in degrees, and factor of a step towards it. */
const [STEP_DEG, NEARER] = [10, 0.85];
const AXES = ["x", "y", "z"];

const cross = ([a, b, c], [d, e, f]) => [b * f - c * e, c * d - a * f, a * e - b * d];
const dot = (a, b) => a.reduce((sum, v, k) => sum + v * b[k], 0);
const unit = (v) => v.map((x) => x / (Math.hypot(...v) || 1));
const rounded = (v) => v.map((x) => Number(x.toFixed(3)));

/** A vector turned about a unit axis (Rodrigues' formula). */
function turned(v, axis, deg) {
  const [c, s] = [Math.cos((deg * Math.PI) / 180), Math.sin((deg * Math.PI) / 180)];
  const across = cross(axis, v);
  const along = dot(axis, v) * (1 - c);
  return v.map((x, k) => x * c + across[k] * s + axis[k] * along);
}

/** The camera's position after a step to the side, upwards or nearer; null where it would look along `up`. */
export function stepped({ position, target, up = [0, 1, 0] }, [side, rise, near]) {
  const from = position.map((x, k) => x - target[k]);
  const top = unit(up);
  let to = turned(from, top, side * STEP_DEG);
  to = turned(to, unit(cross(to, top)), rise * STEP_DEG);
  if (Math.abs(dot(unit(to), top)) > 0.999) return null;
  return rounded(to.map((x, k) => target[k] + x * NEARER ** near));
}

/**
 * Fields of a document's camera.
 * @param {any} doc
 */
export function cameraFields(doc) {
  const triple = (name) => AXES.map((axis, k) => number({ id: `camera-${name}${k ? `-${axis}` : ""}`, "aria-label": `Camera ${name} ${axis} in mm`, required: true }));
  const [position, target] = [triple("position"), triple("target")];
  const fov = number({ id: "camera-fov", min: 0.01, max: 170, required: true });
  const [width, height] = ["width", "height"].map((name) => number({ id: `camera-${name}`, min: 1, step: 1, required: true, "aria-label": `Picture ${name} in pixels` }));
  const sizes = select([["", "Other size"], ...SIZES.map(([w, h]) => [`${w}×${h}`, `${w} × ${h}`])], "", { id: "camera-size", "data-own": "", onchange: () => {
    if (!sizes.value) return;
    const [w, h] = sizes.value.split("×").map(Number);
    doc.edit((scene) => Object.assign(scene.camera, { width: w, height: h }));
  } });
  const steps = [["◀", "Around to the left", [-1, 0, 0]], ["▶", "Around to the right", [1, 0, 0]], ["▲", "Upwards", [0, 1, 0]], ["▼", "Downwards", [0, -1, 0]], ["+", "Nearer", [0, 0, 1]], ["−", "Farther", [0, 0, -1]]];
  const around = h("div", { class: "row", role: "group", "aria-label": "Move the camera around its target" }, steps.map(([sign, label, by]) =>
    h("button", { type: "button", class: "icon", title: String(label), "aria-label": String(label), onclick: () => step(by) }, String(sign))));
  const element = h("div", { class: "fields camera", onchange: (event) => event.target.dataset.own === undefined && read() },
    field("Camera position x, y, z (mm)", h("div", { class: "row numbers", id: "camera-positions" }, position)),
    field("Target x, y, z (mm)", h("div", { class: "row numbers", id: "camera-targets" }, target)),
    field("Vertical angle of view (°)", fov), field("Size", sizes), field("Width × height (pixels)", h("div", { class: "row numbers", id: "camera-pixels" }, width, height)));

  function step(by) {
    const to = stepped(doc.now().scene.camera, by);
    if (to) doc.edit((scene) => (scene.camera.position = to));
  }

  function read() {
    const inputs = [...position, ...target, fov, width, height];
    if (!inputs.every((input) => input.reportValidity())) return;
    const value = (input) => input.valueAsNumber;
    doc.edit((scene) => Object.assign(scene.camera, { position: position.map(value), target: target.map(value), fov_deg: value(fov), width: value(width), height: value(height) }));
  }

  function paint() {
    const { camera } = doc.now().scene;
    const set = (input, value) => { if (input.valueAsNumber !== value) input.value = value ?? ""; };
    AXES.forEach((_, k) => (set(position[k], camera.position?.[k]), set(target[k], camera.target?.[k])));
    set(fov, camera.fov_deg);
    set(width, camera.width);
    set(height, camera.height);
    const size = `${camera.width}×${camera.height}`;
    sizes.value = SIZES.some(([w, h]) => `${w}×${h}` === size) ? size : "";
  }
  return { element, around, paint };
}
