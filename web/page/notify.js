// A notification of the browser when a session or a job is done, once the user has asked for it.

import { get } from "./api.js";
import { h, pause, say } from "./dom.js";

const PERIOD_MS = 3000;
const ENDED = { finished: "finished", done: "done", failed: "failed", cancelled: "cancelled", set_aside: "set aside", idle: "stopped" };

/** Paths that are watched, wherever the user goes in the page. */
/** @type {Set<string>} */
const watched = new Set();

/** How it ended, or null while it goes on. A session goes on until its results are there, which are its last stage. */
function ending(/** @type {any} */ now) {
  return !now.method && now.stage ? null : (ENDED[now.state] ?? null);
}

async function watchUntilDone(path, hash) {
  while (watched.has(path)) {
    await pause(PERIOD_MS);
    // Without an answer the next one is waited for.
    const now = await get(path).catch((problem) => (problem.slug === "not-found" ? { state: "cancelled", stage: null, name: "Deleted" } : null));
    const how = now && ending(now);
    if (!how) continue;
    watched.delete(path);
    const shown = new Notification(`${now.name}: ${how}`, { body: now.error ?? "", tag: path, icon: "/assets/icon.svg" });
    shown.onclick = () => {
      window.focus();
      location.hash = hash;
    };
  }
}

/**
 * A button that asks for a notification; hidden where the browser has none, or has been told to show none.
 * @param {string} path of the session or job in the REST interface
 * @param {string} hash of its page
 */
export function notifyButton(path, hash) {
  const button = h("button", { type: "button", id: "notify", onclick: ask }, "");
  function paint() {
    button.hidden = !("Notification" in window) || Notification.permission === "denied";
    say(button, watched.has(path) ? "A notification will tell the end" : "Notify me when done");
    button.setAttribute("aria-pressed", String(watched.has(path)));
  }
  async function ask() {
    if (watched.delete(path)) return paint();
    if ((await Notification.requestPermission()) === "granted") {
      watched.add(path);
      watchUntilDone(path, hash);
    }
    paint();
  }
  paint();
  return button;
}
