// Lines, rectangles and polygons that are drawn over a map, and changed by their corners.

import { svg } from "./dom.js";

/** What the pointer does: moves the map, or draws one of the shapes. */
export const TOOLS = [["move", "Move"], ["line", "Profile"], ["rectangle", "Rectangle"], ["polygon", "Polygon"]];

const CORNER = { line: ["Start", "End"], rectangle: ["First corner", "Opposite corner"] };
/** Most corners of a polygon that the service takes. */
const MOST_CORNERS = 64;

/**
 * The drawing over a map. `changed(tool, corners)` gets the corners in pixels of the map (pixels begin at integers), or
 * null for none.
 * @param {{ view: () => import("./mapview.js").MapView, changed: (tool: string, corners: Point[] | null) => void, signal: AbortSignal }} options
 */
export function shapesOver({ view, changed, signal }) {
  /** @type {Record<string, Point[]>} */
  const shapes = { line: [], rectangle: [], polygon: [] };
  let tool = "move";
  const path = svg("path", { class: "outline-shape" });
  const shadow = svg("path", { class: "outline-shadow" });
  const corners = svg("g");
  const drawing = svg("svg", { class: "over shapes" }, shadow, path, corners);

  /** @returns {Point} */
  const within = ([x, y]) => [Math.min(view().width, Math.max(0, x)), Math.min(view().height, Math.max(0, y))];
  const complete = () => (tool === "polygon" ? shapes.polygon.length >= 3 : (shapes[tool]?.length ?? 0) === 2);
  const tellOf = () => changed(tool, complete() ? outline() : null);

  /** Corners as they count: those of rectangles are whole pixels. */
  function outline() {
    const points = shapes[tool];
    if (tool !== "rectangle") return points;
    const [[x0, y0], [x1, y1]] = points;
    return /** @type {Point[]} */ ([[Math.floor(Math.min(x0, x1)), Math.floor(Math.min(y0, y1))], [Math.ceil(Math.max(x0, x1)), Math.ceil(Math.max(y0, y1))]]);
  }

  function handle(k) {
    const circle = svg("circle", { r: 12, tabindex: 0, role: "slider", class: "end", "aria-valuenow": 0 });
    circle.addEventListener("pointerdown", (event) => { circle.setPointerCapture(event.pointerId); event.preventDefault(); circle.focus(); }, { signal });
    circle.addEventListener("pointermove", (event) => {
      if (!circle.hasPointerCapture(event.pointerId)) return;
      const box = drawing.getBoundingClientRect();
      put(k, view().toMap([event.clientX - box.left, event.clientY - box.top]));
    }, { signal });
    circle.addEventListener("keydown", (event) => {
      const by = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      if (event.key === "Delete" || event.key === "Backspace") remove(k);
      else if (by) put(k, [shapes[tool][k][0] + by[0] * (event.shiftKey ? 10 : 1), shapes[tool][k][1] + by[1] * (event.shiftKey ? 10 : 1)]);
      else return;
      event.preventDefault();
    }, { signal });
    return circle;
  }

  function put(k, /** @type {Point} */ point) {
    shapes[tool][k] = within(point);
    refresh();
    tellOf();
  }

  /** Takes away a corner of a polygon, or a whole line or rectangle. */
  function remove(k) {
    if (tool === "polygon") shapes.polygon.splice(k, 1);
    else shapes[tool] = [];
    refresh();
    tellOf();
  }

  /** Draws anew where the map is now. */
  function refresh() {
    const points = shapes[tool] ?? [];
    while (corners.childNodes.length > points.length) corners.lastChild?.remove();
    while (corners.childNodes.length < points.length) corners.append(handle(corners.childNodes.length));
    const at = points.map((p) => view().toCanvas(p));
    at.forEach(([x, y], k) => {
      const circle = /** @type {SVGCircleElement} */ (corners.childNodes[k]);
      circle.setAttribute("cx", x.toFixed(1));
      circle.setAttribute("cy", y.toFixed(1));
      circle.setAttribute("aria-label", CORNER[tool]?.[k] ?? `Corner ${k + 1}`);
      circle.setAttribute("aria-valuenow", String(Math.floor(points[k][0])));
      circle.setAttribute("aria-valuetext", `x ${Math.floor(points[k][0])}, y ${Math.floor(points[k][1])}`);
    });
    const drawn = at.length > 1 ? pathOf(tool, complete() ? outline().map((p) => view().toCanvas(p)) : at) : "";
    path.setAttribute("d", drawn);
    shadow.setAttribute("d", drawn);
  }

  return {
    drawing, refresh,
    get tool() { return tool; },
    get shape() { return complete() ? { tool, corners: outline() } : null; },
    /** Chooses a tool. One without a shape gets one in the middle of the view if `make` is set, as by the keyboard. */
    choose(/** @type {string} */ next, make = false) {
      tool = next;
      if (make && tool !== "move" && !shapes[tool].length) {
        const { part: [left, top, right, bottom] } = view().sight();
        const at = (u, v) => /** @type {Point} */ ([Math.round(left + u * (right - left)), Math.round(top + v * (bottom - top))]);
        shapes[tool] = tool === "polygon" ? [at(0.5, 0.3), at(0.7, 0.65), at(0.3, 0.65)] : tool === "line" ? [at(0.25, 0.5), at(0.75, 0.5)] : [at(0.35, 0.35), at(0.65, 0.65)];
      }
      refresh();
      tellOf();
    },
    /** Takes away the shape of the tool. */
    clear() {
      if (tool === "move") return;
      shapes[tool] = [];
      refresh();
      tellOf();
    },
    /** Drags of the map; answers whether the tool takes them. */
    draws(/** @type {"down" | "move" | "up"} */ phase, /** @type {Point} */ point) {
      if (tool === "move") return false;
      const here = within(point);
      if (tool === "polygon") {
        if (phase === "up" && shapes.polygon.length < MOST_CORNERS) {
          shapes.polygon.push(here);
          refresh();
          tellOf();
        }
        return true;
      }
      if (phase === "down") shapes[tool] = [here];
      else if (phase === "move" || shapes[tool].length > 1) shapes[tool][1] = here;
      refresh();
      tellOf();
      return true;
    },
  };
}

/** The path of a shape through corners, in any coordinates. */
export function pathOf(/** @type {string} */ tool, /** @type {number[][]} */ points) {
  const text = (/** @type {number[]} */ [x, y]) => `${x.toFixed(1)} ${y.toFixed(1)}`;
  if (tool !== "rectangle") return `M${points.map(text).join("L")}${tool === "polygon" ? "Z" : ""}`;
  const [[x0, y0], [x1, y1]] = points;
  return `M${x0.toFixed(1)} ${y0.toFixed(1)}H${x1.toFixed(1)}V${y1.toFixed(1)}H${x0.toFixed(1)}Z`;
}
