// The panel of colours: palette, range with histogram, and layers over the map.

import { get } from "./api.js";
import { check, field, h, panel, select, say } from "./dom.js";
import { maskedKey, wheel } from "./legend.js";
import { contrast, usualEnds } from "./mapcontrast.js";
import { everyNth } from "./mapvalues.js";
import { palettesFor } from "./palettes.js";

/**
 * The panel. `changed()` is called when another picture is wanted.
 * @param {{ base: string, palette: string, maps: MapInfo[], changed: () => void, signal: AbortSignal }} options `palette` of directions
 */
export function colorsPanel({ base, palette, maps, changed, signal }) {
  /** @type {Map<string, Promise<MapStatistics>>} */
  const asked = new Map();
  /** @type {Map<string, number[]>} */
  const ends = new Map();
  /** @type {Map<string, string>} Palettes that were chosen, by kind of map. */
  const chosen = new Map([["direction", palette], ["mask", "grey"], ["number", "viridis"], ["s0", "grey"]]);
  let info = maps[0];
  let fadeEnd = 0;
  /** @type {import("./maplayer.js").DifferenceLayer | null} The difference that is shown in place of the map. */
  let difference = null;
  const kindOf = (/** @type {MapInfo} */ of) => (of.name === "s0" ? "s0" : of.kind);
  const rose = wheel();
  const valid = h("p", { class: "row" }, h("span", { class: "swatch white" }), "valid", h("span", { class: "swatch black" }), "masked");
  const box = contrast({ signal, changed: (low, high) => {
    if (difference) difference.look("blue_red", low, high);
    else ends.set(info.name, [low, high]);
    changed();
  } });
  const palettes = select([], "", { id: "palette", onchange: () => use(palettes.value) });
  const fade = check("Fade by σ", { id: "fade", onchange: () => changed() });
  const glyphs = check("Direction lines", { id: "glyphs", onchange: () => changed() });
  const hasDirections = maps.some((m) => m.kind === "direction");
  const note = h("p", { class: "soft", id: "range-note" });
  const legend = h("div", { class: "legend" }, rose, valid);
  const element = panel("Colours", null, h("div", { class: "stack" }, h("div", { class: "row end colors" }, field("Palette", palettes), fade, hasDirections && glyphs), h("div", { class: "legends" }, legend, box.element), h("div", { class: "row between" }, maskedKey(), note)));
  addEventListener("themechange", () => rose.refresh(), { signal });
  rose.dye(palette === "hsv" ? "hsv" : "cyclic");

  function use(/** @type {string} */ name) {
    chosen.set(kindOf(info), name);
    palettes.value = name;
    if (info.kind === "direction") rose.dye(name === "hsv" ? "hsv" : "cyclic");
    box.show(info, name, endsOf(), known.get(info.name) ?? null);
    changed();
  }
  /** @type {Map<string, MapStatistics>} */
  const known = new Map();
  const endsOf = () => ends.get(info.name) ?? [0, 1];

  /** Statistics of a whole map; asked for once. */
  async function statistics(/** @type {MapInfo} */ of) {
    const pending = asked.get(of.name) ?? get(`${base}/statistics/${encodeURIComponent(of.name)}?bins=160`, { signal });
    asked.set(of.name, pending);
    try {
      const found = await pending;
      known.set(of.name, found);
      if (!ends.has(of.name)) ends.set(of.name, usualEnds(of, found));
      return found;
    } catch (problem) {
      asked.delete(of.name);
      throw problem;
    }
  }

  return {
    element,
    get palette() { return chosen.get(kindOf(info)) ?? "viridis"; },
    get ends() { return endsOf(); },
    get fade() { return fade.box.checked && !fade.box.disabled; },
    get glyphs() { return glyphs.box.checked; },
    get fadeEnd() { return fadeEnd; },
    paletteOf: (/** @type {MapInfo} */ of) => chosen.get(kindOf(of)) ?? "viridis",
    knownEnds: (/** @type {MapInfo} */ of) => ends.get(of.name) ?? [0, 1],
    endsOf: statistics,
    mark: (/** @type {number | null} */ deg) => rose.mark(info.kind === "direction" ? deg : null),
    stretch: box.stretch,
    /** Shows a map; answers false if another one was wanted meanwhile. */
    async show(/** @type {MapInfo} */ next, /** @type {MapInfo | null} */ sigma) {
      info = next;
      difference = null;
      const name = chosen.get(kindOf(next)) ?? "viridis";
      palettes.replaceChildren(...palettesFor(next.kind === "direction").map(([value, title]) => h("option", { value }, title)));
      palettes.value = name;
      palettes.disabled = next.kind === "mask";
      rose.hidden = next.kind !== "direction";
      valid.hidden = next.kind !== "mask";
      legend.hidden = rose.hidden && valid.hidden;
      fade.box.disabled = sigma === null;
      rose.refresh();
      box.show(next, name, endsOf(), known.get(next.name) ?? null);
      const [found, spread] = await Promise.all([statistics(next), sigma ? statistics(sigma) : null]);
      if (info !== next) return false;
      fadeEnd = spread?.percentiles.find((p) => p.percent === 99)?.value ?? 0;
      say(note, found.step > 1 ? `Histogram of ${everyNth(found.step)}.` : "");
      box.show(next, name, endsOf(), found);
      return true;
    },
    /** Shows the colours of a difference in place of those of the map; null for the map again. */
    showDifference(/** @type {import("./maplayer.js").DifferenceLayer | null} */ layer) {
      if (layer === null && difference === null) return;
      difference = layer;
      palettes.disabled = layer !== null || info.kind === "mask";
      rose.hidden = layer !== null || info.kind !== "direction";
      legend.hidden = rose.hidden && valid.hidden;
      if (layer) box.show(layer.info, "blue_red", [layer.low, layer.high], null);
      else box.show(info, palettes.value, endsOf(), known.get(info.name) ?? null);
      rose.refresh();
    },
    nextPalette() {
      const names = palettesFor(info.kind === "direction").map(([name]) => name);
      if (!palettes.disabled) use(names[(names.indexOf(palettes.value) + 1) % names.length]);
    },
    toggleFade() {
      if (!fade.box.disabled) fade.box.click();
    },
    toggleGlyphs: () => glyphs.box.click(),
  };
}
