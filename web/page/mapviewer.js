// The viewer of a result's maps: canvas and tools, colours, values, measurements, comparison and figures.

import { get } from "./api.js";
import { h, pen, save, say, segments, select, settle } from "./dom.js";
import { complain, tell } from "./feedback.js";
import { colorsPanel } from "./mapcolors.js";
import { comparison } from "./mapcompare.js";
import { drawDirections, drawScaleBar } from "./mapdecor.js";
import { figure, figureName, pngOf, svgFile } from "./mapfigure.js";
import { showKeys } from "./mapkeys.js";
import { DifferenceLayer, MapLayer, apart } from "./maplayer.js";
import { measurements } from "./mapmeasure.js";
import { TOOLS, shapesOver } from "./mapshapes.js";
import { titleOf, valueText } from "./mapvalues.js";
import { MapView } from "./mapview.js";
import { TileStore } from "./tiles.js";

/**
 * Shows maps until the signal fires.
 * @param {{ id: string, method: string, maps: MapInfo[], first: string[], palette: string, title: string, named: string, pick: (x: number, y: number) => void,
 *   shown: (info: MapInfo) => void, under: Child, signal: AbortSignal }} options `first` are names of
 *   maps that get buttons, the others stand in a list; `palette` of directions; `named` for files
 */
