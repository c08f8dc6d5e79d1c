// #/calibrate: what a bench's numbers come from, step by step: a camera and the sample's place from photographs of a board, here; light and
// wavelength (#/calibrate/light) and the panel (#/calibrate/panel). #/calibrate/ID shows what came of photographs.

import { boardSheet } from "./boardsheet.js";
import { lightWizard } from "./calibratelight.js";
import { panelWizard } from "./calibratepanel.js";
import { field, h, number, save, say, select } from "./dom.js";
import { fixed, percent, plain } from "./format.js";
import { outcome } from "./outcome.js";
import { picker } from "./picker.js";
import { guided, photographs, startOf, stepOf } from "./wizard.js";

// Photographs that the service needs, and from how many on a camera is known well.
const FEWEST = 3;
const ENOUGH = 8;
const CORNERS = ["top left corner of the sample", "top right corner", "bottom right corner", "bottom left corner"];

/** @type {[string, string, string, () => HTMLElement][]} The calibrations there are: what follows #/calibrate/, names, what they are for, steps. */
const KINDS = [
  ["", "Camera and sample", "Periods, and orientations under a flash, need to know where camera and sample are. Photographs of a chessboard tell it: lens, distance and tilt, each with its uncertainty. It takes about ten minutes, and holds until camera, focus or zoom are moved.", wizard],
  ["light", "Light and wavelength", "Periods under a flash need to know where the light is, and its wavelength. Photographs of the light in a mirror tell the one, a filter’s data sheet the other. It takes about five minutes, and holds until the light or its filter are changed.", lightWizard],
  ["panel", "Panel", "Fringes, and light of a wanted strength, need to know how bright the panel is at each level, and when a new picture is really there. The camera measures both by itself. It takes a minute or two, and holds until brightness, picture mode or the panel are changed.", panelWizard],
];

/** @type {Map<string, HTMLElement>} The steps while the page is open, so that a photograph can be left out without choosing the others again. */
const kept = new Map();

/**
 * Shows the steps until the signal fires.
 * @param {HTMLElement} main
 * @param {Visit} visit
 */
export async function calibratePage(main, { id, signal }) {
  const known = KINDS.find(([key]) => key === id);
  const links = KINDS.map(([key, name]) => h("a", { href: `#/calibrate${key && "/"}${key}`, "aria-current": key === id && "page" }, name));
  main.append(h("div", { class: "head" }, h("h1", { class: "grow" }, "Calibrate"), h("nav", { class: "kinds", "aria-label": "Calibrations" }, links)));
  if (!known) return outcome(main, id, signal);
  const [key, , lead, make] = known;
  main.append(h("p", { class: "soft lead" }, lead));
  const steps = kept.get(key) ?? make();
  kept.set(key, steps);
  main.append(steps);
  steps.dispatchEvent(new CustomEvent("shown", { detail: signal }));
}

/** All steps. */
function wizard() {
  const board = boardStep();
  const taken = photographStep();
  const place = placeStep(taken);
  return guided([board, taken, place, computeStep(board, taken, place)]);
}

const whole = (/** @type {HTMLInputElement} */ input, least, most) => Number.isInteger(input.valueAsNumber) && input.valueAsNumber >= least && input.valueAsNumber <= most;

function boardStep() {
  const across = number({ id: "board-across", value: 9, min: 2, max: 64, step: 1 });
  const down = number({ id: "board-down", value: 6, min: 2, max: 64, step: 1 });
  const nominal = number({ id: "board-nominal", value: 25, min: 1 });
  const measured = number({ id: "board-measured", value: "", min: 0 });
  const row = () => (across.valueAsNumber + 1) * nominal.valueAsNumber;
  const told = h("p", { class: "soft" });
  const made = h("button", { type: "button", id: "board-make", onclick: () => {
    const { text } = boardSheet(across.valueAsNumber, down.valueAsNumber, nominal.valueAsNumber);
    save(new Blob([text], { type: "image/svg+xml" }), `board-${across.value}x${down.value}-${plain(nominal.valueAsNumber)}mm.svg`);
  } }, "Download the board");
  const step = stepOf("1. A board", "a flat board whose measured row is within 3 % of what was printed, with an odd and an even number of corners, so that it has a top", () => {
    const sound = whole(across, 2, 64) && whole(down, 2, 64) && nominal.valueAsNumber > 0;
    made.disabled = !sound;
    if (!sound) return [false, "numbers are missing"];
    const { size } = boardSheet(across.valueAsNumber, down.valueAsNumber, nominal.valueAsNumber);
    say(told, `The sheet is ${fixed(size[0], 0)} × ${fixed(size[1], 0)} mm, a row of ${across.valueAsNumber + 1} squares ${plain(row())} mm.`);
    if (across.valueAsNumber % 2 === down.valueAsNumber % 2) return [false, "one of the two numbers must be odd, the other even"];
    if (!(measured.valueAsNumber > 0)) return [false, "the row is not measured yet"];
    const off = measured.valueAsNumber / row() - 1;
    return Math.abs(off) < 0.03 ? [true, `a square is ${fixed(square(), 3)} mm`] : [false, `the row is off by ${percent(Math.abs(off), 0)}: is the number right?`];
  },
  h("ol", { class: "todo" },
    h("li", {}, "Print the board at 100 %, without fitting it to the page. A board that you have will do: say its numbers."),
    h("li", {}, "Glue it to something flat and stiff, such as glass or aluminium. Paper that bends spoils the calibration."),
    h("li", {}, "Measure a whole row of squares from edge to edge: printers are off by a percent, which would be a percent of every period.")),
  h("div", { class: "fields" }, field("Inner corners across", across, { hint: "One less than squares" }), field("Inner corners down", down, { hint: "Likewise" }), field("Side of a square (mm)", nominal, { hint: "As printed" }),
    field("A row of squares as measured (mm)", measured, { hint: "From the left edge to the right" })),
  h("div", { class: "row" }, made, told));
  const square = () => measured.valueAsNumber / (across.valueAsNumber + 1);
  step.element.addEventListener("input", () => step.element.dispatchEvent(new Event("judge")));
  return { ...step, options: () => ({ board: [across.valueAsNumber, down.valueAsNumber], square_mm: Number(square().toPrecision(6)) }) };
}

