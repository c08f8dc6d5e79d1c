// #/results: reconstructions and renderings, found again by what they were made of.

import { get, picture, query, send, show } from "./api.js";
import { field, h, select } from "./dom.js";
import { complain, confirmed, tell } from "./feedback.js";
import { namesOf, titled, VIEWED } from "./finding.js";
import { bytes, moment, words } from "./format.js";

// Most that are looked through.
const MOST = 500;
const TONES = { done: "good", failed: "bad", set_aside: "bad", cancelled: "warn" };
const ENDED = Object.keys(TONES);
// Kept while the page is open, so that the way back from a result leads to the same list.
const wanted = { text: "", method: "", state: "" };

/**
 * Shows the list until the signal fires.
 * @param {HTMLElement} main
 * @param {Visit} visit
 */
export async function resultsPage(main, { signal }) {
  const [sessions, jobs, uploads] = await Promise.all([get(`/sessions${query({ limit: 200 })}`, { signal }), get(`/reconstructions${query({ limit: MOST })}`, { signal }), get("/uploads", { signal })]);
  const names = namesOf(sessions.items);
  let items = jobs.items;
  const methods = [...new Set(items.map((job) => job.method))].sort();
  const change = (key) => (e) => {
    wanted[key] = e.target.value;
    paint();
  };
  const text = h("input", { id: "search", type: "search", value: wanted.text, placeholder: "Session, method, id, error", oninput: change("text") });
  const method = select([["", "All"], ...methods.map((m) => [m, words(m)])], wanted.method, { id: "filter-method", onchange: change("method") });
  const state = select([["", "All"], ...["queued", "running", ...ENDED].map((s) => [s, words(s)])], wanted.state, { id: "filter-state", onchange: change("state") });
  const said = h("p", { class: "soft", role: "status", "aria-live": "polite" });
  const list = h("ul", { class: "cards" });
  main.append(h("div", { class: "head" }, h("h1", { class: "grow" }, "Results"), h("a", { class: "button", href: "#/upload" }, "Upload"), h("a", { class: "button", href: "#/render" }, "Render")),
    h("div", { class: "panel filters fields", role: "search" }, field("Search", text), field("Method", method), field("State", state)), said, list);
  if (uploads.items.some(unused)) main.append(unusedUploads(uploads.items.filter(unused), signal));
  // What each card shows, until it is seen.
  /** @type {Map<Element, Job>} */
  const unseen = new Map();
  const seen = new IntersectionObserver((entries) => {
    for (const { isIntersecting, target } of entries) {
      if (!isIntersecting) continue;
      seen.unobserve(target);
      thumbnail(target.querySelector("img"), unseen.get(target), signal);
      unseen.delete(target);
    }
  }, { rootMargin: "200px" });
  signal.addEventListener("abort", () => seen.disconnect());
  paint();

  function matches(job) {
    const about = [titled(job, names), job.id, job.session, job.method, job.error].join(" ").toLowerCase();
    return (!wanted.method || job.method === wanted.method) && (!wanted.state || job.state === wanted.state) && about.includes(wanted.text.trim().toLowerCase());
  }

  function paint() {
    const found = items.filter(matches);
    unseen.clear();
    list.replaceChildren(...found.map(card));
    said.textContent = found.length ? "" : items.length ? "No result matches." : "No results yet. Sessions have theirs on their own pages; more come from them, from uploads and from scenes.";
    said.hidden = found.length > 0;
  }

  /** @param {Job} job */
  function card(job) {
    const method = words(job.method);
    const title = `${method[0].toUpperCase()}${method.slice(1)} of ${titled(job, names)}`;
    const remove = ENDED.includes(job.state) && h("button", { type: "button", class: "quiet icon", "aria-label": `Delete ${title}`, title: "Delete", onclick: () => erase(job, title) }, "✕");
    const element = h("li", { class: "panel card", "data-result": job.id },
      h("div", { class: "well thumb" }, h("img", { alt: "", hidden: true })),
      h("div", { class: "about" },
        h("a", { class: "title", href: `#/result/${job.id}` }, title),
        job.error && h("p", { class: "error" }, job.error),
        h("p", { class: "row soft" }, h("span", { class: "lamp", "data-tone": TONES[job.state] ?? "busy" }, words(job.state)), h("span", {}, moment(job.created)),
          names.has(job.session) && h("a", { href: `#/session/${job.session}` }, "Session"),
          job.state === "done" && VIEWED.includes(job.method) && h("a", { href: `#/view/${job.id}` }, "Under a light"))),
      remove);
    unseen.set(element, job);
    seen.observe(element);
    return element;
  }

  async function erase(job, title) {
    try {
      const { token, bytes: size, files } = await get(`/reconstructions/${job.id}/deletion`, { signal });
      const uploaded = job.upload ? " What was uploaded for it goes with the last result of it." : "";
      if (!(await confirmed(`Delete “${title}”?`, `${files} files, ${bytes(size)}, made ${moment(job.created)}. They are gone for good.${uploaded}`, "Delete"))) return;
      await send(`/reconstructions/${job.id}${query({ token })}`, { method: "DELETE" });
      items = items.filter((other) => other.id !== job.id);
      tell(`“${title}” is deleted.`);
      paint();
    } catch (problem) {
      complain(problem);
    }
  }
}

/** @param {Upload} upload */
const unused = (upload) => upload.expires !== null;

/**
 * Uploads that no result uses, to be deleted before they expire. Folded, as they are looked for only when space is short.
 * @param {Upload[]} uploads
 * @param {AbortSignal} signal
 */
function unusedUploads(uploads, signal) {
  const item = (/** @type {Upload} */ upload) => {
    const title = `Upload of ${moment(upload.created)}`;
    const element = h("li", { class: "panel card", "data-upload": upload.id },
      h("div", { class: "about" },
        h("span", { class: "title" }, title),
        h("p", { class: "row soft" }, h("span", {}, `${upload.files} files, ${bytes(upload.bytes)}`), h("span", {}, `deleted after ${moment(upload.expires)}`))),
      h("button", { type: "button", class: "quiet icon", "aria-label": `Delete ${title}`, title: "Delete", onclick: () => erase(upload, title, element) }, "✕"));
    return element;
  };
  async function erase(upload, title, element) {
    try {
      if (!(await confirmed(`Delete “${title}”?`, `${upload.files} files, ${bytes(upload.bytes)}. They are gone for good.`, "Delete"))) return;
      await send(`/uploads/${upload.id}`, { method: "DELETE", signal });
      element.remove();
      tell(`“${title}” is deleted.`);
    } catch (problem) {
      complain(problem);
    }
  }
  return h("details", { id: "unused-uploads" }, h("summary", {}, `Uploads without a result (${uploads.length})`), h("ul", { class: "cards" }, ...uploads.map(item)));
}

/** The first picture there is. None is no problem. */
async function thumbnail(image, job, signal) {
  if (job.state !== "done") return;
  const base = `/reconstructions/${job.id}`;
  try {
    const files = await get(`${base}/files`, { signal });
    const names = files.map((file) => file.name).filter((name) => name.endsWith(".png"));
    const map = names.includes("orientation.png") && `${base}/maps/orientation.png?width=192`;
    if (map || names.length) show(image, (await picture(map || `${base}/files/${names[0]}`, { signal })).blob);
  } catch (problem) {
    if (problem.name !== "AbortError" && problem.slug === undefined) throw problem;
  }
}
