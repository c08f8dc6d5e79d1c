// Light and exposure of the live picture. On a real bench light is switched on by the user only; a simulated bench is lit when its page opens.

import { post } from "./api.js";
import { h, say } from "./dom.js";
import { complain } from "./feedback.js";
import { accept } from "./service.js";

/** Diameter of the disc in mm, as in a new plan. */
const DISC_MM = 180;

/** After STOP, light stays off until the user asks for it, also when the page is loaded anew. */
const STOPPED = "nacre-stopped";
let stopped = false;
try {
  stopped = sessionStorage.getItem(STOPPED) === "true";
} catch {
  // Without storage, STOP is remembered until the page is loaded anew.
}
function remember(/** @type {boolean} */ now) {
  stopped = now;
  try {
    sessionStorage.setItem(STOPPED, String(now));
  } catch {
    // As above.
  }
}
addEventListener("nacre-stop", () => remember(true));

/** @param {Devices} devices */
async function light({ display }) {
  const disc = { center_mm: [0, 0], diameter_mm: Math.min(DISC_MM, ...display.size_mm) };
  accept(await post("/devices/display/show", { pattern: { disc } }));
  accept(await post("/devices/camera/meter"));
}

const isDark = (/** @type {Devices} */ { display, flash }) => display.pattern === "black" && !flash?.on;

/** Buttons for light and exposure, and a note while all is dark. */
export function lightingPanel() {
  /** @type {Devices | null} */
  let devices = null;
  let asked = false;
  let working = false;
  const toggle = h("button", { type: "button", id: "light", onclick: () => run(() => (devices && isDark(devices) ? ask() : dark())) }, "Light the sample");
  const meter = h("button", { type: "button", id: "auto-exposure", title: "Measure the light and set the exposure so that nothing is saturated",
    onclick: () => run(async () => accept(await post("/devices/camera/meter"))) }, "Auto exposure");
  const note = h("p", { class: "dark-note", hidden: true }, "All light is off.");

  async function ask() {
    remember(false);
    if (devices) await light(devices);
  }
  const dark = async () => accept(await post("/devices/display/show", { pattern: "black" }));

  async function run(/** @type {() => Promise<unknown>} */ work, quiet = false) {
    working = true;
    paint();
    try {
      await work();
    } catch (problem) {
      // A bench that is in use, or may only be looked at, is no problem of someone who did not ask for light.
      if (!quiet || !["busy", "forbidden", "conflict"].includes(problem.slug)) complain(problem);
    }
    working = false;
    paint();
  }

  function paint() {
    if (!devices) return;
    const isOff = isDark(devices);
    say(toggle, isOff ? "Light the sample" : "Light off");
    toggle.classList.toggle("primary", isOff && !working);
    toggle.disabled = meter.disabled = working || devices.activity !== "idle";
    meter.disabled ||= isOff;
    note.hidden = !isOff || working || devices.activity !== "idle";
  }

  return {
    element: h("div", { class: "row lighting" }, toggle, meter),
    note,
    /** @param {Devices} now */
    update(now) {
      devices = now;
      paint();
      if (asked || stopped || !now.simulated || now.activity !== "idle") return;
      asked = true;
      if (isDark(now)) run(() => light(now), true);
    },
  };
}
