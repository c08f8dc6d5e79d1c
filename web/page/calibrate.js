// #/calibrate: a camera and the sample's place from photographs of a board, step by step; #/calibrate/ID shows what came of it.

import { get, listen, makeDownload, post, send } from "./api.js";
import { boardSheet } from "./boardsheet.js";
import { verdict } from "./calibrated.js";
import { field, h, number, panel, save, say, select } from "./dom.js";
import { complain, problemMessage } from "./feedback.js";
import { bytes, fixed, percent, plain } from "./format.js";
import { picker } from "./picker.js";

// Photographs that the service needs, and from how many on a camera is known well.
const FEWEST = 3;
const ENOUGH = 8;
const CORNERS = ["top left corner of the sample", "top right corner", "bottom right corner", "bottom left corner"];

/** @type {HTMLElement | null} The steps while the page is open, so that a photograph can be left out without choosing the others again. */
let kept = null;

/**
 * Shows the steps until the signal fires.
 * @param {HTMLElement} main
 * @param {Visit} visit
 */
export async function calibratePage(main, { id, signal }) {
  main.append(h("div", { class: "head" }, h("h1", { class: "grow" }, "Calibrate the geometry"), id && h("a", { class: "button", href: "#/calibrate" }, "Calibrate anew")));
  if (id) return showOutcome(main, id, signal);
  main.append(h("p", { class: "soft lead" }, "Periods, and orientations under a flash, need to know where camera and sample are. Photographs of a chessboard tell it: lens, distance and tilt, each with its uncertainty. It takes about ten minutes, and holds until camera, focus or zoom are moved."));
  kept ??= wizard();
  main.append(kept);
}

/** All steps. */
function wizard() {
  const board = boardStep();
  const taken = photographStep();
  const place = placeStep(taken);
  const steps = [board, taken, place, computeStep(board, taken, place)];
  for (const step of steps) for (const what of ["change", "judge"]) step.element.addEventListener(what, paint);
  paint();
  return h("div", { class: "stack wizard" }, steps.map((step) => step.element));

  /** A step opens once those before it are done. */
  function paint() {
    let open = true;
    for (const step of steps) {
      const [met, text] = step.judge();
      step.body.hidden = !open;
      step.lamp.dataset.tone = !open ? "quiet" : met ? "good" : "warn";
      say(step.lamp, open ? text : "after the step before");
      open &&= met;
    }
  }
}

/**
 * A step: what to do, what is expected, and whether it was met.
 * @param {string} title
 * @param {string} expected
 * @param {() => [boolean, string]} judge
 * @param {...Child} parts
 */
function stepOf(title, expected, judge, ...parts) {
  const lamp = h("span", { class: "lamp", role: "status" });
  const body = h("div", { class: "stack" }, parts, h("p", { class: "soft" }, h("strong", {}, "Expected: "), expected));
  return { element: panel(title, lamp, body), body, lamp, judge };
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
  /** @type {{ file: File, url: string, size: string }[]} */
  let photographs = [];
  const input = h("input", { type: "file", id: "board-photographs", multiple: true, accept: ".png,.tif,.tiff,.jpg,.jpeg", onchange: () => add([...(input.files ?? [])]) });
  const list = h("ul", { class: "thumbs" });
  const step = stepOf("2. Photographs of it", `at least ${ENOUGH} photographs, all of one size and sharp, ${FEWEST} at the very least`, () => {
    const sizes = new Set(photographs.map((p) => p.size).filter(Boolean));
    if (photographs.length < FEWEST) return [false, `${photographs.length} of at least ${FEWEST}`];
    if (sizes.size > 1) return [false, `sizes differ: ${[...sizes].join(", ")} pixels`];
    return [true, photographs.length < ENOUGH ? `${photographs.length}: enough to try, ${ENOUGH} are better` : `${photographs.length} photographs`];
  },
  h("ol", { class: "todo" },
    h("li", {}, "Set focus, zoom and aperture as they are for measurements, and do not touch them any more."),
    h("li", {}, "Lay the board where the sample lies, and take one photograph. It tells where the sample is."),
    h("li", {}, "Take ten more: tilt the board by 20 to 40° to each side, forwards and backwards, turn it, and bring it to each corner of the picture. All of its squares must be in view."),
    h("li", {}, "Light it evenly: no reflections, nothing blurred.")),
  field("Photographs (PNG, TIFF, JPEG)", input), list);

  const changed = () => {
    list.replaceChildren(...photographs.map(({ file, url }) => h("li", {}, h("img", { src: url, alt: "" }), h("span", {}, file.name),
      h("button", { type: "button", class: "quiet icon", "aria-label": `Remove ${file.name}`, onclick: () => {
        URL.revokeObjectURL(url);
        photographs = photographs.filter((p) => p.url !== url);
        changed();
      } }, "✕"))));
    step.element.dispatchEvent(new Event("judge"));
  };
  /** @param {File[]} files */
  async function add(files) {
    const names = new Set(photographs.map((p) => p.file.name));
    const fresh = await Promise.all(files.filter((file) => !names.has(file.name)).map(async (file) => {
      // Browsers do not read every TIFF; the service does, and judges.
      const bitmap = await createImageBitmap(file).catch(() => null);
      const size = bitmap ? `${bitmap.width} × ${bitmap.height}` : "";
      bitmap?.close();
      return { file, url: URL.createObjectURL(file), size };
    }));
    photographs = [...photographs, ...fresh].sort((a, b) => a.file.name.localeCompare(b.file.name));
    input.value = "";
    changed();
  }
  return { ...step, files: () => photographs.map((p) => p.file) };
}

