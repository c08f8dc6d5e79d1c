// A chessboard to print at its true size, as an SVG.

import { svg } from "./dom.js";

// White around the board, without which its outer corners are not found, in squares.
const MARGIN = 0.75;

/**
 * The text of the picture of a board with so many inner corners and squares of so many mm; and its size in mm.
 * @param {number} across
 * @param {number} down
 * @param {number} square
 */
export function boardSheet(across, down, square) {
  const [columns, rows] = [across + 1, down + 1];
  const size = [columns, rows].map((n) => (n + 2 * MARGIN) * square);
  const places = Array.from({ length: columns * rows }, (_, k) => [k % columns, Math.floor(k / columns)]);
  const dark = places.filter(([x, y]) => (x + y) % 2 === 0);
  const sheet = svg("svg", { width: `${size[0]}mm`, height: `${size[1]}mm`, viewBox: `0 0 ${size[0]} ${size[1]}` },
    svg("rect", { width: size[0], height: size[1], fill: "#fff" }),
    dark.map(([x, y]) => svg("rect", { x: (x + MARGIN) * square, y: (y + MARGIN) * square, width: square, height: square, fill: "#000" })));
  return { text: new XMLSerializer().serializeToString(sheet), size };
}
