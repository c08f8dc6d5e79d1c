// Maps as colours: tiles of numbers through a palette, the difference of two maps, and opacity by standard deviation.

import { h, pen } from "./dom.js";
import { MASKED, STEPS, tableOf } from "./palettes.js";
import { TILE } from "./tiles.js";

/** Coloured tiles that are kept. */
const MOST = 160;

/** A map that is drawn. */
export class MapLayer {
  /**
   * @param {import("./tiles.js").TileStore} store
   * @param {MapInfo} info
   */
  constructor(store, info) {
    this.store = store;
    this.info = info;
    this.palette = info.kind === "direction" ? "cyclic" : info.kind === "mask" ? "grey" : "viridis";
    this.table = tableOf(this.palette);
    this.low = 0;
    this.high = 1;
    // Standard deviations that fade pixels out, down to nothing at `high`.
    /** @type {{ layer: MapLayer, high: number } | null} */
    this.fade = null;
    /** @type {Map<string, { canvas: HTMLCanvasElement, style: string }>} */
    this.painted = new Map();
  }

  /** Whether its values are angles of lines. */
  get isDirection() {
    return this.info.kind === "direction";
  }

  /** Sets palette and ends of the colours. */
  look(palette, low, high) {
    if (palette !== this.palette) this.table = tableOf(palette);
    Object.assign(this, { palette, low, high });
  }

  /**
   * A tile of numbers, if it is there.
   * @param {number} level
   * @param {number} column
   * @param {number} row
   * @returns {Tile | null}
   */
  tile(level, column, row, wanted = true) {
    return this.store.tile(this.info, level, column, row, wanted);
  }

  /** Value of a pixel and the level that it comes from; null while nothing is there, NaN where masked. */
  value(x, y, least = 0, wanted = true) {
    for (let level = least; level < this.info.levels; level++) {
      const [px, py] = [x >> level, y >> level];
      const tile = this.tile(level, Math.floor(px / TILE), Math.floor(py / TILE), wanted && level === least);
      if (tile) return { value: tile.values[(py % TILE) * tile.width + (px % TILE)], level };
    }
    return null;
  }

  /** Level of tiles for a zoom in device pixels per pixel of the map. */
  level(scale) {
    return Math.min(this.info.levels - 1, Math.max(0, Math.floor(Math.log2(1 / scale) + 0.25)));
  }

  /**
   * Draws the part [left, top, right, bottom] of the map at `scale` device pixels per pixel, with the map's corner at
   * `origin`.
   * @param {CanvasRenderingContext2D} context
   * @param {{ part: number[], scale: number, origin: number[] }} view
   * @returns {boolean} whether all of it is there
   */
  draw(context, { part, scale, origin }) {
    const level = this.level(scale);
    const { width, height } = this.info;
    const place = (v, k) => Math.round(origin[k] + v * scale);
    context.save();
    context.beginPath();
    context.rect(place(0, 0), place(0, 1), place(width, 0) - place(0, 0), place(height, 1) - place(0, 1));
    context.clip();
    const each = (/** @type {number} */ at, /** @type {(column: number, row: number) => void} */ call) => {
      const side = TILE * 2 ** at;
      for (let row = Math.floor(part[1] / side); row * side < part[3]; row++) {
        for (let column = Math.floor(part[0] / side); column * side < part[2]; column++) call(column, row);
      }
    };
    const put = (at, column, row, tile) => {
      const side = 2 ** at;
      const [x0, y0] = [place(column * TILE * side, 0), place(row * TILE * side, 1)];
      const [x1, y1] = [place((column * TILE + tile.width) * side, 0), place((row * TILE + tile.height) * side, 1)];
      // Pixels stay pixels when enlarged: between two hues no other may appear.
      context.imageSmoothingEnabled = scale * side < 1;
      context.drawImage(this.#paint(tile, at, column, row), x0, y0, x1 - x0, y1 - y0);
    };
    let missing = 0;
    each(level, (column, row) => { missing += Number(!this.tile(level, column, row)); });
    // Coarser tiles stand in for missing ones.
    for (let at = missing ? this.info.levels - 1 : level; at >= level; at--) {
      each(at, (column, row) => {
        const tile = this.tile(at, column, row, false);
        if (tile) put(at, column, row, tile);
      });
    }
    context.restore();
    return missing === 0;
  }

  #paint(tile, level, column, row) {
    const faded = this.fade?.layer.tile(level, column, row) ?? null;
    const style = `${this.palette} ${this.low} ${this.high} ${faded ? this.fade?.high : ""}`;
    const known = this.painted.get(tile.key);
    this.painted.delete(tile.key);
    if (known?.style === style) {
      this.painted.set(tile.key, known);
      return known.canvas;
    }
    const canvas = known?.canvas ?? h("canvas", { width: tile.width, height: tile.height });
    const context = pen(canvas);
    const image = context.createImageData(tile.width, tile.height);
    this.color(tile.values, new Uint32Array(image.data.buffer));
    if (faded && this.fade) fade(image.data, faded.values, this.fade.high);
    context.putImageData(image, 0, 0);
    this.painted.set(tile.key, { canvas, style });
    for (const old of this.painted.keys()) {
      if (this.painted.size <= MOST) break;
      this.painted.delete(old);
    }
    return canvas;
  }