/** @param {{ element: HTMLElement, files: () => File[] }} taken */
function placeStep(taken) {
  const which = h("select", { id: "place-which" });
  const how = select([["board", "The board of one photograph lies in its place"], ["corners", "I pick its four corners in a photograph"]], "board", { id: "place-how" });
  const chosen = h("input", { type: "file", id: "place-photograph", accept: ".png,.jpg,.jpeg", onchange: () => corners.show(chosen.files?.[0] ?? null) });
  const [width, height] = ["width", "height"].map((name) => number({ id: `place-${name}`, value: "", min: 0 }));
  const corners = picker(CORNERS, () => step.element.dispatchEvent(new Event("judge")));
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
  const start = h("button", { type: "button", id: "calibrate-start", class: "primary", onclick: begin }, "Upload and calibrate");
  const progress = h("p", { class: "soft", role: "status" });
  const problems = h("div", { role: "status" });
  const step = stepOf("4. Calibrate", "corners off the model by at most half a pixel, and the focal length known to half a percent", () => [false, "ready"],
    field("Wavelength of the light (nm)", wavelength, { hint: "If it is known; it can be said later as well" }), h("div", {}, h("div", { class: "row" }, start, progress), problems));
  async function begin() {
    start.disabled = true;
    problems.replaceChildren();
    const files = taken.files();
    const first = place.first();
    const form = new FormData();
    form.append("kind", "photographs");
    // The service takes the first by name for the sample's place.
    for (const file of files) form.append("file", file, `${file.name === first ? "0-sample" : "1"}-${file.name}`);
    say(progress, `Uploading ${bytes(files.reduce((sum, file) => sum + file.size, 0))}…`);
    try {
      const upload = await (await send("/uploads", { method: "POST", body: form })).json();
      const options = { ...board.options(), ...place.options(), ...(wavelength.valueAsNumber > 0 ? { wavelength_nm: wavelength.valueAsNumber } : {}) };
      /** @type {Job} */
      const job = await post("/reconstructions", { session: null, upload: upload.id, method: "calibrate", options });
      // Whoever has gone elsewhere meanwhile finds it among the results.
      if (step.element.isConnected) location.hash = `#/calibrate/${job.id}`;
    } catch (problem) {
      problems.replaceChildren(problemMessage(problem));
    }
    start.disabled = false;
    say(progress, "");
  }
  return step;
}

/** What came of a calibration, or its progress. */
async function showOutcome(main, id, signal) {
  const holder = h("div", { class: "stack wizard" });
  main.append(holder);
  const path = `/reconstructions/${id}`;
  /** @param {Job} job */
  const paint = (job) => {
    const open = job.state === "queued" || job.state === "running";
    if (open) return holder.replaceChildren(panel("Calibrating", null, h("div", { class: "stack" }, h("p", { role: "status" }, `${job.stage ?? "Waiting for its turn"} (${percent(job.progress, 0)})`), h("progress", { max: 1, value: job.progress, "aria-label": "Progress" }))));
    if (job.state !== "done") {
      return holder.replaceChildren(panel("No calibration", null, h("div", { class: "stack" },
        h("p", { class: "message", role: "alert" }, job.error ?? "It was cancelled."),
        h("h3", {}, "What to do"), h("ol", { class: "todo" },
          h("li", {}, "Count the inner corners again: one less than squares, along the longer side first."),
          h("li", {}, "See that every photograph shows all of the board, sharp and without reflections, and a white margin around it."),
          h("li", {}, "Take more photographs, tilted differently, and calibrate anew.")))));
    }
    const download = h("a", { class: "button primary", id: "geometry" }, "Download geometry.json");
    makeDownload(download, `${path}/files/geometry.json`, "geometry.json", complain);
    holder.replaceChildren(
      panel("What came of it", null, verdict(job.report)),
      panel("What to do with it", null, h("div", { class: "stack" },
        h("ol", { class: "todo" }, h("li", {}, "Keep geometry.json. Uploads of tiles and foils, and the options of their results, take it as “Calibration”."),
          h("li", {}, "Calibrate anew when camera, focus, zoom or the sample's holder have been moved.")),
        h("div", { class: "row" }, download, h("a", { class: "button", href: `#/result/${id}` }, "All numbers and pictures")))));
  };
  /** @type {Job} */
  const job = await get(path, { signal });
  if (signal.aborted) return;
  paint(job);
  if (job.state !== "queued" && job.state !== "running") return;
  listen(`${path}/events`, { event: async (name, now) => {
    if (name !== "state" || signal.aborted) return;
    // Events leave the report out.
    paint(now.state === "done" && !now.report ? await get(path, { signal }) : now);
  } }, { signal, rest: true });
}
