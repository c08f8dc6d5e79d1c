// A map under mouse, fingers and keys: pan, zoom, pick. Knows nothing of what the map means.

import { pen } from "./dom.js";

const MOST_ZOOM = 64;
const CLICK_PX = 4;

/**
 * Shows a map of `width` × `height` pixels on a canvas. `paint(context, sight)` draws the visible part. `pick(x, y)` gets
 * the chosen pixel, `hover` the pixel below the pointer or null; `moved` is called with every change of place or zoom.
 * `draws(phase, point)` may take over a drag: it answers true at "down" if so, and then gets "move" and "up". `key` answers
 * whether it took a key.
 */
export class MapView {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {{ width: number, height: number, paint: (context: CanvasRenderingContext2D, view: Sight) => void, moved: () => void,
   *   pick: (x: number, y: number) => void, hover: (pixel: Point | null) => void,
   *   draws: (phase: "down" | "move" | "up", point: Point) => boolean, key: (event: KeyboardEvent) => boolean, signal: AbortSignal }} options
   */
  constructor(canvas, { width, height, paint, moved, pick, hover, draws, key, signal }) {
    this.canvas = canvas;
    this.width = width;
    this.height = height;
    this.paint = paint;
    this.moved = moved;
    this.pick = pick;
    this.hover = hover;
    this.draws = draws;
    this.key = key;
    this.context = pen(canvas);
    // Screen pixels (CSS) per map pixel, and the map's point in the middle of the canvas.
    // It is known once the canvas has a size.
    this.zoom = 0;
    this.lastFit = 0;
    /** @type {Point} */
    this.middle = [width / 2, height / 2];
    /** @type {{ x: number, y: number, deg: number | null } | null} */
    this.picked = null;
    this.travelled = 0;
    this.drawing = false;
    this.drew = false;
    this.due = 0;
    /** @type {Map<number, Point>} */
    this.pointers = new Map();
    const calls = { wheel: this.#wheel, pointerdown: this.#down, pointermove: this.#move, pointerup: this.#up, pointercancel: this.#cancel, pointerleave: this.#leave, keydown: this.#key, dblclick: this.#double };
    for (const [name, call] of Object.entries(calls)) {
      canvas.addEventListener(name, (event) => call.call(this, event), { signal, passive: false });
    }
    const observer = new ResizeObserver(() => this.#resize());
    observer.observe(canvas);
    signal.addEventListener("abort", () => observer.disconnect());
  }

  /** Marks a pixel, with its orientation in degrees if it has one. */
  mark(x, y, deg) {
    this.picked = { x, y, deg };
    this.draw();
  }

  /** Shows all of the map. */
  fit() {
    this.zoom = this.#fitting();
    this.middle = [this.width / 2, this.height / 2];
    this.#changed();
  }

  /**
   * Zooms about a point of the canvas, its middle by default.
   * @param {number} factor
   * @param {Point} [point]
   */
  scale(factor, point = [this.#size()[0] / 2, this.#size()[1] / 2]) {
    const [mx, my] = this.toMap(point);
    const least = Math.min(1, this.#fitting());
    this.zoom = Math.min(MOST_ZOOM, Math.max(least, this.zoom * factor));
    const [nx, ny] = this.toMap(point);
    this.#moveTo(this.middle[0] + mx - nx, this.middle[1] + my - ny);
  }

  /**
   * The map's point under a point of the canvas. Pixels begin at integers.
   * @param {Point} point
   * @returns {Point}
   */
  toMap([x, y]) {
    const [w, h] = this.#size();
    return [this.middle[0] + (x - w / 2) / this.zoom, this.middle[1] + (y - h / 2) / this.zoom];
  }

  /**
   * The canvas's point over a point of the map.
   * @param {Point} point
   * @returns {Point}
   */
  toCanvas([x, y]) {
    const [w, h] = this.#size();
    return [w / 2 + (x - this.middle[0]) * this.zoom, h / 2 + (y - this.middle[1]) * this.zoom];
  }

  #size() {
    return [this.canvas.clientWidth || 1, this.canvas.clientHeight || 1];
  }

  #fitting() {
    const [w, h] = this.#size();
    return Math.min(w / this.width, h / this.height);
  }

  #moveTo(x, y) {
    // The middle of the view stays on the map, so that it cannot be lost.
    this.middle = [Math.min(this.width, Math.max(0, x)), Math.min(this.height, Math.max(0, y))];
    this.#changed();
  }

  #changed() {
    this.draw();
    this.moved();
  }

