// Telling the user: notices, questions, the token dialog.

import { h } from "./dom.js";
import { Problem, setTokenDialog } from "./api.js";

const region = /** @type {HTMLElement} */ (document.getElementById("notices"));

/** A short message that goes away by itself. */
export function tell(text) {
  put("good", text, null, null, 6000);
}

/** A message with a button for what can still be done about it; it goes away by itself, or once the button is used. */
export function offer(text, label, act) {
  const notice = put("good", text, null, null, 20_000);
  notice.append(h("p", {}, h("button", { type: "button", onclick: () => {
    notice.remove();
    act();
  } }, label)));
}

/** Shows what went wrong and what can be done; stays until it is closed. Requests given up on are no problem. */
export function complain(problem) {
  if (problem?.name === "AbortError") return;
  // Said by the banner already, for as long as it lasts.
  if (problem instanceof Problem && problem.slug === "unreachable") return;
  if (!(problem instanceof Problem)) console.error(problem);
  put("bad", problem.title ?? "The page itself failed", problem.message, problem.remedy, 0);
}

/** As `complain`, also where the banner would say it. */
export function alarm(title, detail, remedy) {
  put("bad", title, detail, remedy, 0);
}

function put(tone, title, detail, remedy, ms) {
  const key = [tone, title, detail].join("\n");
  // The same thing twice would only push the page away.
  for (const old of region.querySelectorAll("div")) if (old.dataset.key === key) old.remove();
  const close = h("button", { type: "button", class: "quiet icon", "aria-label": "Close this message", onclick: () => notice.remove() }, "✕");
  const notice = h("div", { class: "notice", role: tone === "bad" ? "alert" : "status", "data-tone": tone, "data-key": key },
    h("p", {}, tone === "bad" ? h("strong", {}, title) : title), detail && h("p", {}, detail), remedy && h("p", { class: "soft" }, remedy), close);
  region.append(notice);
  while (region.children.length > 4) region.firstElementChild?.remove();
  if (ms) setTimeout(() => notice.remove(), ms);
  return notice;
}

/** A problem as part of a page. */
export function problemMessage(problem) {
  return h("div", { class: "message", role: "alert" }, h("strong", {}, problem.title ?? "Problem"), problem.message,
    problem.remedy && h("p", { class: "soft" }, problem.remedy));
}

/** Asks before something that cannot be undone. Resolves to whether to go on. */
export function confirmed(title, text, action) {
  return new Promise((resolve) => {
    const dialog = h("dialog", { "aria-label": title },
      h("form", { method: "dialog" }, h("h1", {}, title), h("p", {}, text),
        h("div", { class: "row" },
          h("button", { value: "yes", class: "danger" }, action),
          h("button", { value: "no", autofocus: true }, "Keep"))));
    open(dialog, () => resolve(dialog.returnValue === "yes"));
  });
}

/**
 * Opens a dialog over the page; `closed` is called at its end. Not modal as the browser means it: that would put STOP
 * out of reach. A veil covers the page below the header.
 * @param {HTMLDialogElement} dialog
 * @param {() => void} closed
 */
export function open(dialog, closed) {
  const before = /** @type {HTMLElement | null} */ (document.activeElement);
  const veil = h("div", { class: "veil" });
  dialog.addEventListener("keydown", (event) => event.key === "Escape" && dialog.close("no"));
  dialog.addEventListener("close", () => {
    veil.remove();
    dialog.remove();
    before?.focus();
    closed();
  });
  document.body.append(veil, dialog);
  dialog.show();
}

setTokenDialog((reason) => new Promise((resolve) => {
  const input = h("input", { id: "token", type: "password", autocomplete: "off", required: true });
  const dialog = h("dialog", { "aria-label": "Token" },
    h("form", { method: "dialog" }, h("h1", {}, "Token"),
      h("p", {}, reason, reason && " ", "This service can be reached from the network, so it asks for the token that ",
        h("code", {}, "nacre serve"), " printed when it started."),
      h("div", { class: "field" }, h("label", { for: "token" }, "Token"), input),
      h("div", { class: "row" }, h("button", { value: "yes", class: "primary" }, "Connect"),
        h("button", { value: "no", formnovalidate: true }, "Not now"))));
  open(dialog, () => resolve(dialog.returnValue === "yes" ? input.value.trim() || null : null));
}));
