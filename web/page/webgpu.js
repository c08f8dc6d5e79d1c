// Pictures of a sample on a canvas, by WebGPU: the shaders as they are, without a translation.

import { h, pen } from "./dom.js";
import { settled } from "./parsed.js";
import { DISPLAY, LIGHT } from "./wgsl.js";

// Bits of WebGPU's flags; the objects that name them are missing where there is no WebGPU.
const BUFFER = { READ: 1, COPY_DST: 8, UNIFORM: 64 };
const TEXTURE = { COPY_SRC: 1, COPY_DST: 2, BINDING: 4, TARGET: 16 };
const FRAGMENT = 2;
/** Bytes of a pixel, and what rows that are read back are a multiple of. */
const [PIXEL, ROW] = [16, 256];

/**
 * A graphics card for a view, or a sentence that says why there is none. It has compiled the view's shaders and shown a picture.
 * @param {View} view
 * @returns {Promise<GpuDevice>}
 */
export async function opened(view) {
  const adapter = await navigator.gpu?.requestAdapter({ powerPreference: "high-performance" });
  if (!adapter) throw new Error("this browser offers no graphics card through WebGPU");
  const device = await adapter.requestDevice({ requiredLimits: { maxTextureDimension2D: adapter.limits.maxTextureDimension2D } });
  try {
    await device.createRenderPipelineAsync(lightPipeline(device, view.uniforms)).catch((problem) => {
      throw new Error(`this browser refuses the shaders (${problem.message.split("\n")[0]})`);
    });
    if (!shows(device)) throw new Error("what this browser draws through WebGPU does not get onto the page");
  } catch (problem) {
    device.destroy();
    throw problem;
  }
  return device;
}

/** Whether a red picture is red on the page: some systems draw what they cannot show. */
function shows(device) {
  const [canvas, copy] = [0, 1].map(() => h("canvas", { width: 4, height: 4 }));
  const context = contextOf(canvas, device);
  const commands = device.createCommandEncoder();
  pass(commands, context.getCurrentTexture(), [1, 0, 0, 1]).end();
  device.queue.submit([commands.finish()]);
  pen(copy).drawImage(canvas, 0, 0);
  const [red, green] = pen(copy).getImageData(1, 1, 1, 1).data;
  return red > 250 && green < 5;
}

/** @returns {GpuContext} */
function contextOf(canvas, device) {
  const context = canvas.getContext("webgpu");
  if (!context || !navigator.gpu) throw new Error("this canvas takes no pictures from WebGPU");
  context.configure({ device, format: navigator.gpu.getPreferredCanvasFormat(), alphaMode: "opaque" });
  return context;
}

/** The start of a picture. */
const pass = (commands, texture, clearValue = [0, 0, 0, 1]) => commands.beginRenderPass({ colorAttachments: [{ view: texture.createView(), loadOp: "clear", storeOp: "store", clearValue }] });

/** What is bound: uniforms, then textures. */
const layoutOf = (device, { textures }) => device.createBindGroupLayout({ entries: [
  { binding: 0, visibility: FRAGMENT, buffer: { type: "uniform" } },
  ...textures.map(([, binding]) => ({ binding, visibility: FRAGMENT, texture: { sampleType: "unfilterable-float" } }))] });

function pipelineOf(device, shader, code, entryPoint, format) {
  const layout = device.createPipelineLayout({ bindGroupLayouts: [layoutOf(device, shader)] });
  const module = device.createShaderModule({ code });
  return { layout, vertex: { module, entryPoint: "corner" }, fragment: { module, entryPoint, targets: [{ format }] } };
}

/** Compilers leave out what is not for this kind of sample. */
function lightPipeline(device, uniforms) {
  const constants = settled(uniforms).map(([name, value]) => `const ${name}: f32 = ${value};\n`).join("");
  return pipelineOf(device, LIGHT, constants + LIGHT.source, "light", "rgba32float");
}

/** Draws a view on a canvas, as the painter of WebGL2 does. */
export class GpuPainter {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {GpuDevice} device
   */
  constructor(canvas, device) {
    this.canvas = canvas;
    this.device = device;
    this.context = contextOf(canvas, device);
    /** @type {Record<string, GpuTexture>} */
    this.textures = {};
    /** @type {Uniforms} */
    this.uniforms = {};
    /** @type {GpuTexture[]} What is added to, and what was there before. */
    this.targets = [];
    this.count = 0;
    this.size = [0, 0];
    /** @type {Map<string, object>} Pipelines for kinds of samples, shapes and light. */
    this.lights = new Map();
    this.display = device.createRenderPipeline(pipelineOf(device, DISPLAY, DISPLAY.source, "display", navigator.gpu?.getPreferredCanvasFormat()));
    this.buffers = new Map([LIGHT, DISPLAY].map((shader) => {
      const vectors = shader.members.reduce((sum, [, count]) => sum + count, 0);
      return [shader, device.createBuffer({ size: PIXEL * vectors, usage: BUFFER.UNIFORM | BUFFER.COPY_DST })];
    }));
  }

