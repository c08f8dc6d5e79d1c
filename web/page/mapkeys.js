// The keys of the map viewer, as a list.

import { h } from "./dom.js";
import { open } from "./feedback.js";

/** Keys while the map has the focus. */
const KEYS = [
  ["Arrows", "move the map"],
  ["Shift + arrows", "go from pixel to pixel"],
  ["+ and −", "zoom in and out"],
  ["0", "show the whole map"],
  ["Enter", "choose the pixel in the middle"],
  ["1 to 9", "show the map of that number"],
  ["V", "move the map by dragging"],
  ["L", "profile along a line"],
  ["R", "statistics of a rectangle"],
  ["G", "statistics of a polygon"],
  ["Tab, then arrows", "move a corner; with Shift by 10 pixels, Delete removes it"],
  ["Escape", "remove the line or region"],
  ["P", "next palette"],
  ["[ and ]", "narrower and wider range of colours"],
  ["O", "lines along the directions, on and off"],
  ["F", "fade by σ, on and off"],
  ["B", "change between the two compared maps"],
  ["?", "this list"],
];

let shown = false;

/** Opens the list. */
export function showKeys() {
  if (shown) return;
  shown = true;
  const close = h("button", { class: "primary", value: "yes" }, "Close");
  const dialog = h("dialog", { "aria-label": "Keys of the map", class: "keys" },
    h("form", { method: "dialog" }, h("h2", {}, "Keys of the map"),
      h("dl", { class: "facts" }, KEYS.map(([key, use]) => [h("dt", {}, h("kbd", {}, key)), h("dd", {}, use)])),
      h("div", { class: "row" }, close)));
  open(dialog, () => { shown = false; });
  close.focus();
}
