// A view in a file of its own: what the file holds, shown.

import { h } from "./dom.js";
import { parseView } from "./parsed.js";
import { stateOf, stateText, viewer } from "./viewer.js";

/** Shows the view of the page. */
export async function start() {
  const main = /** @type {HTMLElement} */ (document.getElementById("main"));
  const { title = "", state = "" } = main.dataset;
  try {
    const packed = Uint8Array.from(atob(document.getElementById("data")?.textContent ?? ""), (c) => c.charCodeAt(0));
    const buffer = await new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
    main.append(h("div", { class: "head" }, h("h1", { class: "grow" }, title)));
    // The address says more than the file, so that a view can be shown anew.
    await viewer(main, { view: parseView(buffer), state: { ...stateOf(state), ...stateOf(location.hash.slice(1)) }, name: title, signal: new AbortController().signal, anew: (now) => {
      location.hash = stateText(now);
      location.reload();
    } });
  } catch (problem) {
    main.append(h("p", { class: "message", role: "alert" }, problem.message));
  }
}
