// Legends of maps: the wheel of orientations, the bar of numbers. The same colours as the service's pictures.

import { fixed } from "./format.js";
import { h, pen } from "./dom.js";
import { CYCLIC } from "./palette.js";

// Sixth-order fit of viridis by M. Zucker (CC0).
const VIRIDIS = [
  [0.27772733, 0.0054073445, 0.3340998], [0.10509304, 1.4046135, 1.3845901], [-0.33086183, 0.21484756, 0.095095160],
  [-4.6342305, -5.799101, -19.332441], [6.22827, 14.179933, 56.69055], [4.776385, -13.745145, -65.353033],
  [-5.435456, 4.6458526, 26.312435],
];

const byte = (value) => Math.round(255 * Math.min(1, Math.max(0, value)));

/** sRGB bytes of 0 to 1, dark to light. */
export const viridisBytes = (/** @type {number} */ t) => [0, 1, 2].map((i) => byte(VIRIDIS.reduceRight((sum, c) => sum * t + c[i], 0)));

/** Colour of 0 to 1, dark to light. */
export const viridis = (/** @type {number} */ t) => `rgb(${viridisBytes(t).join(" ")})`;

/** What the wheel of a palette says to those who do not see it. */
const SPOKEN = {
  cyclic: "pale yellow is 0°, along the picture's rows; blue 45°, near black 90°, brown 135°, anticlockwise",
  hsv: "red is 0°, along the picture's rows; yellow-green 45°, cyan 90°, violet 135°, anticlockwise",
};

/**
 * Colour of an orientation in degrees; the palette runs once through 180°.
 * @param {number} deg
 * @param {keyof SPOKEN} palette
 */
export function orientationColor(deg, palette) {
  if (palette === "hsv") return `hsl(${2 * deg} 100% 50%)`;
  const steps = CYCLIC.length / 180;
  return `#${CYCLIC[((Math.round(deg * steps) % CYCLIC.length) + CYCLIC.length) % CYCLIC.length]}`;
}

/** The wheel. An orientation is a line, so each colour is at both its ends; `mark(deg)` draws that line, `dye(palette)` changes the colours. */
export function wheel(size = 132) {
  const canvas = h("canvas", { class: "wheel", width: 2 * size, height: 2 * size, role: "img" });
  /** @type {keyof SPOKEN} */
  let palette = "cyclic";
  canvas.style.width = canvas.style.height = `${size}px`;
  const draw = (marked) => {
    const context = pen(canvas);
    const ink = getComputedStyle(canvas).color;
    const radius = 0.66 * size;
    context.resetTransform();
    context.clearRect(0, 0, 2 * size, 2 * size);
    context.translate(size, size);
    // Angles of the canvas run clockwise.
    const colors = context.createConicGradient(0, 0, 0);
    for (let i = 0; i <= 360; i++) colors.addColorStop(i / 360, orientationColor(-i, palette));
    context.fillStyle = colors;
    context.beginPath();
    context.arc(0, 0, radius, 0, 2 * Math.PI);
    context.arc(0, 0, 0.5 * radius, 0, 2 * Math.PI, true);
    context.fill();
    context.fillStyle = ink;
    context.font = `${0.19 * size}px system-ui, sans-serif`;
    context.textBaseline = "middle";
    context.textAlign = "center";
    for (const deg of [0, 45, 90, 135]) {
      const angle = (deg * Math.PI) / 180;
      context.fillText(`${deg}°`, (radius + 0.17 * size) * Math.cos(angle), -(radius + 0.14 * size) * Math.sin(angle));
    }
    if (typeof marked !== "number") return;
    context.rotate((-marked * Math.PI) / 180);
    context.lineCap = "round";
    context.beginPath();
    context.moveTo(-radius, 0);
    context.lineTo(radius, 0);
    // A light rim, as the ring has dark colours too.
    for (const [color, thick] of [["#fff", 9], ["#000", 4]]) {
      context.strokeStyle = String(color);
      context.lineWidth = Number(thick);
      context.stroke();
    }
  };
  /** @type {number | null} */
  let last = null;
  const mark = (/** @type {number | null} */ deg) => {
    last = deg;
    draw(deg);
  };
  // The ink is known once the canvas is in the page, and changes with the theme.
  const refresh = () => draw(last);
  const dye = (/** @type {keyof SPOKEN} */ wanted) => {
    palette = wanted;
    canvas.setAttribute("aria-label", `Colour wheel: ${SPOKEN[palette]}`);
    refresh();
  };
  canvas.setAttribute("aria-label", `Colour wheel: ${SPOKEN[palette]}`);
  requestAnimationFrame(refresh);
  return Object.assign(canvas, { mark, refresh, dye });
}

/** The bar from `low` to `high`; without a range it says which end is which. */
export function bar(range, unit, grey) {
  const canvas = h("canvas", { width: 256, height: 1, "aria-hidden": "true" });
  const context = pen(canvas);
  for (let i = 0; i < 256; i++) {
    context.fillStyle = grey ? `rgb(${i} ${i} ${i})` : viridis(i / 255);
    context.fillRect(i, 0, 1, 1);
  }
  const [low, high] = range ?? [];
  const digits = range && high - low < 10 ? 2 : 0;
  const label = (value, word) => h("span", {}, range ? `${fixed(value, digits)}${unit}` : word);
  return h("div", { class: "bar" }, canvas, h("div", { class: "row between" }, label(low, "low"), range && label((low + high) / 2), label(high, "high")));
}

/** What masked pixels look like. */
export const maskedKey = () => h("p", { class: "row soft" }, h("span", { class: "swatch masked" }), "masked");
