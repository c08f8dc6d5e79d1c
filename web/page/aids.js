// Aids for setting up: what is sharp, what is saturated, and whether a bright region is round and in the middle.

import { check, h, pen, say } from "./dom.js";

// Edges stronger than this part of the strongest are marked.
const SHARP = 0.35;
// A region is an ellipse when it fills its own to this part, at least.
const FILLED = 0.85;
const RED = [255, 40, 60, 255];
const GREEN = [40, 255, 120, 255];

/** Grey values of a picture: { gray, width, height }. */
async function pixels(blob) {
  const bitmap = await createImageBitmap(blob);
  const { width, height } = bitmap;
  const context = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
  context.drawImage(bitmap, 0, 0);
  bitmap.close();
  const { data } = context.getImageData(0, 0, width, height);
  return { gray: Uint8Array.from({ length: width * height }, (_, i) => data[4 * i]), width, height };
}

/** Squared differences across each pixel, along rows and columns: large where a picture is sharp. */
function edges({ gray, width, height }) {
  const found = new Float32Array(width * height);
  for (let y = 1; y < height - 1; y++) {
    for (let x = 1; x < width - 1; x++) {
      const i = y * width + x;
      found[i] = (gray[i + 1] - gray[i - 1]) ** 2 + (gray[i + width] - gray[i - width]) ** 2;
    }
  }
  return found;
}

/** How sharp a picture is, whatever its light: mean squared difference across pixels over the squared mean light. */
export function sharpness(picture) {
  const sum = (values) => values.reduce((s, v) => s + v, 0);
  const mean = sum(picture.gray) / picture.gray.length;
  return mean > 0 ? sum(edges(picture)) / picture.gray.length / mean ** 2 : 0;
}

/** The region brighter than half of the brightest: its middle from the picture's (right, up, in pixels), its longer and shorter diameter, and the
 * direction of the longer (degrees, anticlockwise from the right); null where nothing stands out that looks like an ellipse. */
export function region({ gray, width, height }) {
  const most = gray.reduce((a, b) => Math.max(a, b), 0);
  const bright = (i) => gray[i] > 0.5 * most;
  let [n, sx, sy] = [0, 0, 0];
  for (let i = 0; i < gray.length; i++) if (bright(i)) [n, sx, sy] = [n + 1, sx + (i % width), sy + Math.floor(i / width)];
  if (most < 8 || n < 16 || n > 0.9 * gray.length) return null;
  const [mx, my] = [sx / n, sy / n];
  let [xx, yy, xy] = [0, 0, 0];
  for (let i = 0; i < gray.length; i++) {
    if (!bright(i)) continue;
    const [x, y] = [(i % width) - mx, my - Math.floor(i / width)];
    [xx, yy, xy] = [xx + x * x, yy + y * y, xy + x * y];
  }
  // A filled ellipse has a quarter of its squared semi-axes as variances.
  const [half, apart] = [(xx + yy) / (2 * n), Math.hypot((xx - yy) / (2 * n), xy / n)];
  const [longer, shorter] = [4 * Math.sqrt(half + apart), 4 * Math.sqrt(Math.max(0, half - apart))];
  if (n < FILLED * 0.25 * Math.PI * longer * shorter) return null;
  return {
    right: mx - 0.5 * (width - 1), up: 0.5 * (height - 1) - my, longer, shorter,
    turn: (((0.5 * Math.atan2(2 * xy, xx - yy) * 180) / Math.PI) + 180) % 180,
  };
}

/** What a region says of the set-up, in words; `scale` is pixels of the camera per pixel of the picture. */
export function regionText(found, scale) {
  if (!found) return "No bright region of a simple shape stands out.";
  const { right, up, longer, shorter, turn } = found;
  const off = `${Math.abs(right * scale).toFixed(0)} px ${right < 0 ? "left" : "right"} and ${Math.abs(up * scale).toFixed(0)} px ${up < 0 ? "below" : "above"} the middle`;
  const ratio = shorter / longer;
  if (ratio > 0.99) return `Bright region: ${off}; round to 1 %.`;
  const tilt = (Math.acos(ratio) * 180) / Math.PI;
  return `Bright region: ${off}; ${(100 * (1 / ratio - 1)).toFixed(0)} % longer than wide along ${turn.toFixed(0)}°. A round one is seen at ${tilt.toFixed(0)}° from straight on.`;
}