  #resize() {
    const [w, h] = this.#size();
    const fitted = this.zoom === 0 || Math.abs(this.zoom - this.lastFit) < 1e-9;
    this.canvas.width = Math.round(w * devicePixelRatio);
    this.canvas.height = Math.round(h * devicePixelRatio);
    this.lastFit = this.#fitting();
    if (fitted) this.zoom = this.lastFit;
    this.#changed();
  }

  /** Draws with the next frame. */
  draw() {
    if (this.due === 0) this.due = requestAnimationFrame(() => { this.due = 0; this.#drawNow(); });
  }

  /** The visible part, in pixels of the map and of the device. */
  sight() {
    const [w, h] = this.#size();
    const [left, top] = this.toMap([0, 0]);
    const [right, bottom] = this.toMap([w, h]);
    const scale = this.zoom * devicePixelRatio;
    return {
      part: [Math.max(0, left), Math.max(0, top), Math.min(this.width, right), Math.min(this.height, bottom)],
      scale, origin: [-left * scale, -top * scale],
    };
  }

  #drawNow() {
    if (this.zoom === 0) return;
    const { context, canvas, zoom } = this;
    const [w, h] = this.#size();
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, canvas.width, canvas.height);
    this.paint(context, this.sight());
    if (!this.picked) return;
    context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    context.translate(w / 2 - this.middle[0] * zoom, h / 2 - this.middle[1] * zoom);
    this.#drawMark(this.picked);
  }

  #drawMark(picked) {
    const { context, zoom } = this;
    context.save();
    context.translate((picked.x + 0.5) * zoom, (picked.y + 0.5) * zoom);
    const reach = Math.max(9, zoom * 0.75);
    const path = new Path2D();
    path.rect(-Math.max(zoom / 2, 3), -Math.max(zoom / 2, 3), Math.max(zoom, 6), Math.max(zoom, 6));
    if (typeof picked.deg === "number") {
      const angle = (-picked.deg * Math.PI) / 180;
      const [c, s] = [Math.cos(angle), Math.sin(angle)];
      for (const side of [-1, 1]) {
        path.moveTo(side * reach * c, side * reach * s);
        path.lineTo(side * (reach + 16) * c, side * (reach + 16) * s);
      }
    }
    const stroke = (/** @type {string} */ color, /** @type {number} */ thick) => {
      context.strokeStyle = color;
      context.lineWidth = thick;
      context.stroke(path);
    };
    stroke("#000", 4);
    stroke("#fff", 1.8);
    context.restore();
  }

  /** @returns {Point} */
  #point(event) {
    const box = this.canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  #wheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : 1;
    this.scale(Math.exp(-event.deltaY * lines * 0.0015), this.#point(event));
  }

  #double(event) {
    if (!this.drew) this.scale(2, this.#point(event));
  }

  #down(event) {
    if (event.button !== 0) return;
    this.canvas.setPointerCapture(event.pointerId);
    if (this.pointers.size === 0) this.travelled = 0;
    this.pointers.set(event.pointerId, this.#point(event));
    this.drawing = this.drew = this.pointers.size === 1 && this.draws("down", this.toMap(this.#point(event)));
  }

  #move(event) {
    const before = this.pointers.get(event.pointerId);
    const now = this.#point(event);
    const [x, y] = this.toMap(now).map(Math.floor);
    this.hover(this.#holds(x, y) ? [x, y] : null);
    if (!before) return;
    const others = [...this.pointers].filter(([id]) => id !== event.pointerId).map(([, p]) => p);
    this.pointers.set(event.pointerId, now);
    this.travelled += Math.hypot(now[0] - before[0], now[1] - before[1]);
    if (this.travelled < CLICK_PX) return;
    if (this.drawing && !others.length) {
      this.draws("move", this.toMap(now));
    } else if (others.length) {
      const distance = (p) => Math.hypot(p[0] - others[0][0], p[1] - others[0][1]) || 1;
      this.scale(distance(now) / distance(before), others[0]);
    } else {
      this.#moveTo(this.middle[0] - (now[0] - before[0]) / this.zoom, this.middle[1] - (now[1] - before[1]) / this.zoom);
    }
  }

  #up(event) {
    const point = this.pointers.get(event.pointerId);
    this.pointers.delete(event.pointerId);
    if (!point || this.pointers.size) return;
    if (this.drawing) this.draws("up", this.toMap(point));
    else if (this.travelled < CLICK_PX) this.#pickAt(this.toMap(point));
    this.drawing = false;
  }

  #leave(event) {
    // A finger leaves with every tap, and the value is to stay.
    if (event.pointerType !== "touch") this.hover(null);
  }

  #cancel(event) {
    this.pointers.delete(event.pointerId);
    this.drawing = false;
  }

  #holds(x, y) {
    return x >= 0 && y >= 0 && x < this.width && y < this.height;
  }

  /** @param {Point} point */
  #pickAt([x, y]) {
    const [px, py] = [Math.floor(x), Math.floor(y)];
    if (!this.#holds(px, py)) return;
    this.hover([px, py]);
    this.pick(px, py);
  }

  #key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (this.key(event)) return event.preventDefault();
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (step && event.shiftKey) {
      const { x, y } = this.picked ?? { x: this.middle[0], y: this.middle[1] };
      this.#pickAt([x + step[0] + 0.001, y + step[1] + 0.001]);
    } else if (step) this.#moveTo(this.middle[0] + (40 * step[0]) / this.zoom, this.middle[1] + (40 * step[1]) / this.zoom);
    else if (event.key === "+" || event.key === "=") this.scale(1.4);
    else if (event.key === "-") this.scale(1 / 1.4);
    else if (event.key === "0") this.fit();
    else if (event.key === "Enter") this.#pickAt(this.middle);
    else return;
    event.preventDefault();
  }
}
