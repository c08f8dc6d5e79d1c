// Lines over a view: the sheet's outline, and a ruler between two of its points.

import { h, say, svg } from "./dom.js";
import { degrees, fixed, significant } from "./format.js";
import { mapped, onScreen, onSample } from "./turning.js";

const CORNERS = [[0, 0], [1, 0], [1, 1], [0, 1]];
// Places along the ruler at which the map is read.
const READ = 101;

/**
 * What lies between two points (u, v) of a view: length in mm, direction in degrees, lines per mm (middle, least, most) or null.
 * @param {View} view
 * @param {number[][]} ends
 */
export function measured(view, [a, b]) {
  const { center, across, same } = view.uniforms;
  const [x, y] = [2 * center[0][3] * (b[0] - a[0]), 2 * across[0][3] * (b[1] - a[1])];
  const isGrating = view.uniforms.what[0][0] === 1;
  const lines = Array.from({ length: isGrating ? READ : 0 }, (_, k) => k / (READ - 1))
    .map((t) => mapped(view, [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]))
    .flatMap((found) => (found ? [1000 / found.period] : []))
    .sort((p, q) => p - q);
  return {
    mm: Math.hypot(x, y),
    deg: (Math.atan2(y, x) * 180) / Math.PI,
    lines: lines.length ? { middle: lines[Math.floor(lines.length / 2)], least: lines[0], most: lines[lines.length - 1], assumed: !same[0][3] } : null,
  };
}

/** In words. */
function sentence({ mm, deg, lines }) {
  const length = `${significant(mm, 4)} mm at ${degrees(deg, 1)}`;
  if (!lines) return length;
  const even = lines.most - lines.least < 0.005 * lines.middle;
  const range = even ? "" : ` (${fixed(lines.least, 0)} to ${fixed(lines.most, 0)})`;
  return `${length} · ${fixed(lines.middle, even ? 1 : 0)} lines/mm${range}${lines.assumed ? ", of the assumed period" : ""}`;
}

/** The drawing over a canvas and its button; `place(at)` puts the next end of the ruler to a place in CSS pixels. */
export function rulerOver({ view, uniforms, canvas, signal }) {
  const outline = svg("polygon", { class: "outline" });
  const line = svg("line", { class: "ruler" });
  const said = h("output", { class: "measured", id: "view-measured" });
  const ends = [[0.25, 0.5], [0.75, 0.5]];
  const handles = ["First", "Second"].map((word, k) => handle(`${word} point of the ruler`, k));
  const group = svg("g", { class: "measure", hidden: true }, line, handles);
  const drawing = svg("svg", { class: "over" }, outline, group);
  const button = h("button", { type: "button", id: "view-ruler", "aria-pressed": "false", onclick: toggle }, "Ruler");
  let on = false;
  let next = 0;

  function toggle() {
    on = !on;
    next = 0;
    group.toggleAttribute("hidden", !on);
    button.setAttribute("aria-pressed", String(on));
    refresh();
  }

  function handle(label, k) {
    const circle = svg("circle", { r: 7, tabindex: 0, role: "slider", "aria-label": label, class: "end" });
    circle.addEventListener("pointerdown", (event) => circle.setPointerCapture(event.pointerId), { signal });
    circle.addEventListener("pointermove", (event) => {
      if (!circle.hasPointerCapture(event.pointerId)) return;
      const box = canvas.getBoundingClientRect();
      put(k, [event.clientX - box.left, event.clientY - box.top]);
    }, { signal });
    circle.addEventListener("keydown", (event) => {
      const by = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
      if (!by) return;
      event.preventDefault();
      const step = event.shiftKey ? 0.05 : 0.0025;
      ends[k] = ends[k].map((v, axis) => Math.min(1, Math.max(0, v + step * by[axis])));
      refresh();
    }, { signal });
    return circle;
  }

  const box = () => [canvas.clientWidth, canvas.clientHeight];
  function put(k, [x, y]) {
    const uv = onSample(uniforms(), [x / box()[0], y / box()[1]], box());
    if (uv) ends[k] = uv;
    refresh();
  }

  /** Draws anew where things are now. */
  function refresh() {
    const [width, height] = box();
    const at = (uv) => onScreen(uniforms(), uv, [width, height])?.map((v, axis) => v * [width, height][axis]);
    const corners = CORNERS.map(at);
    outline.setAttribute("points", corners.every(Boolean) ? corners.map((c) => c?.join()).join(" ") : "");
    say(said, on ? sentence(measured(view(), ends)) : "");
    if (!on) return;
    const places = ends.map((end) => at(end) ?? [0, 0]);
    const { center, across } = view().uniforms;
    places.forEach(([x, y], k) => {
      handles[k].setAttribute("cx", String(x));
      handles[k].setAttribute("cy", String(y));
      handles[k].setAttribute("aria-valuenow", String(Math.round(100 * ends[k][0])));
      handles[k].setAttribute("aria-valuetext", `${fixed(2 * center[0][3] * (ends[k][0] - 0.5), 1)} mm to the right, ${fixed(2 * across[0][3] * (ends[k][1] - 0.5), 1)} mm up from the middle`);
      line.setAttribute(`x${k + 1}`, String(x));
      line.setAttribute(`y${k + 1}`, String(y));
    });
  }
  return {
    drawing, button, said, refresh,
    isOn: () => on,
    place(at) {
      if (!on) return;
      put(next, at);
      next = 1 - next;
    },
  };
}
