// Palettes of maps by name: sequential and diverging ones for numbers, cyclic ones for directions.

import { viridisBytes } from "./legend.js";
import { CYCLIC } from "./palette.js";

/** Colours of a table; masked pixels have the one behind them. */
export const STEPS = 1024;
/** sRGB bytes of masked pixels, as in the pictures of the service. */
export const MASKED = [64, 64, 64];

// Every 8th colour of inferno and cividis (CC0): S. van der Walt and N. Smith (2015), J. Nuñez and others (2018).
const INFERNO = "000004 040312 0b0724 150b37 210c4a 2e0a5a 3c0965 4a0c6b 57106d 63146e 70196e 7d1e6d 89226a 962766 a32b61 af315c bb3755 c63e4d d14644 db4f3b e35932 eb6528 f1711e f67f14 f98d0a fb9c06 fcab0f fbba1f f9ca32 f5d949 f2e865 f3f586 fcffa4";
const CIVIDIS = "00224e 00285b 002e6a 043371 1a386f 273e6e 32436d 3b496c 434e6c 4b546c 52596d 5a5f6e 61656f 686a71 6f7073 757676 7c7b78 848179 8b8778 938d78 9b9376 a39a75 aba072 b3a670 bbad6c c3b469 ccba64 d4c15f ddc958 e6d051 efd748 f8df3c fee838";
// Equal steps of lightness in OKLab from blue and from red to a light grey.
const BLUE_RED = "074689 1e5da6 3674bf 518bd4 6fa2e4 8fb9ef b1cff6 d4e4f8 f5f5f5 f7dad6 f3bdb6 eaa097 dd837a ca685e b44e46 9a3731 7e231f";

const bytesOf = (/** @type {string} */ hex) => [0, 2, 4].map((i) => parseInt(hex.slice(i, i + 2), 16));

/** A palette through colours at even distances. */
function through(/** @type {string[]} */ hexes, cyclic = false) {
  const colors = hexes.map(bytesOf);
  const count = cyclic ? colors.length : colors.length - 1;
  return (/** @type {number} */ t) => {
    const at = Math.min(1, Math.max(0, t)) * count;
    const k = Math.min(count - 1, Math.floor(at));
    const [a, b] = [colors[k], colors[(k + 1) % colors.length]];
    return a.map((v, i) => Math.round(v + (at - k) * (b[i] - v)));
  };
}

/** A saturated hue; once around for 0 to 1. */
function hue(/** @type {number} */ t) {
  return [5, 3, 1].map((n) => {
    const k = (n + 6 * t) % 6;
    return Math.round(255 * (1 - Math.min(1, Math.max(0, Math.min(k, 4 - k)))));
  });
}

/** @type {Record<string, { title: string, directions: boolean, at: (t: number) => number[] }>} */
const ALL = {
  viridis: { title: "Viridis", directions: false, at: (t) => viridisBytes(Math.min(1, Math.max(0, t))) },
  cividis: { title: "Cividis", directions: false, at: through(CIVIDIS.split(" ")) },
  inferno: { title: "Inferno", directions: false, at: through(INFERNO.split(" ")) },
  grey: { title: "Grey", directions: false, at: (t) => Array(3).fill(Math.round(255 * Math.min(1, Math.max(0, t)))) },
  blue_red: { title: "Blue–red", directions: false, at: through(BLUE_RED.split(" ")) },
  cyclic: { title: "Cyclic", directions: true, at: through(CYCLIC, true) },
  hsv: { title: "HSV", directions: true, at: hue },
};

/** Names and titles of the palettes for directions or for numbers. */
export const palettesFor = (/** @type {boolean} */ directions) =>
  Object.entries(ALL).filter(([, p]) => p.directions === directions).map(([name, { title }]) => [name, title]);

/** sRGB bytes of 0 to 1 in a palette. */
export const colorAt = (/** @type {string} */ name, /** @type {number} */ t) => ALL[name].at(t);

/** Red of 0 to 1 in the lowest byte, then green, blue and opacity, as canvases of little-endian machines store it. */
const packed = (/** @type {number[]} */ [r, g, b]) => ((255 << 24) | (b << 16) | (g << 8) | r) >>> 0;

/** The colours of a palette from 0 to 1, and behind them that of masked pixels. */
export function tableOf(/** @type {string} */ name) {
  const table = new Uint32Array(STEPS + 1);
  for (let i = 0; i < STEPS; i++) table[i] = packed(ALL[name].at(i / (ALL[name].directions ? STEPS : STEPS - 1)));
  table[STEPS] = packed(MASKED);
  return table;
}
