// Directions of a viewer: the sample's frame turned by angles, the light around it, and where a place of the picture lies on the sample.

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const rad = (deg) => (deg * Math.PI) / 180;

/** A vector turned about the sample's normal, then tilted up or down (about x), then sideways (about y); degrees. */
export function turned([x, y, z], { roll, tilt, pan }) {
  const about = (a, b, deg) => [a * Math.cos(rad(deg)) - b * Math.sin(rad(deg)), a * Math.sin(rad(deg)) + b * Math.cos(rad(deg))];
  [x, y] = about(x, y, roll);
  [y, z] = about(y, z, tilt);
  [z, x] = about(z, x, pan);
  return [x, y, z];
}

/** Uniforms of a sample in another pose; `home` are those of its own frame. */
export function posed(home, pose) {
  const of = (name) => [[...turned(home[name][0], pose), home[name][0][3]]];
  return { center: of("center"), across: of("across"), along: of("along"), normal: of("normal") };
}

/**
 * Uniforms of a camera whose picture's middle is `x` and `y` mm off that of the sample at rest, as if its sensor were moved: nothing is distorted.
 * @param {Uniforms} home
 * @param {{ x: number, y: number }} place
 */
export function panned(home, { x, y }) {
  const [ahead, right, up] = ["ahead", "right", "up"].map((name) => home[name][0]);
  const far = away(home);
  return { ahead: [[...[0, 1, 2].map((k) => ahead[k] + (right[k] * x + up[k] * y) / far), ahead[3]]] };
}

/** How far the camera is from the sample's middle, in mm. */
export const away = (/** @type {Uniforms} */ { eye, center }) => Math.hypot(...[0, 1, 2].map((k) => center[0][k] - eye[0][k]));

/** The place of a light from its azimuth (anticlockwise from the right) and elevation above the sample's plane at rest. */
export function placed({ azimuth, elevation, distance }) {
  const [a, e] = [rad(azimuth), rad(elevation)];
  return [distance * Math.cos(e) * Math.cos(a), distance * Math.cos(e) * Math.sin(a), distance * Math.sin(e)];
}

/** Azimuth and elevation of a point (x, y) of a disc of radius 1, and back: elevations fall evenly to its rim. */
export const fromDisc = ([x, y]) => ({ azimuth: ((Math.atan2(y, x) * 180) / Math.PI + 360) % 360, elevation: 90 * (1 - Math.min(1, Math.hypot(x, y))) });
export const toDisc = ({ azimuth, elevation }) => [Math.cos(rad(azimuth)), Math.sin(rad(azimuth))].map((v) => v * (1 - elevation / 90));

/**
 * Where a place of the picture (shares of its width and height, from its upper left corner) lies on the sample: u and v from 0 to 1, or null.
 * @param {Uniforms} uniforms
 * @param {number[]} place
 * @param {number[]} size
 */
export function onSample(uniforms, [x, y], [width, height]) {
  const [eye, right, up, ahead, center, across, along, normal] = ["eye", "right", "up", "ahead", "center", "across", "along", "normal"].map((name) => uniforms[name][0]);
  const sx = ((2 * x - 1) * width * eye[3]) / height;
  const sy = (1 - 2 * y) * eye[3];
  const ray = [0, 1, 2].map((k) => ahead[k] + right[k] * sx + up[k] * sy);
  const from = [0, 1, 2].map((k) => center[k] - eye[k]);
  const t = dot(from, normal) / dot(ray, normal);
  if (!(t > 0)) return null;
  const p = [0, 1, 2].map((k) => ray[k] * t - from[k]);
  const [u, v] = [0.5 + (0.5 * dot(p, across)) / center[3], 0.5 + (0.5 * dot(p, along)) / across[3]];
  return u >= 0 && u <= 1 && v >= 0 && v <= 1 ? [u, v] : null;
}

/**
 * Where a place of the sample (u and v from 0 to 1) lies in the picture, in shares of its width and height from its upper left corner; null behind the camera.
 * @param {Uniforms} uniforms
 * @param {number[]} place
 * @param {number[]} size
 */
export function onScreen(uniforms, [u, v], [width, height]) {
  const [eye, right, up, ahead, center, across, along] = ["eye", "right", "up", "ahead", "center", "across", "along"].map((name) => uniforms[name][0]);
  const ray = [0, 1, 2].map((k) => center[k] - eye[k] + across[k] * (2 * u - 1) * center[3] + along[k] * (2 * v - 1) * across[3]);
  // Ahead leads to the picture's middle, which panning takes off the camera's axis.
  const off = [right, up].map((axis) => dot(ahead, axis));
  const depth = dot(ray, [0, 1, 2].map((k) => ahead[k] - off[0] * right[k] - off[1] * up[k]));
  if (!(depth > 0)) return null;
  const [sx, sy] = [right, up].map((axis, k) => (dot(ray, axis) / depth - off[k]) / eye[3]);
  return [0.5 + (0.5 * sx * height) / width, 0.5 - 0.5 * sy];
}

/**
 * The numbers of a map under a place: orientation and σ in degrees, period in µm; null where nothing is known.
 * @param {View} view
 * @param {number[]} place
 * @returns {{ x?: number, y?: number, orientation: number, period: number, sigma: number | null } | null}
 */
export function mapped(view, [u, v]) {
  const { same, grooves } = view.uniforms;
  const [orientation, period, hasOrientation, hasPeriod] = same[0];
  const map = view.textures.find((t) => t.name === "maps");
  if (!map || (!hasOrientation && !hasPeriod)) return { orientation: (orientation * 180) / Math.PI, period, sigma: null };
  const wrap = (value, repeat) => value * repeat - Math.floor(value * repeat);
  const x = Math.min(map.width - 1, Math.floor(wrap(u, grooves[0][0]) * map.width));
  const y = Math.min(map.height - 1, Math.floor((1 - wrap(v, grooves[0][1])) * map.height));
  const [o, p, s, known] = map.values.subarray(4 * (y * map.width + x), 4 * (y * map.width + x) + 4);
  if (known < 0.5) return null;
  return { x, y, orientation: ((hasOrientation ? o : orientation) * 180) / Math.PI, period: hasPeriod ? p : period, sigma: hasOrientation ? (s * 180) / Math.PI : null };
}