function photographStep() {
  const taken = photographs("board-photographs");
  const step = stepOf("2. Photographs of it", `at least ${ENOUGH} photographs, all of one size and sharp, ${FEWEST} at the very least`, () => {
    const [count, unlike] = [taken.files().length, taken.unlike()];
    if (count < FEWEST) return [false, `${count} of at least ${FEWEST}`];
    if (unlike) return [false, unlike];
    return [true, count < ENOUGH ? `${count}: enough to try, ${ENOUGH} are better` : `${count} photographs`];
  },
  h("ol", { class: "todo" },
    h("li", {}, "Set focus, zoom and aperture as they are for measurements, and do not touch them any more."),
    h("li", {}, "Lay the board where the sample lies, and take one photograph. It tells where the sample is."),
    h("li", {}, "Take ten more: tilt the board by 20 to 40° to each side, forwards and backwards, turn it, and bring it to each corner of the picture. All of its squares must be in view."),
    h("li", {}, "Light it evenly: no reflections, nothing blurred.")),
  taken.element);
  taken.element.addEventListener("photographs", () => step.element.dispatchEvent(new Event("judge")));
  return { ...step, files: taken.files };
}

/** @param {{ element: HTMLElement, files: () => File[] }} taken */
function placeStep(taken) {
  const which = h("select", { id: "place-which" });
  const how = select([["board", "The board of one photograph lies in its place"], ["corners", "I pick its four corners in a photograph"]], "board", { id: "place-how" });
  const chosen = h("input", { type: "file", id: "place-photograph", accept: ".png,.jpg,.jpeg", onchange: () => corners.show(chosen.files?.[0] ?? null) });
  const [width, height] = ["width", "height"].map((name) => number({ id: `place-${name}`, value: "", min: 0 }));
  const corners = picker("place-corner", CORNERS, { changed: () => step.element.dispatchEvent(new Event("judge")) });
  const byBoard = field("Photograph of the board in the sample's place", which);
  const byCorners = h("div", { class: "stack" },
    h("div", { class: "fields" }, field("Photograph of the sample, camera unmoved", chosen), field("Sample, width (mm)", width), field("Sample, height (mm)", height)), corners.element);
  const step = stepOf("3. Where the sample lies", "the plane of the sample, seen by the camera as it stands for measurements", () => {
    byBoard.hidden = how.value !== "board";
    byCorners.hidden = how.value !== "corners";
    if (how.value === "board") return [Boolean(which.value), which.value ? `as the board in ${which.value}` : "no photograph is chosen"];
    if (corners.points().length < 4) return [false, `${corners.points().length} of 4 corners are picked`];
    return width.valueAsNumber > 0 && height.valueAsNumber > 0 ? [true, "four corners"] : [false, "its size is missing"];
  }, h("ol", { class: "todo" },
    h("li", {}, "Say which photograph shows the board where the sample lies; or take one of the sample and pick its corners."),
    h("li", {}, "Do not move the camera from now on.")),
  field("How its place is known", how), byBoard, byCorners);
  const list = () => {
    const names = taken.files().map((file) => file.name);
    const kept = which.value;
    which.replaceChildren(...names.map((name) => h("option", { value: name, selected: name === kept }, name)));
  };
  taken.element.addEventListener("judge", list);
  return {
    ...step,
    /** Which photograph has to be the first. */
    first: () => (how.value === "board" ? which.value : null),
    options: () => (how.value === "board" ? {} : { sample_corners_px: corners.points(), sample_mm: [width.valueAsNumber, height.valueAsNumber] }),
  };
}

/**
 * @param {{ options: () => object }} board
 * @param {{ files: () => File[] }} taken
 * @param {{ options: () => object, first: () => string | null }} place
 */
function computeStep(board, taken, place) {
  const wavelength = number({ id: "calibrate-wavelength", value: "", min: 200, max: 2000 });
  const start = startOf("calibrate-start", () => {
    const first = place.first();
    return {
      // The service takes the first by name for the sample's place.
      files: taken.files().map((file) => ({ file, name: `${file.name === first ? "0-sample" : "1"}-${file.name}` })),
      options: { ...board.options(), ...place.options(), ...(wavelength.valueAsNumber > 0 ? { wavelength_nm: wavelength.valueAsNumber } : {}) },
    };
  });
  return stepOf("4. Calibrate", "corners off the model by at most half a pixel, and the focal length known to half a percent", () => [false, "ready"],
    field("Wavelength of the light (nm)", wavelength, { hint: "If it is known; it can be said later as well" }), start);
}