/** The switches, the marks over the picture, and `look(blob, width)` for each new one, whose full width is given. */
export function previewAids() {
  const canvas = h("canvas", { class: "aids", "aria-hidden": "true" });
  const said = h("output", { id: "aids", class: "soft" });
  const on = (id, label) => {
    const element = check(label, { id: `aid-${id}`, onchange: () => again() });
    return /** @type {[typeof element, () => boolean]} */ ([element, () => element.box.checked]);
  };
  const [[focus, isFocus], [clipped, isClipped], [grid, isGrid], [bright, isBright]] =
    [on("focus", "Sharp edges"), on("clipped", "Saturated pixels"), on("grid", "Grid"), on("region", "Bright region")];
  let last = null;
  let best = 0;
  focus.box.addEventListener("change", () => (best = 0));

  function again() {
    if (last) draw(last);
  }

  /** Takes all marks away. */
  function clear() {
    last = null;
    // Setting its width empties a canvas.
    canvas.width = 1;
    say(said, "");
  }

  function draw({ picture, scale }) {
    const { gray, width, height } = picture;
    [canvas.width, canvas.height] = [width, height];
    const context = pen(canvas);
    const marks = context.createImageData(width, height);
    const words = [];
    if (isFocus()) {
      const strength = edges(picture);
      const least = Math.max(64, SHARP * strength.reduce((a, b) => Math.max(a, b), 0));
      strength.forEach((v, i) => v > least && marks.data.set(GREEN, 4 * i));
      const now = sharpness(picture);
      best = Math.max(best, now);
      words.push(`Sharpness ${best > 0 ? ((100 * now) / best).toFixed(0) : 0} % of the best so far.`);
    }
    if (isClipped()) gray.forEach((v, i) => v === 255 && marks.data.set(RED, 4 * i));
    context.putImageData(marks, 0, 0);
    if (isGrid()) lines(context, width, height);
    if (isBright()) {
      const found = region(picture);
      if (found) outline(context, picture, found);
      words.push(regionText(found, scale));
    }
    say(said, words.join(" "));
  }

  const active = () => [isFocus, isClipped, isGrid, isBright].some((is) => is());
  return {
    canvas,
    /** Whether any aid is switched on. */
    active,
    element: h("div", { class: "stack" }, h("div", { class: "row", role: "group", "aria-label": "Aids" }, focus, clipped, grid, bright), said),
    clear,
    async look(blob, width) {
      if (!active()) return clear();
      const picture = await pixels(blob);
      last = { picture, scale: width / picture.width };
      draw(last);
    },
  };
}

function lines(context, width, height) {
  context.strokeStyle = "rgb(255 255 255 / 0.7)";
  context.beginPath();
  for (const part of [0.25, 0.5, 0.75]) {
    context.moveTo(part * width, 0);
    context.lineTo(part * width, height);
    context.moveTo(0, part * height);
    context.lineTo(width, part * height);
  }
  context.stroke();
}

function outline(context, { width, height }, { right, up, longer, shorter, turn }) {
  const [x, y] = [0.5 * width + right, 0.5 * height - up];
  context.strokeStyle = "rgb(80 200 255)";
  context.lineWidth = Math.max(1, width / 300);
  context.beginPath();
  context.ellipse(x, y, 0.5 * longer, 0.5 * shorter, (-turn * Math.PI) / 180, 0, 2 * Math.PI);
  context.moveTo(x - 6, y);
  context.lineTo(x + 6, y);
  context.moveTo(x, y - 6);
  context.lineTo(x, y + 6);
  context.stroke();
}
