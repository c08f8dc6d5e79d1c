// Manual control of camera, panel and flash; state of the interlocks.

import { post } from "./api.js";
import { field, h, number, panel, say, select } from "./dom.js";
import { complain } from "./feedback.js";
import { plain } from "./format.js";
import { accept } from "./service.js";

async function command(button, path, body) {
  button?.setAttribute("aria-busy", "true");
  try {
    accept(await post(path, body));
  } catch (problem) {
    complain(problem);
  }
  button?.removeAttribute("aria-busy");
}

/** What the device says goes into the field, unless someone is typing there. */
function follow(input, value) {
  if (document.activeElement !== input && input.dataset.dirty !== "true") input.value = value;
}

// A value typed but not sent yet must not be overwritten by the poll once the field loses focus.
function dirty(form, inputs) {
  for (const input of inputs) input.addEventListener("input", () => (input.dataset.dirty = "true"));
  form.addEventListener("submit", () => inputs.forEach((i) => delete i.dataset.dirty));
}

/** Exposure and gain. */
export function cameraPanel() {
  const exposure = number({ id: "exposure", required: true });
  // Exposure times span decades: the slider is logarithmic.
  const slider = h("input", { type: "range", min: 0, max: 1000, step: 1, "aria-label": "Exposure, logarithmic" });
  const gain = number({ id: "gain", required: true });
  const apply = h("button", { type: "submit" }, "Set");
  const about = h("small", { class: "soft" });
  const warnings = h("div", { class: "stack" });
  let range = [0.1, 1000];
  const place = (ms) => (1000 * Math.log(ms / range[0])) / Math.log(range[1] / range[0]);
  const send = () => command(apply, "/devices/camera/set", { exposure_ms: exposure.valueAsNumber, gain: gain.valueAsNumber });
  const form = h("form", { class: "stack", onsubmit: (event) => { event.preventDefault(); send(); } },
    h("div", { class: "fields" }, field("Exposure (ms)", exposure), field("Gain", gain), apply), slider, about, warnings);
  dirty(form, [exposure, gain]);
  slider.addEventListener("input", () => {
    exposure.value = String(Number((range[0] * (range[1] / range[0]) ** (slider.valueAsNumber / 1000)).toPrecision(3)));
    exposure.dataset.dirty = "true";
  });
  slider.addEventListener("change", () => form.requestSubmit());
  exposure.addEventListener("input", () => (slider.value = String(place(exposure.valueAsNumber))));
  return {
    element: panel("Camera", null, form),
    /** @param {Devices} devices */
    update({ camera }) {
      range = camera.exposure_range_ms;
      [exposure.min, exposure.max] = range.map(String);
      [gain.min, gain.max] = camera.gain_range.map(String);
      follow(exposure, Number(camera.exposure_ms.toPrecision(4)));
      follow(gain, camera.gain);
      if (document.activeElement !== slider && !exposure.dataset.dirty) slider.value = String(place(camera.exposure_ms));
      say(about, `${camera.id} · ${camera.width} × ${camera.height} · ${plain(range[0])} to ${plain(range[1])} ms`);
      warnings.replaceChildren(...camera.warnings.map((text) => h("p", { class: "message", "data-tone": "warn" }, text)));
    },
  };
}

/** The panel behind the sample. */
export function displayPanel() {
  const kind = select([["disc", "Disc"], ["black", "Black"]], "disc", { id: "pattern" });
  const diameter = number({ id: "disc-diameter", value: 100, min: 0 });
  const [x, y] = ["x", "y"].map((name) => number({ id: `disc-${name}`, value: 0 }));
  const disc = [field("Diameter (mm)", diameter), field("Middle, right (mm)", x), field("Middle, up (mm)", y)];
  const apply = h("button", { type: "submit" }, "Show");
  const shown = h("span", { class: "soft" });
  const about = h("small", { class: "soft" });
  const paint = () => disc.forEach((f) => (f.hidden = kind.value === "black"));
  const pattern = () => kind.value === "black" ? "black"
    : { disc: { center_mm: [x.valueAsNumber || 0, y.valueAsNumber || 0], diameter_mm: diameter.valueAsNumber } };
  const form = h("form", { class: "stack", onsubmit: (event) => {
    event.preventDefault();
    command(apply, "/devices/display/show", { pattern: pattern() });
  } }, h("div", { class: "fields" }, field("Pattern", kind), disc, apply), about);
  kind.addEventListener("change", paint);
  dirty(form, [kind, diameter, x, y]);
  return {
    element: panel("Panel", shown, form),
    /** @param {Devices} devices */
    update({ display }) {
      const lit = display.pattern === "black" ? undefined : display.pattern.disc;
      say(shown, lit ? `shows a disc of ${plain(lit.diameter_mm)} mm` : "is black");
      say(about, `${display.id} · ${plain(display.size_mm[0])} × ${plain(display.size_mm[1])} mm`);
      follow(kind, lit ? "disc" : "black");
      if (lit) {
        follow(diameter, lit.diameter_mm);
        follow(x, lit.center_mm[0]);
        follow(y, lit.center_mm[1]);
      }
      paint();
    },
  };
}

/** The flash, which goes off by itself. */
export function flashPanel() {
  /** @type {Devices["flash"]} */
  let flash = null;
  const seconds = number({ id: "flash-seconds", value: 1, min: 0.01 });
  const toggle = h("button", { type: "button", id: "flash", "aria-pressed": "false",
    onclick: () => command(toggle, "/devices/flash/switch", flash?.on ? { on: false } : { on: true, seconds: seconds.valueAsNumber || undefined }) }, "Flash on");
  const state = h("span", { class: "lamp", role: "status" });
  const about = h("small", { class: "soft" });
  const element = panel("Flash", state, h("div", { class: "row end" }, field("On for (s)", seconds), toggle), about);
  return {
    element,
    /** @param {Devices} devices */
    update(devices) {
      flash = devices.flash;
      element.hidden = !flash;
      if (!flash) return;
      seconds.max = String(flash.max_on_s);
      toggle.setAttribute("aria-pressed", String(flash.on));
      say(toggle, flash.on ? "Flash off" : "Flash on");
      say(state, flash.on ? "on" : "off");
      state.dataset.tone = flash.on ? "warn" : "quiet";
      say(about, `${flash.id} · goes off by itself, after ${plain(flash.max_on_s)} s at most`);
    },
  };
}

/** Door switches and the like. */
export function interlockPanel() {
  const list = h("ul", { class: "row" });
  const element = panel("Interlocks", null, list);
  return {
    element,
    /** @param {Devices} devices */
    update({ interlocks }) {
      element.hidden = interlocks.length === 0;
      const key = JSON.stringify(interlocks);
      if (list.dataset.key === key) return;
      list.dataset.key = key;
      list.replaceChildren(...interlocks.map((i) =>
        h("li", { class: "lamp", "data-tone": { true: "good", false: "bad" }[i.holds] ?? "busy" }, `${i.id} ${{ true: "holds", false: "is open" }[i.holds] ?? "is read by the session"}`)));
    },
  };
}
