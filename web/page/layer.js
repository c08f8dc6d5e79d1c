// One view on one canvas: what it is, and its uniforms in a pose.

import { sums } from "./parsed.js";
import { away, panned, placed, posed } from "./turning.js";

/** What can be shown, in the order in which the shaders number it. */
export const SHOWN = [["light", "Light"], ["orientation", "Orientation"], ["period", "Period"], ["sigma", "σ"]];

/** Whether a view has what is to be shown in place of light. */
export const canShow = ({ uniforms }, key) => key === "light" || (uniforms.what[0][0] === 1 && (key !== "sigma" || uniforms.same[0][2] > 0));

/** A view on a canvas; throws a sentence where a browser cannot. */
export class Layer {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {Card} card
   */
  constructor(canvas, card) {
    this.canvas = canvas;
    this.painter = card.painter(canvas);
    /** @type {View} */
    this.view = { uniforms: {}, textures: [] };
    /** @type {Uniforms} Those of the sample's own frame. */
    this.home = {};
    /** @type {number[]} */
    this.range = [];
  }

  /**
   * Takes a view; what it was is forgotten.
   * @param {View} view
   */
  load(view) {
    this.view = view;
    this.painter.load(view);
    this.home = structuredClone(view.uniforms);
    this.range = ranges(view);
  }

  /** Sets all that depends on the state; colours of maps have the ends of `range`. */
  pose(state, error, range = this.range) {
    const { home } = this;
    const lights = structuredClone(home.lights);
    // The light's intensity is that of its own distance, so that it is as bright from everywhere.
    const before = Math.hypot(...home.lights[0].slice(0, 3)) || 1;
    lights[0] = [...placed(state), home.lights[0][3]];
    lights[1][0] = home.lights[1][0] * (state.distance / before) ** 2;
    const [kind, count, , coverage] = home.what[0];
    const shown = canShow(this.view, state.shown) ? SHOWN.findIndex(([k]) => k === state.shown) : 0;
    const eye = [...home.eye[0]];
    eye[3] /= state.zoom;
    this.painter.set({ ...posed(home, state), ...panned(home, state), lights, eye: [eye], what: [[kind, count, shown, coverage]], sums: [sums(error)], range: [range] });
  }

  /** How many mm of the sample at rest the picture's height shows without zoom. */
  get tall() {
    return 2 * this.home.eye[0][3] * away(this.home);
  }

  /** How far off the sample's middle the picture's middle may be, so that it cannot be lost. */
  get most() {
    return Math.max(this.home.center[0][3], this.home.across[0][3]);
  }

  /** Adds a sample to each pixel, of a picture that is coarser by a factor. */
  add(factor) {
    const { width, height } = this.canvas;
    this.painter.add(Math.max(1, Math.round(width / factor)), Math.max(1, Math.round(height / factor)), 1);
  }

  /** How bright it has to be shown to be seen well; null where nothing is lit. */
  async brightness() {
    return brightness(await this.painter.pixels());
  }

  /** Shows what there is. */
  show(exposure) {
    this.painter.show(exposure, this.painter.uniforms.what[0][2] > 0);
  }
}

/** Brightness at which the brighter twentieth of what is lit is nearly white, as `nacre render` chooses it; null where nothing is lit. */
function brightness(pixels) {
  const light = [];
  for (let i = 0; i < pixels.length; i += 4) light.push(0.2126729 * pixels[i] + 0.7151522 * pixels[i + 1] + 0.072175 * pixels[i + 2]);
  light.sort((a, b) => a - b);
  const lit = light.filter((y) => y > 1e-4 * light[light.length - 1]);
  return lit.length ? 0.8 / lit[Math.floor((lit.length * 19) / 20)] : null;
}

/**
 * Ends of the colours of periods and of σ.
 * @param {View} view
 */
function ranges(view) {
  const values = view.textures.find((t) => t.name === "maps")?.values ?? new Float32Array();
  const [, period, hasOrientation, hasPeriod] = view.uniforms.same[0];
  const sorted = (channel) => {
    const found = [];
    for (let i = 0; i < values.length; i += 4 * 17) if (values[i + 3] > 0.5) found.push(values[i + channel]);
    return found.sort((a, b) => a - b);
  };
  const at = (list, q) => list[Math.floor((list.length - 1) * q)] ?? 0;
  const periods = hasPeriod ? sorted(1) : [period];
  const sigmas = hasOrientation ? sorted(2) : [0];
  const [low, high] = [at(periods, 0.01), at(periods, 0.99)];
  return [low, Math.max(high, low + 1e-3), 0, Math.max(at(sigmas, 0.99), 1e-6)];
}
