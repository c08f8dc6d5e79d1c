// What to do about a session that an error has ended: which device, what it was asked, what came, the remedy as steps, and buttons for what helps.

import { get, post } from "./api.js";
import { facts, h } from "./dom.js";
import { complain, tell } from "./feedback.js";
import { accept, refresh, service } from "./service.js";

/** What the kind of an error means, and the last thing to do about it. */
const CLASSES = {
  retry: ["What it did may pass.", "Resume the session: the same command is given again."],
  lost: ["The link to it is gone.", "Resume the session once the device answers again; what is missing is then taken."],
  stop: ["Someone has to look at it before anything goes on.", "Resume the session once it is in order; what is missing is then taken."],
  setup: ["It cannot do this at all: the plan or the configuration asks for too much.", "Change the configuration and start the service anew, or repeat the session with another plan."],
};

const sentence = (/** @type {string} */ text) => `${text[0].toUpperCase()}${text.slice(1)}.`;
// A comma ends a step where one of these begins the next.
const VERBS = "check|close|home|let|look|resume|search|see|set|switch|try|unlock|unplug";

/**
 * A remedy as what is the matter, if it says so, and steps: what comes after “then” or a semicolon is one of its own.
 * @param {string} remedy
 * @returns {{ cause: string, todo: string[] }}
 */
export function steps(remedy) {
  const [, cause = "", rest] = /^(?:([^:;]+):\s+)?(.*)$/s.exec(remedy) ?? [];
  const parts = (rest ?? "").split(new RegExp(`;\\s+|,?\\s+then\\s+|\\.\\s+|,\\s+(?=(?:${VERBS})\\b)`)).map((text) => text.trim().replace(/\.$/, "")).filter(Boolean);
  // The last step says how to go on, in more words.
  const asked = parts.filter((text) => !/^(resume( the session)?|try again)$/i.test(text));
  return { cause: cause && sentence(cause), todo: asked.map(sentence) };
}

/**
 * Each device with what is wrong with it, if anything. The service keeps what it knows of them, so that they have to be given commands.
 * @param {Devices} devices
 */
async function asked({ stage, camera, display, flash, interlocks }) {
  /** @type {[string, () => Promise<unknown>][]} */
  const commands = [
    [camera.id, () => get("/devices/camera/preview")],
    [display.id, () => post("/devices/display/show", { pattern: "black" })],
  ];
  // One that is turned by hand would ask for a hand.
  if (!stage.by_hand && stage.analyser_deg !== null) commands.push([stage.id, () => post("/devices/stage/move", { analyser_deg: stage.analyser_deg })]);
  if (flash) commands.push([flash.id, () => post("/devices/flash/switch", { on: false })]);
  /** @type {[string, string][]} */
  const found = [];
  for (const [name, command] of commands) {
    found.push([name, await command().then(() => "", (problem) => [problem.message, problem.remedy].filter(Boolean).join("; "))]);
  }
  if (!stage.by_hand && stage.analyser_deg === null) found.push([stage.id, "its angle is not known: home it"]);
  for (const { id, holds } of interlocks) found.push([id, holds === null ? "no answer" : holds ? "" : "is open"]);
  return found;
}

/**
 * The error of a session. Returns the element, and how to bring it up to date with the session.
 * @param {() => void} resume
 */
export function remedies(resume) {
  const element = h("section", { class: "remedy message", role: "alert", "aria-label": "What went wrong and what to do", hidden: true });
  const said = h("div", { role: "status" });
  let shown = "";

  async function act(button, call) {
    button.setAttribute("aria-busy", "true");
    try {
      await call();
    } catch (problem) {
      said.textContent = "";
      complain(problem);
    }
    button.removeAttribute("aria-busy");
  }
  // Nobody knows where the stage is until it has found its zero.
  const lost = () => service.devices?.stage.analyser_deg === null && !service.devices.stage.by_hand;
  const action = (id, label, hint, call) => {
    const button = h("button", { type: "button", id, title: hint, onclick: () => act(button, call) }, label);
    return button;
  };
  const again = h("button", { type: "button", id: "remedy-resume", class: "primary", onclick: resume }, "Resume");
  const home = action("remedy-home", "Home the stage", "Finds the stage's zero anew", async () => {
    said.textContent = "Homing…";
    accept(await post("/devices/stage/home"));
    said.textContent = "The stage is at its zero.";
  });
  const check = action("remedy-check", "Check devices again", "Asks each device for something harmless: nothing turns, all light stays off", async () => {
    said.textContent = "Asking…";
    await refresh();
    const found = service.devices ? await asked(service.devices) : [];
    home.hidden &&= !lost();
    said.replaceChildren(h("ul", { class: "stack" }, found.map(([name, wrong]) => h("li", { class: "lamp", "data-tone": wrong ? "bad" : "good" }, wrong ? `${name}: ${wrong}` : `${name} answers`))));
  });
  const dark = action("remedy-dark", "Switch all light off", "Also stops whatever moves", async () => {
    await post("/stop");
    tell("All light is off.");
    refresh();
  });

  /** @param {Session} session */
  function update({ state, error, fault }) {
    const ended = Boolean(error) && !["running", "resuming", "finished"].includes(state);
    element.hidden = !ended;
    const key = ended ? JSON.stringify([error, fault]) : "";
    again.disabled = fault?.class === "setup" || !["idle", "failed"].includes(state);
    if (!error || key === shown) return;
    shown = key;
    said.textContent = "";
    const [means, last] = CLASSES[fault?.class ?? "stop"];
    const [title, ...rest] = error.split("; ");
    const { cause, todo } = steps(fault ? fault.remedy : rest.join("; "));
    const step = fault ? error.slice(0, Math.max(0, error.indexOf(`: ${fault.device}`))) : "";
    // Where the stage is at fault, or the remedy speaks of its zero.
    const moves = fault && (fault.device === service.devices?.stage.id || /\bhome\b/i.test(`${fault.command} ${fault.remedy}`) || /turn|move/.test(fault.command));
    element.replaceChildren(
      h("h3", {}, fault ? `${fault.device} did not do what it was asked to` : "The session ended early"),
      fault ? facts([["While", step], ["Device", fault.device], ["Asked to", fault.command], ["Expected", fault.expected], ["Got", fault.got]]) : h("p", {}, title),
      h("p", {}, [cause, fault && means].filter(Boolean).join(" ")),
      h("h3", {}, "What to do"),
      h("ol", { class: "todo" }, [...todo, last].map((text) => h("li", {}, text))),
      h("div", { class: "row" }, again, home, check, dark), said);
    home.hidden = !moves && !lost();
  }
  return { element, update };
}
