// #/queue: running, waiting and ended jobs; waiting ones can be moved to the front.

import { get, post, query } from "./api.js";
import { h, panel, say } from "./dom.js";
import { complain, tell } from "./feedback.js";
import { duration, moment, percent, words } from "./format.js";
import { refreshJobs, service, watch } from "./service.js";

const TONES = { done: "good", failed: "bad", set_aside: "bad", cancelled: "warn" };
/** How many ended jobs are listed. */
const ENDED = 20;

/**
 * Shows the queue until the signal fires.
 * @param {HTMLElement} main
 * @param {Visit} visit
 */
export async function queuePage(main, { signal }) {
  const bench = h("p", { role: "status", "aria-live": "polite" });
  const open = h("ul", { class: "cards single" });
  const none = h("p", { class: "soft", role: "status" });
  const ended = h("ul", { class: "cards single" });
  const noneEnded = h("p", { class: "soft" }, "No job has ended yet.");
  main.append(h("div", { class: "head" }, h("h1", { class: "grow" }, "Queue"), h("a", { class: "button", href: "#/results" }, "All results")),
    h("div", { class: "columns halves" },
      h("div", { class: "stack" }, panel("Bench", null, bench), panel("Running and waiting", null, h("div", { class: "stack" }, none, open))),
      panel("Ended", null, h("div", { class: "stack" }, noneEnded, ended))));

  let shown = "";
  /** @type {Map<string, (job: Job) => void>} What updates a card. */
  let updates = new Map();

  function paint() {
    const { jobs, devices } = service;
    const session = devices?.session;
    bench.replaceChildren(...(session ? [h("a", { href: `#/session/${session}` }, "A session is running")] : [devices?.activity === "manual" ? "Under manual control." : "No session is running."]));
    if (!jobs) return;
    const key = jobs.map((job) => `${job.id} ${job.state}`).join();
    if (key !== shown) {
      // Whoever works by keyboard stays at the same button.
      const focused = open.contains(document.activeElement) ? document.activeElement?.getAttribute("aria-label") : null;
      updates = new Map();
      open.replaceChildren(...jobs.map((job, place) => card(job, place > 1 || (place === 1 && jobs[0].state !== "running"))));
      if (focused) /** @type {HTMLElement | null} */ (open.querySelector(`[aria-label=${CSS.escape(focused)}]`))?.focus();
      shown = key;
      showEnded();
    }
    for (const job of jobs) updates.get(job.id)?.(job);
    say(none, jobs.length ? "" : "Nothing is running or waiting.");
    none.hidden = jobs.length > 0;
  }

  /**
   * @param {Job} job
   * @param {boolean} moves Whether it can be moved forward.
   */
  function card(job, moves) {
    const state = h("span", { class: "lamp", "data-tone": job.state === "running" ? "busy" : "quiet" });
    const progress = h("progress", { max: 1, "aria-label": `Progress of ${job.name}`, hidden: job.state !== "running" });
    updates.set(job.id, (now) => {
      const left = now.remaining_s ? `, about ${duration(now.remaining_s)} left` : "";
      say(state, now.state === "running" ? `${now.stage || "Running"}, ${percent(now.progress, 0)}${left}` : "Waiting");
      progress.value = now.progress;
    });
    return h("li", { class: "panel card plain", "data-job": job.id },
      h("div", { class: "stack about" }, h("a", { class: "title", href: `#/result/${job.id}` }, job.name), h("p", { class: "row soft" }, state, h("span", {}, words(job.method)), h("span", {}, moment(job.created))), progress),
      h("div", { class: "row" },
        moves && h("button", { type: "button", "aria-label": `To the front: ${job.name}`, onclick: () => act(`/queue/${job.id}/first`) }, "To the front"),
        h("button", { type: "button", "aria-label": `Cancel ${job.name}`, onclick: () => act(`/reconstructions/${job.id}/cancel`, "The job is cancelled.") }, "Cancel")));
  }

  async function act(path, done = "") {
    try {
      await post(path);
      await refreshJobs();
      if (done) tell(done);
    } catch (problem) {
      complain(problem);
    }
  }

  async function showEnded() {
    try {
      /** @type {{ items: Job[] }} */
      const { items } = await get(`/reconstructions${query({ limit: 100 })}`, { signal });
      const some = items.filter((job) => job.state in TONES).slice(0, ENDED);
      noneEnded.hidden = some.length > 0;
      ended.replaceChildren(...some.map((job) => h("li", { class: "panel card plain" },
        h("div", { class: "about" }, h("a", { class: "title", href: `#/result/${job.id}` }, job.name), job.error && h("p", { class: "error" }, job.error),
          h("p", { class: "row soft" }, h("span", { class: "lamp", "data-tone": TONES[job.state] }, words(job.state)), h("span", {}, words(job.method)), h("span", {}, moment(job.created)))))));
    } catch (problem) {
      complain(problem);
    }
  }

  await Promise.all([refreshJobs(), showEnded()]);
  if (!signal.aborted) watch(paint, signal);
}
