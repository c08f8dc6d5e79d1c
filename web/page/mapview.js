// A map under mouse, fingers and keys: pan, zoom, pick. Knows nothing of what the map means.

import { firstOf, pen, settle } from "./dom.js";

const MOST_ZOOM = 64;
const CLICK_PX = 4;

/**
 * Shows a map of `width` × `height` pixels on a canvas. `load(region, width, signal)` resolves to an ImageBitmap of a
 * region ([x, y, w, h], null for all) at most `width` pixels wide; `pick(x, y)` is called with the pixel chosen.
 */
export class MapView {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {{ width: number, height: number, load: (region: number[] | null, width: number, signal: AbortSignal) => Promise<ImageBitmap>,
   *   pick: (x: number, y: number) => void, complain: (problem: Error) => void, signal: AbortSignal }} options
   */
  constructor(canvas, { width, height, load, pick, complain, signal }) {
    this.canvas = canvas;
    this.width = width;
    this.height = height;
    this.load = load;
    this.pick = pick;
    this.complain = complain;
    this.signal = signal;
    this.context = pen(canvas);
    // Screen pixels (CSS) per map pixel, and the map's point in the middle of the canvas.
    // It is known once the canvas has a size.
    this.zoom = 0;
    this.lastFit = 0;
    /** @type {Point} */
    this.middle = [width / 2, height / 2];
    /** @type {ImageBitmap | null} */
    this.whole = null;
    /** @type {{ bitmap: ImageBitmap, region: [number, number, number, number] } | null} */
    this.detail = null;
    /** @type {{ x: number, y: number, deg: number | null } | null} */
    this.picked = null;
    /** @type {AbortController | null} */
    this.asking = null;
    this.travelled = 0;
    /** @type {Map<number, Point>} */
    this.pointers = new Map();
    this.generation = 0;
    this.sharpen = settle(150, () => this.#loadDetail());
    const calls = { wheel: this.#wheel, pointerdown: this.#down, pointermove: this.#move, pointerup: this.#up, pointercancel: this.#cancel, keydown: this.#key, dblclick: this.#double };
    for (const [name, call] of Object.entries(calls)) {
      canvas.addEventListener(name, (event) => call.call(this, event), { signal, passive: false });
    }
    const observer = new ResizeObserver(() => this.#resize());
    observer.observe(canvas);
    signal.addEventListener("abort", () => observer.disconnect());
  }

  /** Loads the picture anew, as after a change of what is shown. Place and zoom stay. */
  async reload() {
    const generation = ++this.generation;
    this.detail = null;
    try {
      const whole = await this.load(null, Math.min(this.width, 1536), this.signal);
      if (generation !== this.generation) return whole.close();
      this.whole?.close();
      this.whole = whole;
      this.#changed();
    } catch (problem) {
      this.complain(problem);
    }
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
   * The map's point under a point of the canvas.
   * @param {Point} point
   * @returns {Point}
   */
  toMap([x, y]) {
    const [w, h] = this.#size();
    return [this.middle[0] + (x - w / 2) / this.zoom, this.middle[1] + (y - h / 2) / this.zoom];
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
    this.sharpen();
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

  /** Draws what there is: the whole map, sharper detail over it, the mark. */
  draw() {
    if (this.zoom === 0) return;
    const { context, zoom } = this;
    const [w, h] = this.#size();
    context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    context.clearRect(0, 0, w, h);
    context.translate(w / 2 - this.middle[0] * zoom, h / 2 - this.middle[1] * zoom);
    // Pixels stay pixels when enlarged: between two hues no other may appear.
    const paint = (bitmap, x, y, width, height) => {
      context.imageSmoothingEnabled = width * zoom * devicePixelRatio < bitmap.width;
      context.drawImage(bitmap, x * zoom, y * zoom, width * zoom, height * zoom);
    };
    if (this.whole) paint(this.whole, 0, 0, this.width, this.height);
    if (this.detail) paint(this.detail.bitmap, ...this.detail.region);
    if (this.picked) this.#drawMark(this.picked);
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

  /** Fetches the visible part at full resolution, where the whole picture is too coarse. */
  async #loadDetail() {
    if (!this.whole || this.signal.aborted) return;
    const coarse = this.whole.width < this.width && this.zoom * devicePixelRatio * this.width > this.whole.width * 1.05;
    this.asking?.abort();
    if (!coarse) {
      this.detail = null;
      return;
    }
    const generation = this.generation;
    const [w, h] = this.#size();
    const [left, top] = this.toMap([0, 0]).map((v) => Math.max(0, Math.floor(v)));
    const [right, bottom] = this.toMap([w, h]);
    /** @type {[number, number, number, number]} */
    const region = [left, top, Math.min(this.width, Math.ceil(right)) - left, Math.min(this.height, Math.ceil(bottom)) - top];
    if (region[2] < 1 || region[3] < 1) return;
    this.asking = new AbortController();
    try {
      const pixels = Math.min(region[2], Math.ceil(region[2] * this.zoom * devicePixelRatio));
      const bitmap = await this.load(region, pixels, firstOf(this.signal, this.asking.signal));
      if (generation !== this.generation) return bitmap.close();
      this.detail?.bitmap.close();
      this.detail = { bitmap, region };
      this.draw();
    } catch (problem) {
      this.complain(problem);
    }
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
    this.scale(2, this.#point(event));
  }

  #down(event) {
    if (event.button !== 0) return;
    this.canvas.setPointerCapture(event.pointerId);
    if (this.pointers.size === 0) this.travelled = 0;
    this.pointers.set(event.pointerId, this.#point(event));
  }

  #move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const now = this.#point(event);
    const others = [...this.pointers].filter(([id]) => id !== event.pointerId).map(([, p]) => p);
    this.pointers.set(event.pointerId, now);
    this.travelled += Math.hypot(now[0] - before[0], now[1] - before[1]);
    if (this.travelled < CLICK_PX) return;
    if (others.length) {
      const distance = (p) => Math.hypot(p[0] - others[0][0], p[1] - others[0][1]) || 1;
      this.scale(distance(now) / distance(before), others[0]);
    } else {
      this.#moveTo(this.middle[0] - (now[0] - before[0]) / this.zoom, this.middle[1] - (now[1] - before[1]) / this.zoom);
    }
  }

  #up(event) {
    const point = this.pointers.get(event.pointerId);
    this.pointers.delete(event.pointerId);
    if (point && this.pointers.size === 0 && this.travelled < CLICK_PX) this.#pickAt(this.toMap(point));
  }

  #cancel(event) {
    this.pointers.delete(event.pointerId);
  }

  /** @param {Point} point */
  #pickAt([x, y]) {
    const [px, py] = [Math.floor(x), Math.floor(y)];
    if (px >= 0 && py >= 0 && px < this.width && py < this.height) this.pick(px, py);
  }

  #key(event) {
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
