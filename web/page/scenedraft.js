// The draft of a scene: a small noisy picture that follows each change. A newer one gives up the one before.

import { send, show } from "./api.js";
import { firstOf, h, say, settle } from "./dom.js";

/** Longest side of a draft in pixels, and the wait after a change in ms. */
const [SIDE, WAIT] = [240, 200];

/**
 * @param {any} doc
 * @param {AbortSignal} signal
 */
export function sceneDraft(doc, signal) {
  const image = h("img", { id: "draft", alt: "Draft of the scene", hidden: true });
  const state = h("p", { class: "soft", role: "status", "aria-live": "polite" });
  const element = h("div", { class: "stack" }, h("div", { class: "well draft" }, image), state);
  let newest = new AbortController();
  // Text of the shown draft, and its description.
  let [shown, drawn] = ["", ""];

  const draw = settle(WAIT, async () => {
    const { toml, problem } = doc.now();
    if (toml === null) return;
    newest.abort();
    if (toml === shown) return say(state, drawn);
    if (problem) return say(state, "The draft follows once the scene can be rendered.");
    const mine = (newest = new AbortController());
    image.classList.add("busy");
    say(state, "Drawing a draft…");
    try {
      const begun = performance.now();
      const answer = await send(`/uploads/${doc.upload}/scene/draft`, {
        method: "POST", body: JSON.stringify({ toml, side: SIDE }), headers: { "Content-Type": "application/json" }, signal: firstOf(mine.signal, signal),
      });
      show(image, await answer.blob());
      shown = toml;
      drawn = `Draft of 8 samples per pixel, ${((performance.now() - begun) / 1000).toFixed(1)} s.`;
      say(state, drawn);
    } catch (error) {
      if (error.name === "AbortError") return;
      say(state, `No draft: ${error.message}`);
    } finally {
      if (mine === newest) image.classList.remove("busy");
    }
  });
  return { element, draw };
}
