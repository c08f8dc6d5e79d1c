// #/bench: ways to begin, what the devices are doing, the live picture, and manual control.

import { h, panel } from "./dom.js";
import { doors } from "./doors.js";
import { lightingPanel } from "./lighting.js";
import { takeRegion } from "./new.js";
import { region, regionTool } from "./region.js";
import { watch } from "./service.js";
import { previewPanel } from "./preview.js";
import { cameraPanel, displayPanel, flashPanel, interlockPanel } from "./controls.js";
import { stagePanel } from "./stage.js";

/**
 * Shows the bench until the signal fires.
 * @param {HTMLElement} main
 * @param {Visit} visit
 */
export async function benchPage(main, { signal }) {
  const busy = h("p", { class: "message", "data-tone": "busy", hidden: true });
  const parts = [stagePanel(), cameraPanel(), displayPanel(), flashPanel(), interlockPanel()];
  const controls = h("fieldset", { class: "stack controls" }, h("legend", { class: "sr" }, "Manual control"), busy, parts.map((p) => p.element));
  const unseen = h("p", { class: "soft" }, "Waiting for the service…");
  const waiting = panel("Devices", null, unseen);
  const lighting = lightingPanel();
  const drawing = regionTool(() => {
    takeRegion(region());
    location.hash = "#/new";
  });
  const ways = await doors(signal);
  if (signal.aborted) return;
  main.append(ways, h("div", { class: "head" }, h("h1", { class: "grow" }, "Bench"), h("a", { class: "button", href: "#/calibrate" }, "Calibrate"), h("a", { class: "button primary", href: "#/new" }, "New session")),
    h("div", { class: "columns bench" }, previewPanel(signal, lighting, drawing), h("div", { class: "stack" }, waiting, controls)));

  watch(({ devices, problem, reachable }) => {
    waiting.hidden = devices !== null && !problem;
    controls.hidden = devices === null;
    if (problem) unseen.textContent = [problem.message, problem.remedy].filter(Boolean).join(" ");
    if (!devices) return;
    const session = devices.activity === "session";
    controls.disabled = session || reachable === false;
    busy.hidden = !session;
    if (session) {
      busy.replaceChildren("A session has the bench; manual control waits for its end. ",
        devices.session ? h("a", { href: `#/session/${devices.session}` }, "Watch it") : "");
    }
    for (const part of [lighting, ...parts]) part.update(devices);
  }, signal);
}
