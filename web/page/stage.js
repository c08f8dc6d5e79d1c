// Manual control of the analyser's stage.

import { post } from "./api.js";
import { field, h, number, panel, say } from "./dom.js";
import { complain } from "./feedback.js";
import { degrees, fixed, plain } from "./format.js";
import { accept } from "./service.js";
import { dial } from "./dial.js";

/** The panel, and how to bring it up to date. */
export function stagePanel() {
  /** @type {Devices["stage"] | null} */
  let stage = null;
  // Where the stage is to go after the move under way: quick presses of a jog button add up and need not wait.
  /** @type {number | null} */
  let target = null;
  let moving = false;

  async function go(path, body) {
    moving = true;
    paint();
    try {
      accept(await post(path, body));
    } catch (problem) {
      target = null;
      complain(problem);
    }
    moving = false;
    const next = target;
    target = null;
    paint();
    if (next !== null && next !== stage?.analyser_deg) move(next);
  }
  const move = (deg) => {
    if (moving) target = deg;
    else go("/devices/stage/move", { analyser_deg: deg });
    goal = deg;
    paint();
  };
  /** @type {number | null} */
  let goal = null;
  const jog = (by) => {
    const from = moving && goal !== null ? goal : stage?.analyser_deg;
    // Sums of steps shall stay round numbers.
    if (typeof from === "number") move(Math.round((from + by) * 1e6) / 1e6);
  };
  const button = (by) => h("button", {
    type: "button", id: `jog-${by < 0 ? "minus" : "plus"}-${Math.abs(by)}`, onclick: () => jog(by),
    "aria-label": `Turn the analyser by ${by}°`,
  }, `${by < 0 ? "−" : "+"}${Math.abs(by)}°`);
  const jogs = [-10, -1, 1, 10].map(button);
  const home = h("button", { type: "button", id: "home", onclick: () => { goal = null; target = null; go("/devices/stage/home", {}); } }, "Home");

  const now = h("output", { id: "analyser-deg" }, "–");
  const state = h("span", { class: "soft", role: "status", "aria-live": "polite" });
  const input = number({ id: "analyser-target", required: true });
  const picture = dial();
  const form = h("form", { class: "row end", onsubmit: (event) => { event.preventDefault(); move(input.valueAsNumber); } },
    field("Go to (°)", input), h("button", { type: "submit" }, "Go"));
  const about = h("small", { class: "soft" });

  function paint() {
    if (!stage) return;
    say(now, fixed(stage.analyser_deg, 2));
    picture.set(stage.analyser_deg);
    say(state, moving ? (stage.by_hand ? "turn it by hand" : `moving${goal === null ? " home" : ` to ${degrees(goal)}`}`) : stage.analyser_deg === null ? "not homed" : "at rest");
    const lost = stage.analyser_deg === null && goal === null;
    for (const b of jogs) b.disabled = lost;
    home.setAttribute("aria-busy", String(moving));
  }

  const element = panel("Analyser", state,
    h("div", { class: "stage" }, picture,
      h("div", { class: "stack" },
        h("p", { class: "readout" }, now, h("span", { class: "unit" }, "°")),
        h("div", { class: "jog", role: "group", "aria-label": "Jog" }, jogs),
        h("div", { class: "row end" }, form, home), about)));
  return {
    element,
    /** @param {Devices} devices */
    update(devices) {
      stage = devices.stage;
      const [low, high] = stage.limits_deg;
      input.min = String(low);
      input.max = String(high);
      say(about, `${stage.id} · ${plain(low)}° to ${plain(high)}°${stage.by_hand ? " · turned by hand" : ` · ${plain(stage.speed_deg_s)}°/s`}${stage.halts ? "" : " · STOP does not cut a movement short"}`);
      paint();
    },
  };
}
