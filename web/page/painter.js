// Pictures of a sample on a canvas, by WebGL2: the same shaders as on the command line, and sums that get better while nothing moves.

import { settled } from "./parsed.js";
import { DISPLAY, LIGHT, VERTEX } from "./shaders.js";

/** Draws a view on a canvas. Throws a sentence where a browser cannot. */
export class Painter {
  /** @param {HTMLCanvasElement} canvas */
  constructor(canvas) {
    const gl = canvas.getContext("webgl2", { antialias: false, alpha: false, powerPreference: "high-performance" });
    if (!gl) throw new Error("This browser has no WebGL2, or it is switched off.");
    if (!gl.getExtension("EXT_color_buffer_float")) throw new Error("This graphics card has no pictures of 32-bit numbers.");
    this.canvas = canvas;
    this.gl = gl;
    /** @type {Record<string, WebGLTexture | null>} */
    this.textures = {};
    /** @type {Uniforms} */
    this.uniforms = {};
    /** @type {(WebGLTexture | null)[]} What is added to, and what was there before. */
    this.targets = [];
    this.count = 0;
    this.size = [0, 0];
    /** @type {Map<string, Program>} Programs for kinds of samples, shapes and light. */
    this.lights = new Map();
    this.display = this.#program(DISPLAY);
    this.framebuffer = gl.createFramebuffer();
    gl.bindVertexArray(gl.createVertexArray());
  }

  /**
   * Takes a view; what it was is forgotten.
   * @param {View} view
   */
  load(view) {
    const { gl } = this;
    const most = gl.getParameter(gl.MAX_TEXTURE_SIZE);
    for (const { name, width, height, channels, values } of view.textures) {
      if (Math.max(width, height) > most) throw new Error(`${name} has ${Math.max(width, height)} pixels along a side, and this graphics card takes ${most}.`);
      gl.deleteTexture(this.textures[name] ?? null);
      this.textures[name] = this.#texture(width, height, channels, values);
    }
    this.uniforms = structuredClone(view.uniforms);
    this.count = 0;
  }

  /** Changes uniforms by name; the picture starts anew. */
  set(values) {
    Object.assign(this.uniforms, values);
    this.count = 0;
  }

  /** Adds samples to each pixel of a picture of this size. */
  add(width, height, samples) {
    const { gl } = this;
    if (this.size[0] !== width || this.size[1] !== height) this.#resize(width, height);
    const [from, to] = this.targets;
    this.uniforms.samples = [[this.count, samples, this.count / (this.count + samples), 0]];
    this.uniforms.right[0][3] = width;
    this.uniforms.up[0][3] = height;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, to, 0);
    this.#draw(this.#light(), this.uniforms, { ...this.textures, before: from }, width, height);
    this.targets = [to, from];
    this.count += samples;
  }

  /** Shows what there is, brighter or darker. */
  show(exposure, overlay) {
    const { gl, canvas } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    this.#draw(this.display, { values: [[exposure, overlay ? 1 : 0, canvas.width, canvas.height]] }, { picture: this.targets[0] }, canvas.width, canvas.height);
  }

  /** Waits until the card has drawn what it was asked to. */
  async done() {
    await this.pixels(0, 0, 1, 1);
  }

  /**
   * Linear sRGB of the picture, four numbers a pixel, row by row from the top; or of a part of it.
   * @returns {Promise<Float32Array>}
   */
  async pixels(x = 0, y = 0, width = this.size[0], height = this.size[1]) {
    const { gl } = this;
    const values = new Float32Array(4 * width * height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.targets[0], 0);
    gl.readPixels(x, y, width, height, gl.RGBA, gl.FLOAT, values);
    return values;
  }

  /** Gives the card's memory back. */
  close() {
    this.gl.getExtension("WEBGL_lose_context")?.loseContext();
  }

  #resize(width, height) {
    for (const texture of this.targets) this.gl.deleteTexture(texture);
    this.targets = [0, 1].map(() => this.#texture(width, height, 4, null));
    this.size = [width, height];
    this.count = 0;
  }

  #texture(width, height, channels, values) {
    const { gl } = this;
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, channels === 1 ? gl.R32F : gl.RGBA32F, width, height, 0, channels === 1 ? gl.RED : gl.RGBA, gl.FLOAT, values);
    for (const kind of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, kind, gl.NEAREST);
    return texture;
  }

  /** The program for what is shown: compilers take minutes for all that shaders can do, and less than a second for one kind of sample. */
  #light() {
    const defines = settled(this.uniforms).map(([name, value]) => `#define ${name} ${value}\n`).join("");
    const program = this.lights.get(defines) ?? this.#program({ ...LIGHT, source: LIGHT.source.replace("\n", `\n${defines}`) });
    this.lights.set(defines, program);
    return program;
  }

  /**
   * @param {Shader} shader
   * @returns {Program}
   */
  #program({ source, block, members, textures }) {
    const { gl } = this;
    const program = gl.createProgram();
    if (!program) throw new Error("The graphics card was reset. Reload the page.");
    /** @type {[number, string][]} */
    const sources = [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, source]];
    for (const [kind, text] of sources) {
      const shader = gl.createShader(kind);
      // Without one the card is lost, and linking says so.
      if (!shader) continue;
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(`The graphics card refuses the shaders: ${gl.getProgramInfoLog(program) || "no reason given"}`);
    gl.uniformBlockBinding(program, gl.getUniformBlockIndex(program, block), 0);
    /** @type {[string, WebGLUniformLocation | null][]} */
    const places = Object.entries(textures).map(([name, called]) => [name, gl.getUniformLocation(program, called)]);
    return { program, members, places, buffer: gl.createBuffer() };
  }

  /**
   * @param {Program} program
   * @param {Uniforms} uniforms
   * @param {Record<string, WebGLTexture | null>} textures
   * @param {number} width
   * @param {number} height
   */
  #draw({ program, members, places, buffer }, uniforms, textures, width, height) {
    const { gl } = this;
    gl.useProgram(program);
    gl.bindBufferBase(gl.UNIFORM_BUFFER, 0, buffer);
    gl.bufferData(gl.UNIFORM_BUFFER, new Float32Array(members.flatMap(([name]) => uniforms[name].flat())), gl.DYNAMIC_DRAW);
    places.forEach(([name, place], unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, textures[name]);
      gl.uniform1i(place, unit);
    });
    gl.viewport(0, 0, width, height);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }
}
