// A sample under a light: drag to turn either. Knows nothing of the service, so that it also works in a file of its own.

import { chosen, WAYS } from "./card.js";
import { divider, together } from "./comparing.js";
import { field, h, panel, save, say, segments, select } from "./dom.js";
import { degrees, fixed, significant } from "./format.js";
import { canShow, Layer, SHOWN } from "./layer.js";
import { bar, maskedKey, wheel } from "./legend.js";
import { lightDisc, pointers } from "./pointing.js";
import { rulerOver } from "./ruler.js";
import { fromDisc, mapped, onSample, toDisc } from "./turning.js";
import { turntable } from "./turntable.js";

// Longest time that a frame may take while something moves, in ms; coarser pictures are drawn until it holds.
const FRAME = 60;

/**
 * How a view begins. Angles in degrees, exposure in stops, quality as a relative error, the line between two
 * results in percent, x and y of what is in the middle of the picture in mm from that of the sample at rest; and the way
 * to draw, "" for the best. */
export const START = { roll: 0, tilt: 0, pan: 0, azimuth: 90, elevation: 58, distance: 490, zoom: 1, x: 0, y: 0, exposure: 2, quality: 0.01, split: 50, shown: "light", draw: "" };

/** A state from what follows the question mark of a link; what makes no sense is left out. */
export function stateOf(text) {
  const asked = new URLSearchParams(text);
  const state = {};
  for (const [key, start] of Object.entries(START)) {
    const value = asked.get(key);
    if (value === null) continue;
    if (typeof start === "number" && Number.isFinite(Number(value))) state[key] = Number(value);
    const known = { shown: SHOWN, draw: WAYS }[key];
    if (known?.some(([k]) => k === value)) state[key] = value;
  }
  return state;
}

/** What follows the question mark of a link to a state. */
export const stateText = (state) => new URLSearchParams(Object.entries(state).map(([key, value]) => [key, String(value)])).toString();

/**
 * Shows a parsed view until the signal fires. `state` holds what differs from START; `changed(state)` is told after each
 * change, `anew(state)` when everything has to be drawn another way, `aside` are more panels. Returns the parts of it for tests.
 * @param {HTMLElement} main
 * @param {{ view: View, state?: Partial<typeof START>, changed?: (state: Partial<typeof START>) => void, anew: (state: Partial<typeof START>) => void, name?: string, aside?: HTMLElement[], signal: AbortSignal }} options
 */
