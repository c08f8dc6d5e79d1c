// The region of interest, drawn on the live picture by pointer or keys, for the next session.

import { check, h, say, svg } from "./dom.js";

/** Smallest side in pixels. */
const LEAST = 16;
/** Radius of a corner's handle on the screen in pixels. */
const RADIUS = 13;
const CORNERS = [["top left", 0, 0], ["top right", 1, 0], ["bottom left", 0, 1], ["bottom right", 1, 1]];
const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
/** Pixels that an arrow key moves with Shift. */
const LEAP = 20;

/** Left, top, right and bottom in pixels; kept while the page is open. */
/** @type {[number, number, number, number] | null} */
let drawn = null;

/** The region as a plan has it, left, top, width and height in pixels; null for the whole frame. */
export const region = () => drawn && [drawn[0], drawn[1], drawn[2] - drawn[0], drawn[3] - drawn[1]];

/** The switch with what belongs to it, and the layer over the picture. `use()` takes the region into a new session. */
export function regionTool(/** @type {() => void} */ use) {
  let size = [1, 1];
  /** @type {{ move: (x: number, y: number) => void } | null} */
  let held = null;
  const frame = svg("rect", { class: "frame", tabindex: 0, role: "button" });
  const handles = CORNERS.map(([name]) => svg("circle", { class: "handle", tabindex: 0, role: "button", "data-corner": String(name).replace(" ", "-") }));
  const layer = svg("svg", { class: "region", hidden: "", preserveAspectRatio: "xMidYMid meet", role: "group", "aria-label": "Region of interest. Arrow keys move the focused corner or the whole region; Shift makes larger steps." }, frame, ...handles);
  const said = h("output", { id: "region", class: "soft" });
  const take = h("button", { type: "button", id: "use-region", onclick: use }, "Use in a new session");
  const whole = h("button", { type: "button", class: "quiet", id: "whole-frame", onclick: () => { drawn = null; box.box.checked = false; paint(); } }, "Whole frame");
  const box = check("Region of interest", { id: "draw-region", checked: drawn !== null, onchange: () => { drawn = box.box.checked ? middle() : null; paint(); } });
  const element = h("div", { class: "row region-row" }, box, said, take, whole);

  const middle = () => /** @type {[number, number, number, number]} */ ([0.25, 0.25, 0.75, 0.75].map((part, k) => Math.round(part * size[k % 2])));
  const clamp = (/** @type {number} */ value, /** @type {number} */ low, /** @type {number} */ high) => Math.min(Math.max(Math.round(value), low), high);

  /** Moves a corner: `right` and `bottom` are 0 or 1. */
  function corner(right, bottom, x, y) {
    if (!drawn) return;
    const [left, top, end, foot] = drawn;
    drawn = [right ? left : clamp(x, 0, end - LEAST), bottom ? top : clamp(y, 0, foot - LEAST),
      right ? clamp(x, left + LEAST, size[0]) : end, bottom ? clamp(y, top + LEAST, size[1]) : foot];
    paint();
  }

  /** Moves all of it so that its top left corner is there. */
  function place(x, y) {
    if (!drawn) return;
    const [width, height] = [drawn[2] - drawn[0], drawn[3] - drawn[1]];
    const [left, top] = [clamp(x, 0, size[0] - width), clamp(y, 0, size[1] - height)];
    drawn = [left, top, left + width, top + height];
    paint();
  }

  /** Spans a new one from a point. */
  function span(fromX, fromY, x, y) {
    const sides = [[fromX, x, size[0]], [fromY, y, size[1]]].map(([a, b, most]) => {
      const low = clamp(Math.min(a, b), 0, most - LEAST);
      return [low, clamp(Math.max(a, b), low + LEAST, most)];
    });
    drawn = [sides[0][0], sides[1][0], sides[0][1], sides[1][1]];
    paint();
  }

  function paint() {
    const on = drawn !== null;
    layer.toggleAttribute("hidden", !on);
    take.hidden = whole.hidden = !on;
    say(said, "");
    if (!drawn) return;
    const [left, top, right, bottom] = drawn;
    const shown = layer.getBoundingClientRect();
    const scale = Math.min(shown.width / size[0], shown.height / size[1]);
    const radius = scale > 0 ? RADIUS / scale : size[0] / 50;
    const set = (/** @type {Element} */ part, /** @type {Record<string, number | string>} */ values) => Object.entries(values).forEach(([name, value]) => part.setAttribute(name, String(value)));
    set(frame, { x: left, y: top, width: right - left, height: bottom - top, "aria-label": `Region: left ${left}, top ${top}, ${right - left} by ${bottom - top} pixels` });
    handles.forEach((handle, k) => {
      const [name, x, y] = CORNERS[k];
      const [cx, cy] = [x ? right : left, y ? bottom : top];
      set(handle, { cx, cy, r: radius, "aria-label": `Corner ${name}: ${cx}, ${cy}` });
    });
    say(said, `${right - left} × ${bottom - top} px, from ${left}, ${top}`);
  }

  /** Place of the pointer in pixels of the camera. */
  function at(/** @type {PointerEvent} */ event) {
    const matrix = layer.getScreenCTM();
    if (!matrix) return [0, 0];
    const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(matrix.inverse());
    return [x, y];
  }

  layer.addEventListener("pointerdown", (event) => {
    const [x, y] = at(event);
    const k = handles.indexOf(/** @type {any} */ (event.target));
    if (!drawn) return;
    const [left, top] = drawn;
    if (k >= 0) held = { move: (px, py) => corner(CORNERS[k][1], CORNERS[k][2], px, py) };
    else if (event.target === frame) held = { move: (px, py) => place(left + px - x, top + py - y) };
    else held = { move: (px, py) => span(x, y, px, py) };
    layer.setPointerCapture(event.pointerId);
  });
  layer.addEventListener("pointermove", (event) => {
    const [x, y] = at(event);
    held?.move(x, y);
  });
  for (const end of ["pointerup", "pointercancel"]) layer.addEventListener(end, () => (held = null));
  layer.addEventListener("keydown", (event) => {
    const step = STEPS[event.key];
    const k = handles.indexOf(/** @type {any} */ (event.target));
    if (!step || !drawn) return;
    event.preventDefault();
    const [dx, dy] = step.map((v) => v * (event.shiftKey ? LEAP : 1));
    const [left, top, right, bottom] = drawn;
    if (k >= 0) corner(CORNERS[k][1], CORNERS[k][2], (CORNERS[k][1] ? right : left) + dx, (CORNERS[k][2] ? bottom : top) + dy);
    else place(left + dx, top + dy);
  });
  paint();

  return {
    element, layer,
    /** The size of the camera's frames in pixels. */
    fit(/** @type {number} */ width, /** @type {number} */ height) {
      if (size[0] === width && size[1] === height) return;
      size = [width, height];
      layer.setAttribute("viewBox", `0 0 ${width} ${height}`);
      if (drawn && (drawn[2] > width || drawn[3] > height)) drawn = middle();
      paint();
    },
  };
}
