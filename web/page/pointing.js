// How a person points at a view: drags, clicks, wheels; and the disc on which the light is moved.

import { h, pen, say } from "./dom.js";
import { degrees } from "./format.js";
import { fromDisc, toDisc } from "./turning.js";

/**
 * Drags, clicks, hovers and wheels of a canvas, in CSS pixels. `pan` is told of drags with two fingers, the right or the middle button, or
 * Ctrl; `zoom` of wheels and of fingers that part, with the place that is to stay.
 * @param {HTMLCanvasElement} canvas
 * @param {{ drag: (by: Point, event: PointerEvent) => void, pan: (by: Point) => void, zoom: (factor: number, at: Point) => void,
 *   click: (at: Point) => void, hover: (at: Point | null) => void, again: () => void, signal: AbortSignal }} calls
 */
export function pointers(canvas, { drag, pan, zoom, click, hover, again, signal }) {
  /** @type {Map<number, Point>} Where each button or finger that is down was last. */
  const down = new Map();
  let far = 0;
  /** @returns {Point} */
  const at = (event) => [event.offsetX, event.offsetY];
  const on = (name, call) => canvas.addEventListener(name, call, { signal, passive: false });
  on("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    if (down.size === 0) far = 0;
    down.set(event.pointerId, at(event));
  });
  on("pointermove", (event) => {
    const last = down.get(event.pointerId);
    const now = at(event);
    if (!last) return hover(now);
    /** @type {Point} */
    const by = [now[0] - last[0], now[1] - last[1]];
    far += Math.hypot(...by);
    // A hand that clicks is never quite still.
    if (far < 3) return;
    const other = [...down].find(([id]) => id !== event.pointerId)?.[1];
    down.set(event.pointerId, now);
    if (other) {
      // Each finger carries half of what lies between them.
      pan([by[0] / 2, by[1] / 2]);
      const apart = (p) => Math.max(1, Math.hypot(p[0] - other[0], p[1] - other[1]));
      zoom(apart(now) / apart(last), [(now[0] + other[0]) / 2, (now[1] + other[1]) / 2]);
    } else if (event.ctrlKey || event.buttons & 6) pan(by);
    else drag(by, event);
  });
  on("pointerup", (event) => {
    if (down.delete(event.pointerId) && down.size === 0 && far < 3 && event.button === 0) click(at(event));
  });
  on("pointercancel", (event) => down.delete(event.pointerId));
  on("pointerleave", () => hover(null));
  on("contextmenu", (event) => event.preventDefault());
  on("dblclick", again);
  on("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp(-event.deltaY / 500), at(event));
  });
}

/** The light from above: a disc whose middle is straight above the sample and whose rim is its plane. */
export function lightDisc(state, change, signal) {
  const size = 132;
  const canvas = h("canvas", { class: "wheel", id: "view-light", width: 2 * size, height: 2 * size, tabindex: 0, role: "application",
    "aria-label": "Where the light is, seen from above the sample. Arrow keys move it." });
  canvas.style.width = canvas.style.height = `${size}px`;
  const text = h("output", { class: "soft" });
  const draw = () => {
    const context = pen(canvas);
    const ink = getComputedStyle(canvas).color;
    context.resetTransform();
    context.clearRect(0, 0, 2 * size, 2 * size);
    context.translate(size, size);
    context.strokeStyle = context.fillStyle = ink;
    context.lineWidth = 1.5;
    for (const radius of [1, 2 / 3, 1 / 3]) {
      context.globalAlpha = radius === 1 ? 1 : 0.35;
      context.beginPath();
      context.arc(0, 0, radius * 0.92 * size, 0, 2 * Math.PI);
      context.stroke();
    }
    context.globalAlpha = 1;
    const [x, y] = toDisc(state).map((v) => v * 0.92 * size);
    context.beginPath();
    context.moveTo(0, 0);
    context.lineTo(x, -y);
    context.stroke();
    context.beginPath();
    context.arc(x, -y, 13, 0, 2 * Math.PI);
    context.fillStyle = "#f4cf8a";
    context.fill();
    context.stroke();
    say(text, `azimuth ${degrees(state.azimuth, 0)}, elevation ${degrees(state.elevation, 0)}`);
  };
  const move = (x, y) => {
    change(fromDisc([x, y]));
    draw();
  };
  const place = (event) => move((event.offsetX - size / 2) / (0.46 * size), -(event.offsetY - size / 2) / (0.46 * size));
  canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); place(event); }, { signal });
  canvas.addEventListener("pointermove", (event) => { if (event.buttons) place(event); }, { signal });
  canvas.addEventListener("keydown", (event) => {
    const by = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (!by) return;
    event.preventDefault();
    const [x, y] = toDisc(state);
    move(x + by[0] / 30, y + by[1] / 30);
  }, { signal });
  requestAnimationFrame(draw);
  return Object.assign(h("div", { class: "row" }, canvas, text), { refresh: draw });
}
