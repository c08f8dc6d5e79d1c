// A second view over the first one, from a line that can be moved.

import { h, pen, say } from "./dom.js";

/**
 * What lies over the first canvas: the second one, cut off left of the line, the line, and what both are called.
 * `moved(percent)` is told where the line is put.
 */
export function divider({ state, moved, signal }) {
  const canvas = h("canvas", { class: "view other", id: "view-other", "aria-hidden": "true" });
  const line = h("div", { class: "divider", id: "view-divider", role: "slider", tabindex: 0, "aria-label": "Line between the two results", "aria-valuemin": 0, "aria-valuemax": 100 });
  const [left, right] = [h("span", { class: "called" }), h("span", { class: "called right" })];
  const element = h("div", { class: "comparing", hidden: true }, canvas, left, right, line);

  function refresh() {
    const at = `${state.split}%`;
    line.style.left = at;
    canvas.style.clipPath = `inset(0 0 0 ${at})`;
    line.setAttribute("aria-valuenow", String(Math.round(state.split)));
    line.setAttribute("aria-valuetext", `${Math.round(state.split)} % of the width for ${left.textContent}, the rest for ${right.textContent}`);
  }
  function move(split) {
    moved(Math.min(100, Math.max(0, split)));
    refresh();
  }
  line.addEventListener("pointerdown", (event) => line.setPointerCapture(event.pointerId), { signal });
  line.addEventListener("pointermove", (event) => {
    if (!line.hasPointerCapture(event.pointerId)) return;
    const box = element.getBoundingClientRect();
    move((100 * (event.clientX - box.left)) / box.width);
  }, { signal });
  line.addEventListener("keydown", (event) => {
    const step = event.shiftKey ? 10 : 1;
    const to = { ArrowLeft: state.split - step, ArrowRight: state.split + step, Home: 0, End: 100 }[event.key];
    if (to === undefined) return;
    event.preventDefault();
    move(to);
  }, { signal });
  return {
    element, canvas, refresh,
    /** Shows or hides the second one; names are those of both. */
    open(names) {
      element.hidden = !names;
      if (!names) return;
      say(left, names[0]);
      say(right, names[1]);
      refresh();
    },
  };
}

/** Both pictures as one, as they lie over each other. */
export function together(first, second, percent) {
  const { width, height } = first;
  const both = h("canvas", { width, height });
  const context = pen(both);
  const x = Math.round((percent / 100) * width);
  context.drawImage(first, 0, 0);
  if (x < width) context.drawImage(second, x, 0, width - x, height, x, 0, width - x, height);
  return both;
}
