// The camera's live picture with its histogram.

import { previewAids } from "./aids.js";
import { get, picture, show } from "./api.js";
import { check, h, panel, pause, say, svg } from "./dom.js";
import { percent } from "./format.js";
import { service } from "./service.js";

const PERIOD_MS = 300;
const BINS = 256;
const HEIGHT = 64;

/**
 * The panel; it polls until the signal fires, and rests while nobody looks. `lighting` and `region` are its tools.
 * @param {AbortSignal} signal
 * @param {ReturnType<typeof import("./lighting.js").lightingPanel>} [lighting]
 * @param {ReturnType<typeof import("./region.js").regionTool>} [region]
 */
export function previewPanel(signal, lighting, region) {
  const image = h("img", { id: "preview", alt: "Newest frame of the camera", hidden: true });
  const empty = h("p", { class: "empty" }, "Waiting for the camera…");
  const curve = svg("path", { class: "curve" });
  const histogram = svg("svg", { class: "histogram", viewBox: `0 0 ${BINS} ${HEIGHT}`, preserveAspectRatio: "none", role: "img", "aria-label": "Histogram, black to white, square root of the count" }, curve);
  const mean = h("output", {}, "–");
  const saturated = h("output", { id: "saturated" }, "–");
  const angle = h("output", {}, "–");
  const frame = h("output", { id: "preview-sequence" }, "–");
  const clipping = h("div", { class: "clipping" }, h("span", { class: "soft" }, "Saturated "), saturated);
  const about = h("span", { class: "soft" });
  const aids = previewAids();
  // Values as measured are often too dark to set up by.
  const raw = check("Raw values", { id: "raw-values", title: "Show black and white of the camera instead of stretching the contrast" });
  const well = h("div", { class: "well preview" }, image, aids.canvas, region?.layer, lighting?.note, empty);
  poll();
  return panel("Live picture", about, h("div", { class: "row above-picture" }, lighting?.element, raw), well, region?.element, histogram,
    h("div", { class: "row below-histogram" },
      h("span", {}, h("span", { class: "soft" }, "Mean "), mean), clipping,
      h("span", {}, h("span", { class: "soft" }, "Analyser "), angle),
      h("span", {}, h("span", { class: "soft" }, "Frame "), frame)), aids.element);

  async function poll() {
    let last = null;
    while (!signal.aborted) {
      const began = performance.now();
      try {
        if (!document.hidden && service.reachable !== false) last = await look(last);
      } catch (problem) {
        if (problem.name === "AbortError") return;
        last = null;
        image.hidden = true;
        aids.clear();
        empty.hidden = false;
        say(empty, problem.slug === "busy" ? "A session or a measurement has the camera." : [problem.message, problem.remedy].filter(Boolean).join(" "));
        // Numbers of a frame that is not shown would be taken for the present.
        for (const output of [about, mean, saturated, angle, frame]) say(output, "–");
        curve.removeAttribute("d");
        delete clipping.dataset.level;
        await pause(1000, signal);
      }
      await pause(Math.max(50, PERIOD_MS - (performance.now() - began)), signal);
    }
  }

  async function look(last) {
    const facts = await get("/devices/camera/preview", { signal });
    if (facts.sequence === last) return last;
    // As many pixels as the screen shows, in steps, so that the service can keep scaled frames.
    const wanted = Math.min(facts.width, 160 * Math.ceil(((well.clientWidth || 640) * devicePixelRatio) / 160));
    const { blob } = await picture(`/devices/camera/preview.png?width=${wanted}&stretch=${!raw.box.checked}`, { signal });
    show(image, blob);
    // Saturation and sharpness are those of the values as measured.
    const measured = raw.box.checked || !aids.active() ? blob : (await picture(`/devices/camera/preview.png?width=${wanted}`, { signal })).blob;
    await aids.look(measured, facts.width);
    region?.fit(facts.width, facts.height);
    well.style.aspectRatio = `${facts.width} / ${facts.height}`;
    empty.hidden = true;
    draw(facts);
    return facts.sequence;
  }

  function draw({ histogram: counts, saturated: share, mean: level, stretch, analyser_deg, sequence, width, height }) {
    // The square root shows both the bulk and the few pixels that matter at the ends.
    const top = Math.sqrt(Math.max(1, ...counts));
    const steps = counts.map((n, i) => `V${(HEIGHT * (1 - Math.sqrt(n) / top)).toFixed(1)}H${i + 1}`);
    curve.setAttribute("d", `M0 ${HEIGHT}${steps.join("")}V${HEIGHT}Z`);
    say(mean, percent(level, 0));
    say(saturated, percent(share, 2));
    clipping.dataset.level = share > 0.001 ? "bad" : share > 0 ? "warn" : "good";
    say(angle, analyser_deg === null ? "–" : `${analyser_deg.toFixed(2)}°`);
    say(frame, String(sequence));
    const shown = raw.box.checked ? "raw values" : `contrast stretched from ${percent(stretch[0], 0)} to ${percent(stretch[1], 0)}`;
    say(about, `${width} × ${height} · ${shown}`);
  }
}
