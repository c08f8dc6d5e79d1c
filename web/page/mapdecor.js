// Drawn over a map: its scale bar, and lines that show directions.

import { roundLength } from "./mapvalues.js";

/** Distance of direction lines in CSS pixels. */
const SPACING = 26;

/**
 * The scale bar at the lower right corner of a picture of `width` × `height` device pixels.
 * @param {CanvasRenderingContext2D} context
 * @param {{ width: number, height: number, scale: number, ratio: number, pixelUm: number | null }} options `scale` in device
 *   pixels per pixel of the map, `ratio` in device pixels per CSS pixel
 */
export function drawScaleBar(context, { width, height, scale, ratio, pixelUm }) {
  const { pixels, words } = roundLength(pixelUm, Math.min(0.3 * width, 180 * ratio) / scale);
  const long = pixels * scale;
  context.save();
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.font = `${12 * ratio}px system-ui, sans-serif`;
  const wide = Math.max(long, context.measureText(words).width) + 14 * ratio;
  const tall = 30 * ratio;
  const [x, y] = [width - wide - 8 * ratio, height - tall - 8 * ratio];
  context.fillStyle = "rgb(8 9 10 / 70%)";
  context.fillRect(x, y, wide, tall);
  context.fillStyle = "#fff";
  context.textAlign = "center";
  context.textBaseline = "top";
  context.fillText(words, x + wide / 2, y + 5 * ratio);
  context.fillRect(x + (wide - long) / 2, y + tall - 9 * ratio, long, 3 * ratio);
  context.restore();
  return words;
}

/**
 * Short lines along the directions of a map, on an even grid; masked pixels have none.
 * @param {CanvasRenderingContext2D} context
 * @param {import("./maplayer.js").MapLayer} layer
 * @param {Sight} sight
 * @param {number} ratio device pixels per CSS pixel
 */
export function drawDirections(context, layer, { part: [left, top, right, bottom], scale, origin }, ratio) {
  const step = Math.max(1, Math.round((SPACING * ratio) / scale));
  const reach = 0.42 * Math.min(step * scale, SPACING * ratio * 2);
  const level = layer.level(scale);
  context.save();
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.beginPath();
  for (let y = Math.floor(top / step) * step + (step >> 1); y < bottom; y += step) {
    for (let x = Math.floor(left / step) * step + (step >> 1); x < right; x += step) {
      const found = layer.value(Math.min(x, layer.info.width - 1), Math.min(y, layer.info.height - 1), level);
      if (!found || !Number.isFinite(found.value)) continue;
      // Angles count anticlockwise, and rows of the picture run downwards.
      const [dx, dy] = [reach * Math.cos(found.value), -reach * Math.sin(found.value)];
      const [cx, cy] = [origin[0] + (x + 0.5) * scale, origin[1] + (y + 0.5) * scale];
      context.moveTo(cx - dx, cy - dy);
      context.lineTo(cx + dx, cy + dy);
    }
  }
  context.lineCap = "round";
  for (const [color, thick] of /** @type {[string, number][]} */ ([["#000", 3.4], ["#fff", 1.5]])) {
    context.strokeStyle = color;
    context.lineWidth = thick * ratio;
    context.stroke();
  }
  context.restore();
}
