// Points picked on a photograph: corners of a sheet, of a rectangle, or one place. Each has a handle and two fields.

import { h, number, pen, say, svg } from "./dom.js";

const COLORS = ["#ffb000", "#fe6100", "#dc267f", "#648fff"];
/** Steps of the arrow keys in pixels, without and with the shift key. */
const STEPS = [1, 20];
/** Where points are put by the keyboard: shares of width and height. */
const PLACES = { 1: [[0.5, 0.5]], 2: [[0.4, 0.4], [0.6, 0.6]], 4: [[0.1, 0.1], [0.9, 0.1], [0.9, 0.9], [0.1, 0.9]] };

/**
 * A photograph on which the points `names` are picked: by clicks, by dragging handles, by arrow keys, or in fields.
 * Values are in pixels of the photograph, centres at integers.
 * @param {string} id begins the ids of the fields
 * @param {string[]} names
 * @param {{ given?: number[][] | null, changed?: () => void }} options `given` are points that are known already
 */
export function picker(id, names, { given = null, changed = () => {} } = {}) {
  /** @type {(number[] | null)[]} */
  let points = names.map((_, k) => given?.[k] ?? null);
  let [width, height] = [0, 0];
  const canvas = h("canvas", { width: 1, height: 1, "aria-hidden": "true" });
  const over = svg("svg", { class: "picks", role: "group", "aria-label": `Photograph to pick in: ${names.join(", ")}` });
  const well = h("div", { class: "well picker", hidden: true }, h("div", { class: "sheet" }, canvas, over));
  const said = h("p", { class: "soft", role: "status", "aria-live": "polite" });
  const again = h("button", { type: "button", class: "quiet", onclick: () => set(names.map(() => null)) }, "Clear");
  const place = h("button", { type: "button", class: "quiet", id: `${id}-place`, onclick: placeAll }, names.length > 1 ? "Place all" : "Place in the middle");
  const inputs = names.map((name, k) => ["x", "y"].map((axis) =>
    number({ id: `${id}-${k}-${axis}`, "aria-label": `${name}, ${axis} in pixels`, placeholder: axis, min: 0, oninput: typed })));
  const rows = h("div", { class: "picked" }, names.map((name, k) => h("div", { class: "row" },
    h("span", { class: "swatch", style: `background:${COLORS[k % COLORS.length]}` }), h("span", { class: "grow" }, `${k + 1} ${name}`), inputs[k])));
  const element = h("div", { class: "stack" }, well, h("div", { class: "row between" }, said, h("div", { class: "row" }, place, again)), rows);

  /** Shows a photograph, or none where the browser cannot draw it; `wide` is its width if the file was made smaller. */
  async function show(file, wide = 0) {
    const picture = file && (await createImageBitmap(file).catch(() => null));
    well.hidden = !picture;
    if (picture) {
      [canvas.width, canvas.height] = [picture.width, picture.height];
      const scale = wide ? wide / picture.width : 1;
      [width, height] = [picture.width * scale, picture.height * scale];
      pen(canvas).drawImage(picture, 0, 0);
    }
    over.setAttribute("viewBox", `-0.5 -0.5 ${width} ${height}`);
    paint();
  }

  function set(next) {
    points = next;
    paint();
    tell();
  }

  /** Forms around it listen as to their fields. */
  function tell() {
    changed();
    element.dispatchEvent(new Event("change", { bubbles: true }));
  }

  /** Puts a point, within the photograph. */
  function put(/** @type {number} */ k, /** @type {number[]} */ [x, y]) {
    const inside = (v, size) => Math.round(10 * Math.min(Math.max(v, 0), Math.max(0, size - 1))) / 10;
    set(points.map((p, at) => (at === k ? [inside(x, width), inside(y, height)] : p)));
  }

  function placeAll() {
    set(points.map((p, k) => p ?? [width, height].map((size, axis) => Math.round((size - 1) * (PLACES[names.length] ?? [])[k]?.[axis] || 0))));
    handles[0].focus();
  }

  function typed() {
    points = inputs.map((pair, k) => (pair.every((input) => Number.isFinite(input.valueAsNumber)) ? pair.map((input) => input.valueAsNumber) : pair.some((input) => input.value !== "") ? points[k] : null));
    paint();
    changed();
  }

  /** @returns {number[]} */
  const at = (/** @type {PointerEvent} */ event) => {
    const box = over.getBoundingClientRect();
    return [((event.clientX - box.left) / box.width) * width - 0.5, ((event.clientY - box.top) / box.height) * height - 0.5];
  };

  const handles = names.map((name, k) => {
    const handle = svg("g", { class: "pick", tabindex: 0, role: "slider", "aria-label": name },
      svg("circle", { class: "grip", r: 16 }), svg("circle", { r: 7 }), svg("path", { d: "M-13 0H13M0 -13V13" }), svg("text", { x: 11, y: -9 }, String(k + 1)));
    handle.style.color = COLORS[k % COLORS.length];
    handle.addEventListener("pointerdown", (event) => {
      event.stopPropagation();
      handle.setPointerCapture(event.pointerId);
    });
    handle.addEventListener("pointermove", (event) => handle.hasPointerCapture(event.pointerId) && put(k, at(event)));
    handle.addEventListener("keydown", (event) => {
      const by = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      const from = points[k];
      if (event.key === "Delete") set(points.map((p, other) => (other === k ? null : p)));
      else if (by && from) put(k, from.map((v, axis) => v + by[axis] * STEPS[event.shiftKey ? 1 : 0]));
      else return;
      event.preventDefault();
    });
    return handle;
  });
  const outline = svg("path", { class: "outline" });
  over.append(outline, ...handles);
  over.addEventListener("pointerdown", (event) => {
    const next = points.indexOf(null);
    if (next < 0) return;
    put(next, at(event));
    // The new handle follows the pointer until it is released.
    handles[next].setPointerCapture(event.pointerId);
  });
  new ResizeObserver(paint).observe(over);

  function paint() {
    const scale = width / (over.clientWidth || over.getBoundingClientRect().width || width || 1);
    handles.forEach((handle, k) => {
      const point = points[k];
      handle.toggleAttribute("hidden", !point);
      handle.style.display = point ? "" : "none";
      if (!point) return;
      handle.setAttribute("transform", `translate(${point[0]} ${point[1]}) scale(${scale})`);
      handle.setAttribute("aria-valuetext", `x ${point[0]}, y ${point[1]}`);
      handle.setAttribute("aria-valuenow", String(point[0]));
    });
    const known = /** @type {number[][]} */ (points.filter((p) => p !== null));
    outline.setAttribute("d", names.length === 4 && known.length > 1 ? `M${known.map((p) => p.join(" ")).join("L")}${known.length === 4 ? "Z" : ""}`
      : names.length === 2 && known.length === 2 ? `M${known[0].join(" ")}H${known[1][0]}V${known[1][1]}H${known[0][0]}Z` : "");
    outline.setAttribute("stroke-width", String(2 * scale));
    inputs.forEach((pair, k) => pair.forEach((input, axis) => {
      if (document.activeElement !== input) input.value = points[k] ? String(points[k]?.[axis]) : "";
    }));
    const next = points.indexOf(null);
    say(said, well.hidden ? "" : next < 0 ? "Drag a handle or use its arrow keys to correct." : `Click: ${names[next]}. Nothing needs to be picked.`);
    place.hidden = well.hidden || next < 0;
    again.hidden = known.length === 0;
  }
  paint();
  return {
    element, show,
    /** The points, or those that are known. */
    points: () => /** @type {number[][]} */ (points.filter((p) => p !== null)),
  };
}
