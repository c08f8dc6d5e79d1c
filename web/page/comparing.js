// A second view over the first one, from a line that can be moved.

import { h, pen, say } from "./dom.js";

/**
 * A line that is moved across an element by mouse, finger and arrow keys; `moved(percent)` gets its place in percent of
 * the width.
 * @param {{ id: string, within: () => Element, split: () => number, moved: (percent: number) => void, signal: AbortSignal }} options
 */
export function movableLine({ id, within, split, moved, signal }) {
  const line = h("div", { class: "divider", id, role: "slider", tabindex: 0, "aria-label": "Line between the two results", "aria-valuemin": 0, "aria-valuemax": 100 });
  const move = (percent) => moved(Math.min(100, Math.max(0, percent)));
  line.addEventListener("pointerdown", (event) => line.setPointerCapture(event.pointerId), { signal });
  line.addEventListener("pointermove", (event) => {
    if (!line.hasPointerCapture(event.pointerId)) return;
    const box = within().getBoundingClientRect();
    move((100 * (event.clientX - box.left)) / box.width);
  }, { signal });
  line.addEventListener("keydown", (event) => {
    const step = event.shiftKey ? 10 : 1;
    const to = { ArrowLeft: split() - step, ArrowRight: split() + step, Home: 0, End: 100 }[event.key];
    if (to === undefined) return;
    event.preventDefault();
    move(to);
  }, { signal });
  /** Puts the line where it belongs, and says between which two it lies. */
  const refresh = (first, second) => {
    line.style.left = `${split()}%`;
    line.setAttribute("aria-valuenow", String(Math.round(split())));
    line.setAttribute("aria-valuetext", `${Math.round(split())} % of the width for ${first}, the rest for ${second}`);
  };
  return Object.assign(line, { refresh });
}

/**
 * What lies over the first canvas: the second one, cut off left of the line, the line, and what both are called.
 * `moved(percent)` is told where the line is put.
 */
export function divider({ state, moved, signal }) {
  const canvas = h("canvas", { class: "view other", id: "view-other", "aria-hidden": "true" });
  const line = movableLine({ id: "view-divider", within: () => element, split: () => state.split, signal, moved: (percent) => {
    moved(percent);
    refresh();
  } });
  const [left, right] = [h("span", { class: "called" }), h("span", { class: "called right" })];
  const element = h("div", { class: "comparing", hidden: true }, canvas, left, right, line);

  function refresh() {
    canvas.style.clipPath = `inset(0 0 0 ${state.split}%)`;
    line.refresh(left.textContent, right.textContent);
  }
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