  /**
   * Takes a view; what it was is forgotten.
   * @param {View} view
   */
  load(view) {
    const most = this.device.limits.maxTextureDimension2D;
    for (const { name, width, height, channels, values } of view.textures) {
      if (Math.max(width, height) > most) throw new Error(`${name} has ${Math.max(width, height)} pixels along a side, and this graphics card takes ${most}.`);
      this.textures[name]?.destroy();
      const texture = this.#texture(width, height, channels, TEXTURE.BINDING | TEXTURE.COPY_DST);
      this.device.queue.writeTexture({ texture }, values, { bytesPerRow: 4 * channels * width }, [width, height]);
      this.textures[name] = texture;
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
    if (this.size[0] !== width || this.size[1] !== height) this.#resize(width, height);
    const [from, to] = this.targets;
    this.uniforms.samples = [[this.count, samples, this.count / (this.count + samples), 0]];
    this.uniforms.right[0][3] = width;
    this.uniforms.up[0][3] = height;
    this.#draw(this.#light(), LIGHT, this.uniforms, { ...this.textures, before: from }, to);
    this.targets = [to, from];
    this.count += samples;
  }

  /** Shows what there is, brighter or darker. */
  show(exposure, overlay) {
    const { canvas, context, targets } = this;
    // Below 0: this canvas counts its rows from above.
    const values = [[exposure, overlay ? 1 : 0, canvas.width, -canvas.height]];
    this.#draw(this.display, DISPLAY, { values }, { picture: targets[0] }, context.getCurrentTexture());
  }

  /** Waits until the card has drawn what it was asked to. */
  async done() {
    await this.device.queue.onSubmittedWorkDone();
  }

  /**
   * Linear sRGB of the picture, four numbers a pixel, row by row from the top; or of a part of it.
   * @returns {Promise<Float32Array>}
   */
  async pixels(x = 0, y = 0, width = this.size[0], height = this.size[1]) {
    const { device } = this;
    const bytesPerRow = Math.ceil((PIXEL * width) / ROW) * ROW;
    const buffer = device.createBuffer({ size: bytesPerRow * height, usage: BUFFER.COPY_DST | BUFFER.READ });
    const commands = device.createCommandEncoder();
    commands.copyTextureToBuffer({ texture: this.targets[0], origin: [x, y] }, { buffer, bytesPerRow }, [width, height]);
    device.queue.submit([commands.finish()]);
    await buffer.mapAsync(1);
    const rows = new Float32Array(buffer.getMappedRange());
    const values = new Float32Array(4 * width * height);
    for (let k = 0; k < height; k++) values.set(rows.subarray((k * bytesPerRow) / 4, (k * bytesPerRow) / 4 + 4 * width), 4 * width * k);
    buffer.destroy();
    return values;
  }

  /** Gives the card's memory back. */
  close() {
    for (const texture of [...this.targets, ...Object.values(this.textures)]) texture.destroy();
    this.context.unconfigure();
  }

  #resize(width, height) {
    for (const texture of this.targets) texture.destroy();
    this.targets = [0, 1].map(() => this.#texture(width, height, 4, TEXTURE.BINDING | TEXTURE.TARGET | TEXTURE.COPY_SRC));
    this.size = [width, height];
    this.count = 0;
  }

  #texture(width, height, channels, usage) {
    return this.device.createTexture({ size: [width, height], format: channels === 1 ? "r32float" : "rgba32float", usage });
  }

  #light() {
    const key = settled(this.uniforms).join();
    const pipeline = this.lights.get(key) ?? this.device.createRenderPipeline(lightPipeline(this.device, this.uniforms));
    this.lights.set(key, pipeline);
    return pipeline;
  }

  /**
   * @param {any} pipeline
   * @param {DirectShader} shader
   * @param {Uniforms} uniforms
   * @param {Record<string, GpuTexture>} textures
   * @param {GpuTexture} to
   */
  #draw(pipeline, shader, uniforms, textures, to) {
    const { device } = this;
    const buffer = this.buffers.get(shader);
    device.queue.writeBuffer(buffer, 0, new Float32Array(shader.members.flatMap(([name]) => uniforms[name].flat())));
    const bound = shader.textures.map(([name, binding]) => ({ binding, resource: textures[name].createView() }));
    const group = device.createBindGroup({ layout: pipeline.getBindGroupLayout(0), entries: [{ binding: 0, resource: { buffer } }, ...bound] });
    const commands = device.createCommandEncoder();
    const drawing = pass(commands, to);
    drawing.setPipeline(pipeline);
    drawing.setBindGroup(0, group);
    drawing.draw(3);
    drawing.end();
    device.queue.submit([commands.finish()]);
  }
}
