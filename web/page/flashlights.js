// Positions of the flash, photograph by photograph, for uploads without a frames.json.

import { h, number } from "./dom.js";

const AXES = [["x", "right of the sheet's middle"], ["y", "above the middle in the picture"], ["z", "height above the sheet"]];

/** Whether the name of a photograph says that it was taken by room light. */
export const byRoomLight = (/** @type {string} */ name) => /room|ambient|day/i.test(name);

/**
 * A table of the photographs with the position of the flash in mm. Photographs without a position have one that follows from the highlight.
 * @param {() => void} changed
 */
export function flashLights(changed) {
  /** @type {Map<string, { room: boolean, at: (number | null)[] }>} */
  const known = new Map();
  const body = h("tbody");
  const element = h("div", { class: "scroll" }, h("table", {},
    h("thead", {}, h("tr", {}, ["Photograph", "Light", "x (mm)", "y (mm)", "z (mm)"].map((text) => h("th", { scope: "col" }, text)))), body));
  return {
    element,
    /** @param {string[]} names */
    show(names) {
      body.replaceChildren(...names.map((name) => {
        const light = known.get(name) ?? { room: byRoomLight(name), at: [null, null, null] };
        known.set(name, light);
        const inputs = AXES.map(([axis, about], k) => number({ "aria-label": `Flash of ${name}, ${axis} in mm, ${about}`, title: about, value: light.at[k] ?? "", disabled: light.room, oninput: (e) => {
          light.at[k] = Number.isFinite(e.target.valueAsNumber) ? e.target.valueAsNumber : null;
          changed();
        } }));
        const which = h("select", { "aria-label": `Light of ${name}`, onchange: () => {
          light.room = which.value === "room";
          for (const input of inputs) input.disabled = light.room;
          changed();
        } }, h("option", { value: "flash", selected: !light.room }, "Flash"), h("option", { value: "room", selected: light.room }, "Room light"));
        return h("tr", {}, h("td", {}, name), h("td", {}, which), inputs.map((input) => h("td", { class: "number" }, input)));
      }));
    },
    /** Whether every flash has a position. */
    complete: (/** @type {string[]} */ names) => names.every((name) => known.get(name)?.room || known.get(name)?.at.every((v) => v !== null)),
    /** Frames of a description. */
    frames: (/** @type {string[]} */ names) => names.map((file) => {
      const light = known.get(file);
      if (light?.room) return { file, flash: false };
      return { file, flash: true, ...(light?.at.every((v) => v !== null) && { light_mm: light.at }) };
    }),
  };
}
