// A view as the service sends it, and what every way to draw it needs of it.

/**
 * A view as the service sends it: sizes, uniforms by name (lists of four numbers) and textures.
 * @param {ArrayBuffer} buffer
 * @returns {View}
 */
export function parseView(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  let offset = 4 + length;
  for (const texture of header.textures) {
    const count = texture.width * texture.height * texture.channels;
    texture.values = new Float32Array(buffer, offset, count);
    offset += 4 * count;
  }
  return header;
}

/** How finely sums are made for a relative error: steps and reach of lobes in standard deviations, rounds of balancing. */
export function sums(error) {
  const e = Math.min(0.5, Math.max(1e-6, error));
  return [Math.PI * Math.sqrt(2 / Math.log(2 / e)), Math.sqrt(-2 * Math.log(e / 2)), e < 0.005 ? 200 : e < 0.02 ? 30 : 6, Math.max(1e-4, e / 25)];
}

/**
 * What shaders are compiled for, by the names that they have for it, as numbers with a point: the kind of sample, how many lamps, its shape, and whether there is a sky.
 * @param {Uniforms} uniforms
 */
export const settled = ({ what, form, sky_x }) => Object.entries({ KIND: what[0][0], LAMPS: what[0][1], FORM: form[0][0], SKY: sky_x[0][3] }).map(([name, value]) => [name, value.toFixed(1)]);
