// A full turn of a view as numbered pictures in one archive.

import { field, firstOf, h, number, panel, say, select } from "./dom.js";
import { zipped } from "./zip.js";

/** The state of a view after a share of a full turn. */
function turnedBy(state, axis, share) {
  if (axis === "light") return { azimuth: (state.azimuth + 360 * share) % 360 };
  const roll = state.roll + 360 * share;
  return { roll: roll > 180 ? roll - 360 : roll };
}

/**
 * The panel that asks for the turn. `picture(values)` draws the view with other values of its state once all samples are
 * there and resolves to a PNG; `done()` is called at the end.
 */
export function turntable({ state, picture, done, save, name, signal }) {
  const count = number({ id: "turn-count", value: 36, min: 2, max: 720, step: 1, required: true });
  const axis = select([["sample", "The sample, in its plane"], ["light", "The light, around the sample"]], "sample", { id: "turn-axis" });
  const said = h("p", { class: "soft", role: "status" });
  const button = h("button", { type: "submit", id: "turn-start" }, "Download frames");
  let running = null;

  async function begin() {
    running = new AbortController();
    const stop = firstOf(running.signal, signal);
    const frames = count.valueAsNumber;
    button.textContent = "Cancel";
    const files = [];
    try {
      for (let k = 0; k < frames && !stop.aborted; k++) {
        say(said, `Frame ${k + 1} of ${frames}`);
        const blob = await picture(turnedBy(state, axis.value, k / frames), stop);
        if (blob) files.push({ name: `${name}-${String(k).padStart(3, "0")}.png`, bytes: new Uint8Array(await blob.arrayBuffer()) });
      }
      if (!stop.aborted) save(zipped(files), `${name}-turn.zip`);
      say(said, stop.aborted ? "Cancelled." : `${frames} pictures of a full turn, ${(360 / frames).toFixed(1)}° apart.`);
    } finally {
      running = null;
      button.textContent = "Download frames";
      done();
    }
  }
  const form = h("form", { class: "stack", onsubmit: (event) => {
    event.preventDefault();
    if (running) running.abort();
    else begin();
  } }, h("div", { class: "fields" }, field("Frames", count), field("What turns", axis)), h("div", { class: "row" }, button, said));
  return panel("Turntable", null, form);
}