  /** Colours of numbers. */
  color(/** @type {Float32Array} */ values, /** @type {Uint32Array} */ colors) {
    const { table } = this;
    if (this.isDirection) {
      const scale = STEPS / Math.PI;
      for (let i = 0; i < values.length; i++) {
        const v = values[i];
        colors[i] = Number.isFinite(v) ? table[(((Math.round(v * scale) % STEPS) + STEPS) % STEPS)] : table[STEPS];
      }
      return;
    }
    const scale = (STEPS - 1) / (this.high - this.low || 1);
    for (let i = 0; i < values.length; i++) {
      const v = values[i];
      colors[i] = Number.isFinite(v) ? table[Math.min(STEPS - 1, Math.max(0, Math.round((v - this.low) * scale)))] : table[STEPS];
    }
  }
}

/** Mixes colours with that of masked pixels, in proportion to σ. */
function fade(bytes, sigmas, high) {
  for (let i = 0; i < sigmas.length; i++) {
    const share = Number.isFinite(sigmas[i]) ? Math.min(1, Math.max(0, sigmas[i] / high)) : 1;
    for (let k = 0; k < 3; k++) bytes[4 * i + k] += share * (MASKED[k] - bytes[4 * i + k]);
  }
}

/** First map minus second one; of directions, the smaller angle between the lines with its sign. */
export class DifferenceLayer extends MapLayer {
  /**
   * @param {MapLayer} first
   * @param {MapLayer} second
   */
  constructor(first, second) {
    super(first.store, { ...first.info, name: `${first.info.name} difference`, kind: "number" });
    this.first = first;
    this.second = second;
    this.look("blue_red", -1, 1);
    /** @type {Map<string, Tile>} */
    this.made = new Map();
  }

  tile(level, column, row, wanted = true) {
    const [a, b] = [this.first.tile(level, column, row, wanted), this.second.tile(level, column, row, wanted)];
    if (!a || !b) return null;
    const key = `${a.key} ${b.key}`;
    let made = this.made.get(key);
    if (!made) {
      made = { key, width: a.width, height: a.height, values: a.values.map((v, i) => apart(v, b.values[i], this.first.isDirection)) };
      this.made.set(key, made);
      for (const old of this.made.keys()) {
        if (this.made.size <= MOST) break;
        this.made.delete(old);
      }
    }
    return made;
  }

  /** A symmetric range that holds 99 % of the differences that are there, or 1. */
  range() {
    const some = [];
    for (const { values } of this.made.values()) for (let i = 0; i < values.length; i += 13) if (Number.isFinite(values[i])) some.push(Math.abs(values[i]));
    some.sort((a, b) => a - b);
    return some[Math.floor(0.99 * (some.length - 1))] || 1;
  }
}

/** Difference of two values. */
export function apart(a, b, isDirection) {
  const d = a - b;
  return isDirection ? d - Math.PI * Math.round(d / Math.PI) : d;
}