export function mapViewer({ id, method, maps, first, palette, title, named, pick, shown, under, signal }) {
  const base = `/reconstructions/${id}`;
  const canvas = h("canvas", { id: "result-map", class: "map", tabindex: 0, role: "application", "aria-roledescription": "map", "aria-describedby": "map-keys-hint" });
  const where = h("output", { class: "where", id: "map-value" });
  /** @type {Map<string, TileStore>} */
  const stores = new Map();
  const storeOf = (/** @type {string} */ of) => {
    const known = stores.get(of) ?? new TileStore(`/reconstructions/${of}`, { arrived, complain, signal });
    stores.set(of, known);
    return known;
  };
  /** @type {Map<string, MapLayer>} */
  const layers = new Map();
  const layerOf = (/** @type {string} */ of, /** @type {MapInfo} */ info) => {
    const key = `${of} ${info.name}`;
    const known = layers.get(key) ?? new MapLayer(storeOf(of), info);
    layers.set(key, known);
    return known;
  };
  const sigmaOf = (/** @type {string} */ of, /** @type {MapInfo} */ info) => {
    const sigma = info.sigma === null ? null : maps.find((m) => m.name === info.sigma);
    return sigma ? layerOf(of, sigma) : null;
  };
  let layer = layerOf(id, maps[0]);
  /** @type {{ id: string, layer: MapLayer, difference: DifferenceLayer } | null} */
  let second = null;
  /** @type {{ x: number, y: number, exact: boolean } | null} */
  let hovered = null;
  let ranged = false;

  const colors = colorsPanel({ base, palette, maps, changed: () => { style(); view.draw(); remeasure(); }, signal });
  const measured = measurements({ base, named, signal });
  const shapes = shapesOver({ view: () => view, signal, changed: (_, corners) => measured.measure(layer.info, corners && shapes.shape, colors.palette, colors.ends) });
  const compare = comparison({ id, method, maps, first: () => layer.info, signal, changed: () => { legend(); view.draw(); }, chosen: (choice) => {
    second = null;
    if (choice) {
      const other = layerOf(choice.id, choice.info);
      second = { id: choice.id, layer: other, difference: new DifferenceLayer(layer, other) };
      ranged = false;
      if (choice.info.name !== layer.info.name) colors.endsOf(choice.info).then(() => { style(); view.draw(); }, complain);
    }
    style();
    legend();
    view.draw();
  } });
  const view = new MapView(canvas, {
    width: maps[0].width, height: maps[0].height, paint, pick, signal, key,
    moved: () => shapes.refresh(),
    hover: (pixel) => {
      hovered = pixel && { x: pixel[0], y: pixel[1], exact: false };
      readOut();
      if (pixel) wantExact();
    },
    draws: (phase, point) => shapes.draws(phase, point),
  });
  const wantExact = settle(90, () => {
    if (!hovered || signal.aborted) return;
    hovered.exact = true;
    readOut();
  });

  function arrived() {
    view.draw();
    readOut();
  }

  /** Shows the colours of the difference while it is shown, and those of the map otherwise. */
  function legend() {
    colors.showDifference(second && compare.state.mode === "difference" ? second.difference : null);
  }

  /** Gives every layer its colours. */
  function style() {
    const faded = colors.fade && sigmaOf(id, layer.info);
    layer.look(colors.palette, colors.ends[0], colors.ends[1]);
    layer.fade = faded && colors.fadeEnd ? { layer: faded, high: colors.fadeEnd } : null;
    if (!second) return;
    const same = second.layer.info.name === layer.info.name;
    const [low, high] = same ? colors.ends : colors.knownEnds(second.layer.info);
    second.layer.look(same ? colors.palette : colors.paletteOf(second.layer.info), low, high);
    second.layer.fade = null;
  }

  /** Draws all that is visible. */
  function paint(/** @type {CanvasRenderingContext2D} */ context, /** @type {Sight} */ sight, decorated = true) {
    for (const store of stores.values()) store.forgetWishes();
    const { width, height } = context.canvas;
    const { mode, split } = compare.state;
    if (second && mode === "difference") {
      const complete = second.difference.draw(context, sight);
      if (!ranged && complete) {
        ranged = true;
        const most = second.difference.range();
        second.difference.look("blue_red", -most, most);
        second.difference.draw(context, sight);
        colors.showDifference(second.difference);
      }
    } else if (second && mode === "blink" && compare.state.second) second.layer.draw(context, sight);
    else layer.draw(context, sight);
    if (second && mode === "slider") {
      context.save();
      context.beginPath();
      context.rect((width * split) / 100, 0, width, height);
      context.clip();
      context.clearRect(0, 0, width, height);
      second.layer.draw(context, sight);
      context.restore();
    }
    const directions = colors.glyphs && (layer.isDirection ? layer.info : maps.find((m) => m.kind === "direction" && m.width === layer.info.width));
    if (directions) drawDirections(context, layerOf(id, directions), sight, devicePixelRatio);
    if (decorated) drawScaleBar(context, { width, height, scale: sight.scale, ratio: devicePixelRatio, pixelUm: layer.info.pixel_um });
    // The pixel below the pointer is wanted too, at full resolution.
    if (hovered?.exact) read(layer, id, hovered.x, hovered.y);
  }

  /** A value in words; "≈" before means over several pixels while the pixel itself is not there yet. */
  function read(of, result, x, y) {
    const exact = hovered?.exact ?? false;
    const found = of.value(x, y, 0, exact);
    if (!found) return "…";
    const sigma = sigmaOf(result, of.info)?.value(x, y, 0, exact);
    return `${found.level ? "≈ " : ""}${valueText(of.info, found.value, sigma && sigma.level === found.level ? sigma.value : null)}`;
  }

  function readOut() {
    if (!hovered) return say(where, "");
    const { x, y } = hovered;
    const first = `x ${x}  y ${y}   ${titleOf(layer.info)} ${read(layer, id, x, y)}`;
    if (!second) return say(where, first);
    const [a, b] = [layer.value(x, y, 0, hovered.exact), second.layer.value(x, y, 0, hovered.exact)];
    const same = second.layer.info.name === layer.info.name;
    const difference = same && a && b ? `   difference ${valueText({ ...layer.info, kind: "number" }, apart(a.value, b.value, layer.isDirection))}` : "";
    say(where, `${first}   ${same ? "other" : titleOf(second.layer.info)} ${read(second.layer, second.id, x, y)}${difference}`);
  }

  async function change(/** @type {MapInfo} */ info) {
    // Its colours take as much memory as its numbers.
    if (layer !== second?.layer) layer.painted.clear();
    layer = layerOf(id, info);
    buttons.mark(info.name);
    more.value = first.includes(info.name) ? "" : info.name;
    if (info.width !== view.width || info.height !== view.height) {
      shapes.clear();
      [view.width, view.height] = [info.width, info.height];
      view.fit();
    }
    say(hint, `${titleOf(info)} map. Arrows move it, plus and minus zoom, 0 shows all. Press the question mark for all keys.`);
    canvas.setAttribute("aria-label", `${titleOf(info)} map`);
    shown(info);
    if (second) second.difference = new DifferenceLayer(layer, second.layer);
    ranged = false;
    style();
    view.draw();
    try {
      if (!(await colors.show(info, sigmaOf(id, info)?.info ?? null)) || layer.info !== info) return;
      style();
      view.draw();
      remeasure();
      await compare.offer();
    } catch (problem) {
      complain(problem);
    }
  }
  const remeasure = () => measured.measure(layer.info, shapes.shape, colors.palette, colors.ends);

  const tools = segments("Tool", TOOLS, "move", (tool) => useTool(tool));
  function useTool(tool, make = false) {
    tools.mark(tool);
    shapes.choose(tool, make);
    clear.disabled = tool === "move";
    canvas.dataset.tool = tool;
  }
  // A click by the keyboard has no count; whoever has no mouse gets a shape to move.
  tools.addEventListener("click", (event) => { if (event.detail === 0) shapes.choose(shapes.tool, true); }, { signal });
  tools.addEventListener("keyup", (event) => { if (event.key.startsWith("Arrow")) shapes.choose(shapes.tool, true); }, { signal });
  const clear = h("button", { type: "button", id: "shape-clear", disabled: true, onclick: () => shapes.clear() }, "Clear");

  function key(/** @type {KeyboardEvent} */ event) {
    const info = /^[1-9]$/.test(event.key) ? maps[Number(event.key) - 1] : undefined;
    const tool = { v: "move", l: "line", r: "rectangle", g: "polygon" }[event.key.toLowerCase()];
    const acts = { "?": showKeys, Escape: () => shapes.clear(), p: colors.nextPalette, "[": () => colors.stretch(0.8), "]": () => colors.stretch(1.25), o: colors.toggleGlyphs, f: colors.toggleFade, b: () => second && compare.flip() };
    if (info) change(info);
    else if (tool) useTool(tool, true);
    else if (acts[event.key]) acts[event.key]();
    else return false;
    return true;
  }

  /** The visible part as a figure. */
  function figureNow() {
    const picture = h("canvas", { width: canvas.width, height: canvas.height });
    const sight = view.sight();
    paint(pen(picture), sight, false);
    // The map alone, without the dark room around it.
    const edge = (v, k) => Math.round(sight.origin[k] + v * sight.scale);
    const [left, top] = [0, 1].map((k) => Math.max(0, edge(sight.part[k], k)));
    const [right, bottom] = [edge(sight.part[2], 0), edge(sight.part[3], 1)];
    const cut = h("canvas", { width: Math.max(1, right - left), height: Math.max(1, bottom - top) });
    pen(cut).drawImage(picture, -left, -top);
    const ratio = devicePixelRatio;
    const difference = second && compare.state.mode === "difference" ? second.difference : null;
    const of = difference ?? (second && compare.state.mode === "blink" && compare.state.second ? second.layer : layer);
    const shape = shapes.shape;
    const corners = shape?.corners.map((c) => view.toCanvas(c)).map(([x, y]) => [x - left / ratio, y - top / ratio]);
    const drawn = figure({ picture: cut, ratio, title: `${title} · ${difference ? `difference of ${titleOf(layer.info)}` : titleOf(of.info)}`, info: of.info, palette: of.palette,
      ends: [of.low, of.high], scale: view.zoom, shape: shape && corners ? { tool: shape.tool, corners } : null });
    return { drawn, picture: cut };
  }
  const attempt = (/** @type {() => Promise<unknown>} */ act) => async () => {
    try {
      await act();
    } catch (problem) {
      complain(problem);
    }
  };
  const copy = h("button", { type: "button", id: "figure-copy", onclick: attempt(async () => {
    const png = await pngOf(figureNow().drawn);
    if (navigator.clipboard?.write && globalThis.ClipboardItem) {
      await navigator.clipboard.write([new ClipboardItem({ "image/png": png })]);
      tell("The figure is copied.");
    } else {
      save(png, `${figureName(named, layer.info)}.png`);
      tell("This browser copies pictures only over HTTPS, so the figure is a download.");
    }
  }) }, "Copy figure");
  const png = h("button", { type: "button", id: "figure-png", "aria-label": "Figure as PNG", onclick: attempt(async () => save(await pngOf(figureNow().drawn), `${figureName(named, layer.info)}.png`)) }, "PNG");
  const vector = h("button", { type: "button", id: "figure-svg", "aria-label": "Figure as SVG", onclick: attempt(async () => save(svgFile(figureNow().drawn), `${figureName(named, layer.info)}.svg`)) }, "SVG");
  const pdf = h("button", { type: "button", id: "figure-pdf", "aria-label": "Figure as PDF", onclick: attempt(async () => {
    const { drawn, picture } = figureNow();
    const { pdfOf } = await import("./mappdf.js");
    save(await pdfOf(drawn, picture), `${figureName(named, layer.info)}.pdf`);
  }) }, "PDF");
  const keys = h("button", { type: "button", class: "icon", id: "map-keys", "aria-label": "Keys of the map", title: "Keys of the map (?)", onclick: showKeys }, "?");

  const names = (/** @type {boolean} */ early) => maps.filter((m) => first.includes(m.name) === early).map((m) => [m.name, titleOf(m)]);
  const byName = (/** @type {string} */ name) => change(/** @type {MapInfo} */ (maps.find((m) => m.name === name)));
  const buttons = segments("Map", names(true), maps[0].name, byName);
  const more = select([["", "More maps"], ...names(false)], "", { id: "map-choice", "aria-label": "More maps", onchange: (e) => byName(e.target.value || maps[0].name) });
  more.hidden = names(false).length === 0;
  const zoom = (label, words, call) => h("button", { type: "button", class: "icon", "aria-label": label, title: label, onclick: call }, words);
  const hint = h("p", { class: "sr", id: "map-keys-hint" });
  const element = h("section", { class: "panel mappanel", "aria-label": "Map" },
    h("header", {}, h("div", { class: "row" }, buttons, more), h("div", { class: "row" }, zoom("Zoom in", "+", () => view.scale(1.4)), zoom("Zoom out", "−", () => view.scale(1 / 1.4)), zoom("Show all", "⤢", () => view.fit()), keys)),
    h("div", { class: "well mapwell" }, canvas, shapes.drawing, compare.over, where), hint,
    h("div", { class: "row between maptools" }, h("div", { class: "row" }, tools, clear), h("div", { class: "row" }, copy, png, vector, pdf)),
    h("div", { class: "row between maptools" }, compare.element), under);
  // For tests and the console.
  Object.assign(canvas, { view, viewer: { layerOf: () => layer, second: () => second, stores, shapes, colors, compare } });
  change(maps[0]);
  return { element, aside: [colors.element, measured.element], mark: (x, y, deg) => { view.mark(x, y, deg); colors.mark(deg); }, colors };
}

/**
 * The maps of a result in a useful order, without those that say nothing.
 * @param {string} id
 * @param {string[]} order names that come first
 * @param {AbortSignal} signal
 * @returns {Promise<MapInfo[]>}
 */
export async function mapsOf(id, order, signal) {
  /** @type {MapInfo[]} */
  const all = await get(`/reconstructions/${id}/maps`, { signal });
  const place = (/** @type {MapInfo} */ m) => (order.indexOf(m.name) + 1 || 99);
  return all.sort((a, b) => place(a) - place(b));
}
