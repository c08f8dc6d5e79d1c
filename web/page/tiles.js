// Tiles of the numbers of maps, fetched as they are wanted. The least recently used ones are dropped.

import { send } from "./api.js";

/** Pixels along the side of a tile. */
export const TILE = 256;
/** Most tiles that are kept: 48 MiB of numbers. */
const MOST = 192;
/** Requests at once: a browser has six connections for a host, and STOP must not wait for one. */
const AT_ONCE = 3;
/** Time after which a tile that could not be fetched is asked for again, in ms. */
const REST = 5000;

/** The tiles of one result. */
export class TileStore {
  /**
   * @param {string} base path of the result
   * @param {{ arrived: () => void, complain: (problem: Error) => void, signal: AbortSignal }} calls
   */
  constructor(base, { arrived, complain, signal }) {
    this.base = base;
    this.arrived = arrived;
    this.complain = complain;
    this.signal = signal;
    /** @type {Map<string, Tile>} In the order of their use. */
    this.kept = new Map();
    /** @type {{ key: string, info: MapInfo, level: number, column: number, row: number }[]} */
    this.wanted = [];
    /** @type {Set<string>} */
    this.asked = new Set();
    /** @type {Map<string, number>} When tiles could not be fetched, in ms. */
    this.failed = new Map();
  }

  /**
   * A tile if it is there. Otherwise it is fetched if `wanted`.
   * @param {MapInfo} info
   * @param {number} level
   * @param {number} column
   * @param {number} row
   */
  tile(info, level, column, row, wanted = true) {
    const key = `${info.name}/${level}/${column}/${row}`;
    const found = this.kept.get(key);
    if (found) {
      this.kept.delete(key);
      this.kept.set(key, found);
      return found;
    }
    const rests = Date.now() - (this.failed.get(key) ?? 0) < REST;
    if (wanted && !rests && !this.asked.has(key) && !this.wanted.some((w) => w.key === key)) {
      this.wanted.push({ key, info, level, column, row });
      this.#next();
    }
    return null;
  }

  /** Whether all wanted tiles are there. */
  get idle() {
    return this.wanted.length === 0 && this.asked.size === 0;
  }

  /** Drops wishes that no request has begun for, as the view has moved on. */
  forgetWishes() {
    this.wanted.length = 0;
  }

  #next() {
    while (this.asked.size < AT_ONCE && this.wanted.length && !this.signal.aborted) {
      const wish = this.wanted.shift();
      if (wish) this.#fetch(wish);
    }
  }

  async #fetch({ key, info, level, column, row }) {
    this.asked.add(key);
    try {
      const path = `${this.base}/tiles/${encodeURIComponent(info.name)}/${level}/${column}/${row}`;
      const bytes = await (await send(path, { signal: this.signal })).arrayBuffer();
      const width = Math.min(TILE, Math.ceil(info.width / 2 ** level) - TILE * column);
      const values = new Float32Array(bytes);
      this.kept.set(key, { key, values, width, height: values.length / width });
      for (const old of this.kept.keys()) {
        if (this.kept.size <= MOST) break;
        this.kept.delete(old);
      }
    } catch (problem) {
      this.failed.set(key, Date.now());
      if (problem.name !== "AbortError") this.complain(problem);
    }
    this.asked.delete(key);
    this.#next();
    if (!this.signal.aborted) this.arrived();
  }
}
