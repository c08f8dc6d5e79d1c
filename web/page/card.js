// How pictures get onto a canvas: by WebGPU where the browser offers it, else by WebGL2, or as it is asked for.

/** Ways to draw, and what they are called. */
export const WAYS = [["", "The best there is"], ["webgpu", "WebGPU"], ["webgl2", "WebGL2"]];

/**
 * The way to draw a view: the one that is wanted if the browser has it, "" for the best.
 * @param {string} wanted
 * @param {View} view
 * @returns {Promise<Card>}
 */
export async function chosen(wanted, view) {
  let why = wanted === "webgl2" ? "as chosen" : "";
  if (wanted !== "webgl2") {
    try {
      return await direct(view);
    } catch (problem) {
      why = problem.message;
    }
  }
  const { Painter } = await import("./painter.js");
  return { way: "WebGL2", why, painter: (canvas) => new Painter(canvas), lost: () => {}, close() {} };
}

/**
 * @param {View} view
 * @returns {Promise<Card>}
 */
async function direct(view) {
  // Its shaders are not even fetched where they are of no use.
  if (!navigator.gpu) throw new Error("this browser has no WebGPU, or the page was not opened over HTTPS or from this machine");
  const { GpuPainter, opened } = await import("./webgpu.js");
  const device = await opened(view);
  let closing = false;
  return {
    way: "WebGPU", why: "", painter: (canvas) => new GpuPainter(canvas, device),
    lost(say) {
      device.lost.then(() => closing || say("The graphics card was reset. Reload the page, or draw with WebGL2."));
      device.addEventListener("uncapturederror", ({ error }) => say(`The graphics card does not do it: ${error.message.split("\n")[0]} Draw with WebGL2.`));
    },
    close() {
      closing = true;
      device.destroy();
    },
  };
}
