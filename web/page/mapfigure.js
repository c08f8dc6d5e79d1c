// A map as a figure: the visible part with title, colours, unit and scale bar, as SVG and PNG.

import { svg } from "./dom.js";
import { pathOf } from "./mapshapes.js";
import { roundLength, shownIn, ticks, titleOf } from "./mapvalues.js";
import { MASKED, colorAt } from "./palettes.js";
import { plain } from "./format.js";

const [MARGIN, HEAD, SIDE] = [12, 34, 118];
/** Pixels of the PNG per unit of the SVG. */
const SHARPNESS = 2;
const FONT = "system-ui, sans-serif";

const rgb = (/** @type {number[]} */ color) => `rgb(${color.join(",")})`;
const text = (x, y, words, more = {}) => svg("text", { x, y, "font-family": FONT, "font-size": 13, fill: "#1a2024", ...more }, words);

/** The bar of numbers with round marks. */
function bar(info, palette, /** @type {number[]} */ [low, high], x, top, tall) {
  const { factor, unit } = shownIn(info);
  const steps = 128;
  const y = (value) => top + tall * (1 - (value - low) / (high - low));
  const shades = Array.from({ length: steps }, (_, k) => svg("rect", { x, y: top + tall * (1 - (k + 1) / steps), width: 16, height: tall / steps + 0.5, fill: rgb(colorAt(palette, (k + 0.5) / steps)) }));
  const marks = ticks(low * factor, high * factor, 5).map((v) => [svg("line", { x1: x + 16, x2: x + 20, y1: y(v / factor), y2: y(v / factor), stroke: "#1a2024" }), text(x + 24, y(v / factor) + 4, plain(Number(v.toPrecision(4))))]);
  return [...shades, svg("rect", { x, y: top, width: 16, height: tall, fill: "none", stroke: "#1a2024", "stroke-width": 0.8 }), ...marks.flat(), unit ? text(x, top - 8, unit.trim()) : null];
}

/** The wheel of directions. */
function wheel(palette, cx, cy, radius) {
  const at = (deg, r) => `${(cx + r * Math.cos((deg * Math.PI) / 180)).toFixed(2)} ${(cy - r * Math.sin((deg * Math.PI) / 180)).toFixed(2)}`;
  const wedges = Array.from({ length: 120 }, (_, k) => {
    const [a, b] = [3 * k, 3 * k + 3.2];
    return svg("path", { d: `M${at(a, radius)}L${at(b, radius)}L${at(b, radius / 2)}L${at(a, radius / 2)}Z`, fill: rgb(colorAt(palette, ((a + 1.5) % 180) / 180)) });
  });
  const labels = [0, 45, 90, 135].map((deg) => {
    const [x, y] = at(deg, radius + 13).split(" ").map(Number);
    return text(x, y + 4, `${deg}°`, { "text-anchor": "middle", "font-size": 11 });
  });
  return [...wedges, ...labels];
}

/**
 * The figure as an SVG element.
 * @param {{ picture: HTMLCanvasElement, ratio: number, title: string, info: MapInfo, palette: string, ends: number[], scale: number,
 *   shape: { tool: string, corners: number[][] } | null }} options `ratio` in pixels of the picture per CSS pixel, `scale` in
 *   CSS pixels per pixel of the map, corners of the shape in CSS pixels
 */
export function figure({ picture, ratio, title, info, palette, ends, scale, shape }) {
  const [width, height] = [picture.width / ratio, picture.height / ratio];
  const [all, tall] = [width + 2 * MARGIN + SIDE, Math.max(height, 170) + HEAD + MARGIN];
  const [left, top] = [MARGIN, HEAD];
  const { pixels, words } = roundLength(info.pixel_um, Math.min(0.3 * width, 180) / scale);
  const long = pixels * scale;
  const box = Math.max(long, 8 * words.length) + 14;
  const [bx, by] = [left + width - box - 8, top + height - 38];
  const x = left + width + 16;
  const legend = info.kind === "direction" ? wheel(palette, x + 44, top + 62, 34) : info.kind === "mask" ? [] : bar(info, palette, ends, x, top + 18, Math.min(height - 50, 260));
  const key = info.kind === "direction" ? top + 128 : top + Math.min(height - 50, 260) + 34;
  const clip = svg("clipPath", { id: "map" }, svg("rect", { x: left, y: top, width, height }));
  return svg("svg", { viewBox: `0 0 ${all} ${tall}`, width: all, height: tall },
    svg("title", {}, title), svg("defs", {}, clip), svg("rect", { width: all, height: tall, fill: "#ffffff" }),
    text(left, 22, title, { "font-size": 15, "font-weight": 600 }),
    svg("image", { x: left, y: top, width, height, href: picture.toDataURL("image/png"), preserveAspectRatio: "none" }),
    shape ? svg("path", { d: pathOf(shape.tool, shape.corners.map(([px, py]) => [left + px, top + py])), fill: "none", stroke: "#f4cf8a", "stroke-width": 2, "clip-path": "url(#map)" }) : null,
    svg("rect", { x: bx, y: by, width: box, height: 30, fill: "#08090a", "fill-opacity": 0.7 }),
    text(bx + box / 2, by + 15, words, { fill: "#ffffff", "text-anchor": "middle", "font-size": 12 }),
    svg("rect", { x: bx + (box - long) / 2, y: by + 21, width: long, height: 3, fill: "#ffffff" }),
    ...legend,
    svg("rect", { x, y: key, width: 14, height: 14, fill: rgb(MASKED) }), text(x + 20, key + 12, "masked"));
}

/** An SVG element as a file. */
export const svgFile = (/** @type {SVGElement} */ element) => new Blob(["<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n", new XMLSerializer().serializeToString(element)], { type: "image/svg+xml" });

/** An SVG element as a PNG. */
export async function pngOf(/** @type {SVGElement} */ element) {
  const url = URL.createObjectURL(svgFile(element));
  try {
    const image = new Image();
    image.src = url;
    await image.decode();
    const canvas = document.createElement("canvas");
    canvas.width = Math.round(SHARPNESS * Number(element.getAttribute("width")));
    canvas.height = Math.round(SHARPNESS * Number(element.getAttribute("height")));
    canvas.getContext("2d")?.drawImage(image, 0, 0, canvas.width, canvas.height);
    return await new Promise((resolve, reject) => canvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error("The browser made no PNG of the figure."))), "image/png"));
  } finally {
    URL.revokeObjectURL(url);
  }
}

/** Name of a figure without its ending. */
export const figureName = (/** @type {string} */ named, /** @type {MapInfo} */ info) => `${named}-${titleOf(info).toLowerCase().replace(/[^a-z0-9σ]+/g, "-").replaceAll("σ", "sigma")}-figure`;