export async function viewer(main, { view, state: given = {}, changed = () => {}, anew, name = "sample", aside = [], signal }) {
  const state = { ...START, ...given };
  const card = await chosen(state.draw, view);
  if (signal.aborted) card.close();
  signal.throwIfAborted();
  if (!canShow(view, state.shown)) state.shown = "light";
  const canvas = h("canvas", { id: "view", class: "view", tabindex: 0, role: "application", "aria-roledescription": "viewer",
    "aria-label": "The sample under a light. Arrow keys turn it, Shift with arrows moves the light, Ctrl with arrows moves the picture, plus and minus zoom, 0 starts over." });
  const first = new Layer(canvas, card);
  const { painter } = first;
  const line = divider({ state, moved: (split) => change({ split }, false, false), signal });
  // The result that this one is compared with; its canvas is made once.
  /** @type {Layer | null} */
  let second = null;
  let comparing = false;
  const layers = () => (comparing && second ? [first, second] : [first]);
  const ruler = rulerOver({ view: () => view, uniforms: () => painter.uniforms, canvas, signal });
  const probe = h("output", { class: "where" });
  const status = h("p", { class: "soft", role: "status" });
  const legend = h("div", { class: "legend" });
  const rose = wheel();
  let scale = 1;
  let moving = 0;
  /** @type {number | null} */
  let base = null;
  let waiting = 0;
  // Something has changed since the last frame began.
  let posed = false;
  // Frames of a turntable are being drawn.
  let turning = false;

  function load(next) {
    view = next;
    first.load(view);
    base = null;
    refresh();
  }

  /** Shows another view from the line on, with the names of both; or none. */
  function compare(other, names) {
    comparing = Boolean(other);
    if (other) {
      second ??= new Layer(line.canvas, card);
      second.load(other);
    }
    line.open(other && names);
    size();
    refresh();
  }

  /** Whatever depends on the state. */
  function pose() {
    const error = moving ? Math.max(0.1, state.quality) : state.quality;
    for (const layer of layers()) layer.pose(state, error, first.range);
    ruler.refresh();
  }

  function refresh() {
    if (turning) return;
    pose();
    posed = true;
    next();
  }

  /** Draws with the screen's next frame. */
  function next() {
    if (!waiting && !signal.aborted) waiting = requestAnimationFrame(() => frame().catch(failed));
  }

  /** @param {Error} problem */
  const failed = (problem) => signal.aborted || say(status, problem.message);

  /** Of samples that a pixel gets once nothing moves. */
  const enough = () => (state.shown === "light" ? Math.round(Math.min(64, Math.max(4, 0.16 / state.quality))) : 4);

  /** One frame of the screen; the next one waits until the card has drawn it. */
  async function frame() {
    if (!signal.aborted && !turning && canvas.width) {
      posed = false;
      const begun = performance.now();
      await add(moving ? scale : 1);
      if (signal.aborted) return;
      show();
      for (const layer of layers()) await layer.painter.done();
      if (moving) {
        const took = performance.now() - begun;
        scale = Math.min(8, Math.max(1, scale * Math.sqrt(Math.max(0.5, Math.min(2, took / FRAME)))));
      }
      say(status, moving ? "" : painter.count < enough() ? `${painter.count} of ${enough()} samples` : `${painter.count} samples a pixel; sums asked to within ${significant(100 * state.quality, 2)} %`);
    }
    waiting = 0;
    if (!turning && canvas.width && (posed || (!moving && painter.count < enough()))) next();
  }

  /** Adds a sample to each pixel. */
  async function add(factor) {
    for (const layer of layers()) layer.add(factor);
    if (state.shown !== "light" || base !== null) return;
    const of = view;
    const found = await first.brightness();
    // It may be another view by now.
    if (of === view) base = found;
  }

  /** Shows what there is, both results as bright. */
  function show() {
    for (const layer of layers()) layer.show((base ?? 1) * 2 ** state.exposure);
  }

  /** The picture as it is on the screen, as a PNG. */
  /** @returns {Promise<Blob>} */
  function png() {
    show();
    const whole = comparing ? together(canvas, line.canvas, state.split) : canvas;
    return new Promise((resolve, reject) => whole.toBlob((blob) => (blob ? resolve(blob) : reject(new Error("The browser could not make a PNG of this picture.")))));
  }

  /** The picture with other values of the state, once all its samples are there; null where it is given up. */
  async function picture(values, stop) {
    turning = true;
    moving = 0;
    for (const layer of layers()) layer.pose({ ...state, ...values }, state.quality, first.range);
    ruler.refresh();
    while (painter.count < enough()) {
      await add(1);
      show();
      for (const layer of layers()) await layer.painter.done();
      // Lets the page breathe; frames of the screen would stand still in a hidden tab.
      await new Promise((resolve) => setTimeout(resolve));
      if (stop.aborted) return null;
    }
    return png();
  }

  /** @type {number | undefined} */
  let rest;
  /** Something changes: coarser pictures while it moves, until it has been still for a moment; `anew` where the picture is another one. */
  function change(values, isMoving = true, anew = true) {
    Object.assign(state, values);
    if (anew) {
      moving = isMoving ? 1 : 0;
      refresh();
    }
    clearTimeout(rest);
    rest = setTimeout(() => {
      if (moving) {
        moving = 0;
        refresh();
      }
      changed(differing());
    }, 250);
  }
  const differing = () => Object.fromEntries(Object.entries(state).filter(([k, v]) => START[k] !== v));

  const disc = lightDisc(state, change, signal);
  let target = "sample";
  const turn = ([dx, dy], what) => {
    if (what === "light") {
      const [x, y] = toDisc(state);
      change(fromDisc([x + dx / 200, y - dy / 200]));
      disc.refresh();
    } else if (what === "picture") move([dx, dy]);
    else change({ pan: clamp(state.pan + dx / 3, 85), tilt: clamp(state.tilt + dy / 3, 85) });
  };
  // To a thousandth of a mm, so that links stay short.
  const near = (/** @type {number} */ mm) => Math.round(1000 * clamp(mm, first.most)) / 1000;
  /** Moves the picture by CSS pixels; what is looked at stays near the sample. */
  const move = ([dx, dy]) => {
    const scale = first.tall / state.zoom / canvas.clientHeight;
    change({ x: near(state.x - dx * scale), y: near(state.y + dy * scale) });
  };
  pointers(canvas, {
    signal, zoom, click: ruler.place, hover: read, pan: move,
    drag: (by, event) => turn(by, event.shiftKey ? "light" : target),
    // Two clicks are two points of the ruler.
    again: () => ruler.isOn() || change({ zoom: 1, x: 0, y: 0 }),
  });
  canvas.addEventListener("keydown", (event) => {
    const by = { ArrowLeft: [-6, 0], ArrowRight: [6, 0], ArrowUp: [0, -6], ArrowDown: [0, 6] }[event.key];
    // Arrows lead to what lies there, as scroll bars do.
    if (by && (event.ctrlKey || target === "picture")) move([-5 * by[0], -5 * by[1]]);
    else if (by) turn(by, event.shiftKey ? "light" : target);
    else if (event.key === "+" || event.key === "=") zoom(1.2);
    else if (event.key === "-") zoom(1 / 1.2);
    else if (event.key === "0") again();
    else return;
    event.preventDefault();
  }, { signal });

  /** Zooms; what is at a place of the canvas stays there. */
  function zoom(factor, [px, py] = [canvas.clientWidth / 2, canvas.clientHeight / 2]) {
    const next = Math.min(40, Math.max(0.3, state.zoom * factor));
    const gained = (first.tall / canvas.clientHeight) * (1 / state.zoom - 1 / next);
    const [x, y] = [state.x + (px - canvas.clientWidth / 2) * gained, state.y - (py - canvas.clientHeight / 2) * gained];
    change({ zoom: next, x: near(x), y: near(y) });
  }

  function again() {
    const { shown, quality, split, draw } = state;
    change({ ...START, shown, quality, split, draw }, false);
    sliders.forEach((s) => s.refresh());
    disc.refresh();
  }

  /** What is under the pointer. */
  function read(at) {
    const box = [canvas.clientWidth, canvas.clientHeight];
    const uv = at && onSample(painter.uniforms, [at[0] / box[0], at[1] / box[1]], box);
    const found = uv && mapped(view, uv);
    say(probe, !uv ? "" : !found ? "masked" : [found.x === undefined ? "" : `x ${found.x}  y ${found.y}`, degrees(found.orientation, 1) + (found.sigma === null ? "" : ` ± ${degrees(found.sigma, 2)}`), `${fixed(found.period, 3)} µm`].filter(Boolean).join("   "));
    if (found) rose.mark(found.orientation);
  }

  const sliders = [
    slider("Turn in its plane", "roll", [-180, 180, 1], (v) => degrees(v, 0)),
    slider("Exposure", "exposure", [-6, 6, 0.1], (v) => `${v > 0 ? "+" : ""}${fixed(v, 1)} stops`, false),
    slider("Light's distance", "distance", [200, 2000, 10], (v) => `${fixed(v, 0)} mm`),
  ];

  /** A slider of one number of the state. */
  function slider(label, key, [min, max, step], text, redraw = true) {
    const input = h("input", { type: "range", min, max, step, value: state[key], id: `view-${key}` });
    const output = h("output", {});
    const refreshed = () => {
      input.value = state[key];
      say(output, text(state[key]));
    };
    input.addEventListener("input", () => {
      change({ [key]: Number(input.value) }, redraw);
      refreshed();
    });
    refreshed();
    return Object.assign(h("div", { class: "slide" }, h("label", { for: input.id }, label), output, input), { refresh: refreshed });
  }

  const shown = segments("Shown", SHOWN.filter(([key]) => canShow(view, key)), state.shown, (key) => {
    change({ shown: key }, false);
    explain();
  });
  const dragging = segments("Dragging moves", [["sample", "Sample"], ["light", "Light"], ["picture", "Picture"]], target, (key) => { target = key; });
  const way = select(WAYS, state.draw, { id: "view-draw", onchange: () => {
    Object.assign(state, { draw: way.value });
    anew(differing());
  } });
  const quality = h("select", { id: "view-quality", onchange: (e) => change({ quality: Number(e.target.value) }, false) },
    [[0.03, "Fast: 3 %"], [0.01, "Good: 1 %"], [0.0025, "Best: 0.25 %"]].map(([v, text]) => h("option", { value: v, selected: v === state.quality }, text)));

  function explain() {
    const [low, high, , most] = first.range;
    const keys = { light: [], orientation: [rose, maskedKey()], period: [bar([low, high], " µm"), maskedKey()], sigma: [bar([0, (most * 180) / Math.PI], "°"), maskedKey()] }[state.shown];
    legend.replaceChildren(...keys);
    rose.refresh();
  }

  const shot = h("button", { type: "button", id: "view-shot", onclick: async () => save(await png(), `${name}.png`) }, "Screenshot");
  const reset = h("button", { type: "button", id: "view-reset", onclick: again }, "Start over");
  const done = () => {
    turning = false;
    refresh();
  };

  main.append(h("div", { class: "columns result" },
    h("section", { class: "panel mappanel", "aria-label": "View" },
      h("header", {}, shown, h("div", { class: "row" }, ruler.button, reset, shot)),
      h("div", { class: "well viewwell" }, canvas, line.element, ruler.drawing, probe),
      h("div", { class: "under" }, legend, h("div", { class: "stack" }, h("p", { class: "soft" }, "Drag to turn the sample, with Shift to move the light, with the right button, Ctrl or two fingers to move the picture. The wheel zooms; a double click shows all again."), ruler.said, status))),
    h("div", { class: "stack" },
      panel("Light and pose", null, h("div", { class: "stack" }, h("div", { class: "row between" }, h("span", { class: "soft" }, "Dragging moves"), dragging), disc, sliders)),
      aside,
      panel("Quality", null, h("div", { class: "stack" }, field("Error of the sums when still", quality),
        field("Drawn with", way, { hint: state.draw === card.way.toLowerCase() ? null : `${card.way}${card.why ? `: ${card.why}` : ""}.` }))),
      turntable({ state, picture, done, save, name, signal }))));

  /** Brings the canvases to the size that they have on the page. */
  function size() {
    const ratio = Math.min(devicePixelRatio, 2);
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((n) => Math.max(1, Math.round(n * ratio)));
    for (const layer of layers()) {
      if (layer.canvas.width === width && layer.canvas.height === height) continue;
      // A canvas goes black with its size: the picture before is shown on it until there is another.
      Object.assign(layer.canvas, { width, height });
      if (layer.painter.targets.length) layer.show((base ?? 1) * 2 ** state.exposure);
    }
  }
  const observer = new ResizeObserver(() => {
    size();
    refresh();
  });
  load(view);
  explain();
  observer.observe(canvas);
  addEventListener("themechange", () => { rose.refresh(); disc.refresh(); }, { signal });
  signal.addEventListener("abort", () => {
    observer.disconnect();
    clearTimeout(rest);
    painter.close();
    second?.painter.close();
    card.close();
  });
  card.lost((sentence) => say(status, sentence));
  canvas.addEventListener("webglcontextlost", () => say(status, "The graphics card was reset. Reload the page."), { signal });
  // For tests and the console: what is drawn can be read by script.
  const parts = { painter, card, state, change, enough, compare, load: (next) => { load(next); explain(); } };
  Object.assign(canvas, { viewer: parts });
  return parts;
}

const clamp = (value, most) => Math.min(most, Math.max(-most, value));
