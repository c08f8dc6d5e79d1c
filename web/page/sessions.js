// #/sessions: finding sessions again.

import { get, picture, query, show } from "./api.js";
import { field, firstOf, h, select, settle } from "./dom.js";
import { complain, problemMessage } from "./feedback.js";
import { bytes, fileName, moment, words } from "./format.js";
import { KINDS } from "./plan.js";
import { discard } from "./trash.js";

const PAGE = 20;
const TONES = { finished: "good", failed: "bad", idle: "warn", paused: "warn" };
// Kept while the page is open, so that the way back from a session leads to the same list.
const wanted = { text: "", kind: "", state: "" };

/**
 * Shows the list until the signal fires.
 * @param {HTMLElement} main
 * @param {Visit} visit
 */
export async function sessionsPage(main, { signal }) {
  /** @type {(string | null)[]} Where each page so far began. */
  let trail = [null];
  let asked = new AbortController();
  const text = h("input", { id: "search", type: "search", value: wanted.text, placeholder: "Name, sample, operator, notes", oninput: (e) => change("text", e.target.value) });
  const kind = select([["", "All"], ...KINDS.map(([key, label]) => [key, label])], wanted.kind, { id: "filter-kind", onchange: (e) => change("kind", e.target.value) });
  const state = select([["", "All"], ...["finished", "stopped", "unfinished"].map((s) => [s, s])], wanted.state, { id: "filter-state", onchange: (e) => change("state", e.target.value) });
  const list = h("ul", { class: "cards" });
  const said = h("p", { class: "soft", role: "status", "aria-live": "polite" });
  const back = h("button", { type: "button", onclick: () => { trail.pop(); load(); } }, "Newer");
  const on = h("button", { type: "button", onclick: () => { trail.push(next); load(); } }, "Older");
  let next = null;
  const pager = h("div", { class: "row pager" }, back, on);
  main.append(h("div", { class: "head" }, h("h1", { class: "grow" }, "Sessions"), h("a", { class: "button", href: "#/trash" }, "Trash"), h("a", { class: "button primary", href: "#/new" }, "New session")),
    h("div", { class: "panel filters fields", role: "search" }, field("Search", text), field("Kind", kind), field("State", state)),
    said, list, pager);

  // What each card shows, until it is seen.
  /** @type {Map<Element, Session>} */
  const unseen = new Map();
  const seen = new IntersectionObserver((entries) => {
    for (const { isIntersecting, target } of entries) {
      if (!isIntersecting) continue;
      seen.unobserve(target);
      const session = unseen.get(target);
      if (session) thumbnail(/** @type {HTMLImageElement} */ (target.querySelector("img")), session, signal);
      unseen.delete(target);
    }
  }, { rootMargin: "200px" });
  signal.addEventListener("abort", () => seen.disconnect());

  const later = settle(200, () => { trail = [null]; load(); });
  function change(key, value) {
    wanted[key] = value;
    later();
  }

  async function load() {
    asked.abort();
    asked = new AbortController();
    try {
      /** @type {{ items: Session[], next: string | null }} */
      const page = await get(`/sessions${query({ ...wanted, limit: PAGE, cursor: trail.at(-1) })}`, { signal: firstOf(signal, asked.signal) });
      next = page.next;
      unseen.clear();
      list.replaceChildren(...page.items.map(card));
      back.disabled = trail.length < 2;
      on.disabled = !next;
      pager.hidden = back.disabled && on.disabled;
      const filtered = wanted.text || wanted.kind || wanted.state;
      said.textContent = page.items.length ? "" : filtered ? "No session matches." : "No sessions yet. Start one under “New session”.";
      said.hidden = page.items.length > 0;
    } catch (problem) {
      if (problem.name === "AbortError") return;
      if (!list.children.length) throw problem;
      complain(problem);
    }
  }

  /** @param {Session} session */
  function card(session) {
    const title = session.name;
    const remove = h("button", { type: "button", class: "quiet icon", "aria-label": `Delete ${title}`, title: "Delete", onclick: () => discard(`/sessions/${session.id}`, session, load) }, "✕");
    const element = h("li", { class: "panel card", "data-session": session.id },
      h("div", { class: "well thumb" }, h("img", { alt: "", hidden: true })),
      h("div", { class: "about" },
        h("a", { class: "title", href: `#/session/${session.id}` }, title),
        h("p", { class: "soft" }, [session.sample !== title && session.sample, session.operator].filter(Boolean).join(" · ")),
        session.error && h("p", { class: "error" }, session.error),
        h("p", { class: "row soft" }, h("span", { class: "lamp", "data-tone": TONES[session.state] ?? "busy" }, session.state),
          h("span", {}, words(session.kind)), h("span", {}, moment(session.created)), h("span", {}, `${session.frames_committed} of ${session.frames_planned} frames`), h("span", {}, bytes(session.bytes)),
          session.has_results && h("a", { href: `#/result/${session.id}` }, "Result"))),
      remove);
    unseen.set(element, session);
    seen.observe(element);
    return element;
  }

  try {
    await load();
  } catch (problem) {
    list.replaceChildren(h("li", {}, problemMessage(problem)));
    throw problem;
  }
}

/**
 * The best picture there is: the map, the map so far, a photograph. None is no problem.
 * @param {HTMLImageElement} image
 * @param {Session} session
 * @param {AbortSignal} signal
 */
async function thumbnail(image, session, signal) {
  const width = 192;
  const frame = async () => {
    /** @type {{ items: Frame[] }} */
    const { items } = await get(`/sessions/${session.id}/frames`, { signal });
    const chosen = items.find((f) => f.role === "series") ?? items[0];
    return chosen && `/sessions/${session.id}/frames/${fileName(chosen.file).replace(/\.png$/, "")}.png?width=${width}`;
  };
  const sources = [
    session.has_results && `/reconstructions/${session.id}/maps/orientation.png?width=${width}`,
    !session.has_results && session.kind === "polarization" && `/sessions/${session.id}/live.png?map=orientation&width=${width}`,
    frame,
  ];
  for (const source of sources.filter(Boolean)) {
    try {
      const path = typeof source === "function" ? await source() : source;
      if (path) return show(image, (await picture(path, { signal })).blob);
    } catch (problem) {
      if (problem.name === "AbortError") return;
    }
  }
}
