// #/results: reconstructions and renderings, found again by what they were made of.

import { get, picture, query, show } from "./api.js";
import { field, h, select } from "./dom.js";
import { complain } from "./feedback.js";
import { INSPECTED, VIEWED } from "./finding.js";
import { bytes, moment, words } from "./format.js";
import { renameable } from "./naming.js";
import { discard } from "./trash.js";

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
  /** @type {Job[]} */
  let items = [];
  const left = h("div");
  async function load() {
    const [jobs, uploads] = await Promise.all([get(`/reconstructions${query({ limit: MOST })}`, { signal }), get("/uploads", { signal })]);
    items = jobs.items;
    const unfolded = left.querySelector("details")?.open ?? false;
    left.replaceChildren(...(uploads.items.some(unused) ? [unusedUploads(uploads.items.filter(unused), unfolded, reload)] : []));
  }
  async function reload() {
    await load();
    paint();
  }
  await load();
  const methods = [...new Set(items.map((job) => job.method))].sort();
  const change = (key) => (e) => {
    wanted[key] = e.target.value;
    paint();
  };
  const text = h("input", { id: "search", type: "search", value: wanted.text, placeholder: "Name, method, id, error", oninput: change("text") });
  const method = select([["", "All"], ...methods.map((m) => [m, words(m)])], wanted.method, { id: "filter-method", onchange: change("method") });
  const state = select([["", "All"], ...["queued", "running", ...ENDED].map((s) => [s, words(s)])], wanted.state, { id: "filter-state", onchange: change("state") });
  const said = h("p", { class: "soft", role: "status", "aria-live": "polite" });
  const list = h("ul", { class: "cards" });
  main.append(h("div", { class: "head" }, h("h1", { class: "grow" }, "Results"), h("a", { class: "button", href: "#/trash" }, "Trash"), h("a", { class: "button", href: "#/upload" }, "Upload"), h("a", { class: "button", href: "#/render" }, "Render"), h("a", { class: "button", id: "to-inspect", href: "#/inspect" }, "Inspect")),
    h("div", { class: "panel filters fields", role: "search" }, field("Search", text), field("Method", method), field("State", state)), said, list, left);
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
    const about = [job.name, job.id, job.session, job.method, job.error].join(" ").toLowerCase();
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
    const title = job.name;
    const remove = ENDED.includes(job.state) && h("button", { type: "button", class: "quiet icon", "aria-label": `Delete ${title}`, title: "Delete", onclick: () => discard(`/reconstructions/${job.id}`, job, reload) }, "✕");
    const element = h("li", { class: "panel card", "data-result": job.id },
      h("div", { class: "well thumb" }, h("img", { alt: "", hidden: true })),
      h("div", { class: "about" },
        h("a", { class: "title", href: `#/result/${job.id}` }, title),
        job.error && h("p", { class: "error" }, job.error),
        h("p", { class: "row soft" }, h("span", { class: "lamp", "data-tone": TONES[job.state] ?? "busy" }, words(job.state)), h("span", {}, words(job.method)), h("span", {}, moment(job.created)),
          job.session && h("a", { href: `#/session/${job.session}` }, "Session"),
          job.state === "done" && VIEWED.includes(job.method) && h("a", { href: `#/view/${job.id}` }, "Under a light"),
          job.state === "done" && INSPECTED.includes(job.method) && h("a", { href: `#/inspect/${job.id}` }, "Inspect against…"))),
      remove);
    unseen.set(element, job);
    seen.observe(element);
    return element;
  }
}

/** @param {Upload} upload */
const unused = (upload) => upload.expires !== null;

/**
 * Uploads that no result uses, to be deleted before they expire. Folded, as they are looked for only when space is short.
 * @param {Upload[]} uploads
 * @param {boolean} open
 * @param {() => unknown} changed
 */
function unusedUploads(uploads, open, changed) {
  const item = (/** @type {Upload} */ upload) => h("li", { class: "panel card plain", "data-upload": upload.id },
    h("div", { class: "about" },
      renameable(h("span", { class: "title" }), upload.name, `/uploads/${upload.id}`, changed),
      h("p", { class: "row soft" }, h("span", {}, `${upload.files} files, ${bytes(upload.bytes)}`), h("span", {}, moment(upload.created)), h("span", {}, `deleted after ${moment(upload.expires)}`))),
    h("button", { type: "button", class: "quiet icon", "aria-label": `Delete ${upload.name}`, title: "Delete", onclick: () => discard(`/uploads/${upload.id}`, upload, changed) }, "✕"));
  return h("details", { id: "unused-uploads", open }, h("summary", {}, `Uploads without a result (${uploads.length})`), h("ul", { class: "cards" }, ...uploads.map(item)));
}

/** The first picture there is. None is no problem. */
async function thumbnail(image, job, signal) {
  if (job.state !== "done") return;
  const base = `/reconstructions/${job.id}`;
  try {
    const files = await get(`${base}/files`, { signal });
    const names = files.map((file) => file.name).filter((name) => name.endsWith(".png"));
    const map = names.includes("orientation.png") && `${base}/maps/orientation.png?width=192`;
    // Of an inspection, that of the sample, or of the first one in its folder.
    const file = names.find((name) => /(^|\/)sample\.png$/.test(name)) ?? names[0];
    if (map || file) show(image, (await picture(map || `${base}/files/${encodeURIComponent(file)}`, { signal })).blob);
  } catch (problem) {
    if (problem.name !== "AbortError" && problem.slug === undefined) throw problem;
  }
}
