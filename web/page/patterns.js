// Patterns in millimetres onto a canvas in pixels. The panel's middle is the origin, x to the right, y up.
//
// Values are the panel's own: 255 · value, without any gamma but where a pattern gives one, since only a calibration knows the panel's.

const radians = (deg) => (deg * Math.PI) / 180;

/** Fills every pixel with a value 0 to 1 of its place in mm. */
function shade(context, panel, value) {
  const { width, height } = context.canvas;
  const image = context.createImageData(width, height);
  const bytes = image.data;
  let at = 0;
  for (let row = 0; row < height; row++) {
    const y = ((height - 1) / 2 - row) * panel.pitch[1];
    for (let column = 0; column < width; column++, at += 4) {
      const grey = 255 * value((column - (width - 1) / 2) * panel.pitch[0], y);
      bytes[at] = bytes[at + 1] = bytes[at + 2] = grey + 0.5;
      bytes[at + 3] = 255;
    }
  }
  context.putImageData(image, 0, 0);
}

/** Draws with paths in mm. */
function outline(context, panel, draw) {
  const { width, height } = context.canvas;
  context.setTransform(1 / panel.pitch[0], 0, 0, -1 / panel.pitch[1], width / 2, height / 2);
  context.fillStyle = "#fff";
  draw();
  context.resetTransform();
}

const disc = (context, [x, y], diameter) => {
  context.beginPath();
  context.arc(x, y, diameter / 2, 0, 2 * Math.PI);
  context.fill();
};

/** A cosine between black and white. */
const wave = (along, period, phase) => 0.5 + 0.5 * Math.cos((2 * Math.PI * along) / period + radians(phase));

const DRAW = {
  black() {},
  full(context) {
    context.fillStyle = "#fff";
    context.fillRect(0, 0, context.canvas.width, context.canvas.height);
  },
  disc(context, panel, { center_mm, diameter_mm }) {
    outline(context, panel, () => disc(context, center_mm ?? [0, 0], diameter_mm));
  },
  spots(context, panel, { centers_mm, diameter_mm }) {
    outline(context, panel, () => centers_mm.forEach((center) => disc(context, center, diameter_mm)));
  },
  // Bright where x cos a + y sin a > offset: the angle is that of the direction into the light.
  edge(context, panel, { angle_deg, offset_mm }) {
    const far = 4 * Math.hypot(...panel.size) + Math.abs(offset_mm);
    outline(context, panel, () => {
      context.rotate(radians(angle_deg));
      context.fillRect(offset_mm, -far, far, 2 * far);
    });
  },
  // u runs from −1 to 1 over the panel along the angle; order 1 is (1 + u) / 2, order 2 is u².
  gradient(context, panel, { order, angle_deg }) {
    const [c, s] = [Math.cos(radians(angle_deg)), Math.sin(radians(angle_deg))];
    const reach = (Math.abs(c) * panel.size[0] + Math.abs(s) * panel.size[1]) / 2;
    const level = order === 2 ? (u) => u * u : (u) => (1 + u) / 2;
    shade(context, panel, (x, y) => level((x * c + y * s) / reach));
  },
  radial(context, panel, { period_mm, phase_deg }) {
    shade(context, panel, (x, y) => wave(Math.hypot(x, y), period_mm, phase_deg));
  },
  axial(context, panel, { period_mm, angle_deg, phase_deg }) {
    const [c, s] = [Math.cos(radians(angle_deg)), Math.sin(radians(angle_deg))];
    shade(context, panel, (x, y) => wave(x * c + y * s, period_mm, phase_deg));
  },
  // Luminances, so that the panel's exponent is taken out: a quarter cycle away from white is half as bright.
  fringes(context, panel, { cycles_per_mm: [fx, fy], phase, gamma }) {
    shade(context, panel, (x, y) => (0.5 + 0.5 * Math.cos(2 * Math.PI * (fx * x + fy * y + phase))) ** (1 / gamma));
  },
  // The middle of the panel is the corner of four squares; the one to the upper right is white.
  checkerboard(context, panel, { square_mm }) {
    const reach = panel.size.map((size) => Math.ceil(size / 2 / square_mm));
    outline(context, panel, () => {
      for (let i = -reach[0]; i < reach[0]; i++) {
        for (let j = -reach[1]; j < reach[1]; j++) {
          // One path for all squares, filled at once, so that no seam shows where two meet at a corner.
          if ((i + j) % 2 === 0) context.rect(i * square_mm, j * square_mm, square_mm, square_mm);
        }
      }
      context.fill();
    });
  },
};

/**
 * The panel in mm: of its size where that is known, else in the mm of CSS, of which 25.4 are 96 pixels. The size is
 * that of the whole screen, so that a window shows a part at the right scale.
 */
export function panelOf(canvas, sizeMm, screen, pixelRatio) {
  const css = 25.4 / 96 / pixelRatio;
  if (!sizeMm) return { size: [canvas.width * css, canvas.height * css], pitch: [css, css] };
  return { size: sizeMm, pitch: [sizeMm[0] / (screen.width * pixelRatio), sizeMm[1] / (screen.height * pixelRatio)] };
}

/** Draws a pattern; returns whether it could be, and leaves black where it could not. */
export function draw(canvas, pattern, panel) {
  const context = canvas.getContext("2d", { alpha: false });
  context.resetTransform();
  context.fillStyle = "#000";
  context.fillRect(0, 0, canvas.width, canvas.height);
  try {
    if (!Object.hasOwn(DRAW, pattern?.kind)) return false;
    context.beginPath();
    DRAW[pattern.kind](context, panel, pattern);
    return true;
  } catch (error) {
    console.error("the pattern could not be drawn", error);
    context.resetTransform();
    context.fillStyle = "#000";
    context.fillRect(0, 0, canvas.width, canvas.height);
    return false;
  }
}
