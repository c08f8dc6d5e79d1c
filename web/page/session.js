// #/session/ID: a session while it runs and after.

import { get, listen, makeDownload, picture, post, show } from "./api.js";
import { facts, figures, h, panel, say, scrolling, segments, settle } from "./dom.js";
import { complain } from "./feedback.js";
import { bytes, degrees, duration, fileName, happened, moment, percent, words } from "./format.js";
import { course } from "./course.js";
import { dial } from "./dial.js";
import { bar, wheel } from "./legend.js";
import { heading } from "./naming.js";
import { prepare } from "./new.js";
import { notifyButton } from "./notify.js";
import { pretty } from "./plan.js";
import { calibrationsUsed } from "./references.js";
import { remedies } from "./remedy.js";
import { sessionForms } from "./sessionforms.js";
import { onReturn } from "./service.js";

/** Which commands a state allows, its tone, and what it means. */
const STATES = {
  idle: { tone: "warn", can: ["resume"], means: "stopped; what is missing can still be taken" },
  running: { tone: "busy", can: ["pause", "stop"], means: "taking frames" },
  pausing: { tone: "busy", can: ["stop"], means: "pauses after the frames in progress" },
  paused: { tone: "warn", can: ["resume", "stop"], means: "waiting in the dark" },
  resuming: { tone: "busy", can: ["stop"], means: "going on" },
  stopping: { tone: "busy", can: [], means: "ends after the frames in progress" },
  aborting: { tone: "bad", can: [], means: "ends at once" },
  finished: { tone: "good", can: [], means: "all frames are there" },
  failed: { tone: "bad", can: ["resume"], means: "ended early" },
};
const LOG_LINES = 500;
/** A hidden page has no stream of events, but its title goes on. */
const HIDDEN_MS = 5000;

/** Why a series that goes on until σ is as wanted has ended. */
const ENDINGS = {
  met: "as wanted",
  at_most: "all that the plan allows is taken",
  cannot: "ended early: all that the plan allows would not be enough",
};

/** What is known so far of a series that goes on until enough is, and what is wanted. */
function knownText(known, ended) {
  if ("fringes" in known) {
    const now = known.undecided === null ? "No first order on the panel yet" : `${percent(known.undecided, 1)} of the pixels with a first order undecided`;
    return [`${now}, ${percent(known.until_undecided, 1)} wanted`, `${known.fringes} of at most ${known.at_most} fringes`, ENDINGS[ended]].filter(Boolean).join(" · ");
  }
  const { angles, sigma_deg, until_sigma_deg, at_most } = known;
  const now = sigma_deg === null ? "No orientation yet" : `σ ${degrees(sigma_deg, 2)}`;
  return [`${now}, ${degrees(until_sigma_deg, 2)} wanted`, `${angles} of at most ${at_most} angles`, ENDINGS[ended]].filter(Boolean).join(" · ");
}

/**
 * Shows a session until the signal fires.
 * @param {HTMLElement} main
 * @param {Visit} visit
 */
export async function sessionPage(main, { id, signal }) {
  const base = `/sessions/${id}`;
  /** @type {Session} */
  let session = await get(base, { signal });
  /** @type {Frame[]} */
  let frames = (await get(`${base}/frames`, { signal })).items;
  if (signal.aborted) return;
  const planned = session.plan?.analyser?.angles_deg ?? [];

  const state = h("strong", { id: "session-state", role: "status", "aria-live": "polite" });
  const lamp = h("span", { class: "lamp" }, state);
  const means = h("span", { class: "soft" });
  const remedy = remedies(() => command("resume"));
  const progress = h("progress", { id: "progress", max: 1, value: 0, "aria-label": "Frames taken" });
  const taken = h("span", {}, "");
  const sigma = h("p", { id: "session-sigma", class: "soft", role: "status", hidden: true });
  const phases = course(session.plan);
  const notify = notifyButton(base, `#/session/${id}`);
  const time = h("span", {}, "");
  const size = h("span", {}, "");
  const buttons = Object.fromEntries([["pause", "Pause"], ["resume", "Resume"], ["stop", "Stop"]].map(([verb, label]) =>
    [verb, h("button", { type: "button", id: verb === "stop" ? "session-stop" : verb, onclick: () => command(verb),
      title: { pause: "Pause in the dark after the frames in progress", resume: "Go on, taking what is missing", stop: "End after the frames in progress; it can be resumed" }[verb] }, label)]));
  const resultLink = h("a", { class: "button primary", id: "open-result", href: `#/result/${id}`, hidden: true }, "Open the result");

  const last = h("img", { id: "last-frame", alt: "Last frame taken", hidden: true });
  const lastAbout = h("span", { class: "soft" });
  const lastEmpty = h("p", { class: "empty" }, "No frame yet.");
  const map = h("img", { id: "live-map", alt: "Map so far", hidden: true });
  const pictured = { hdr: ["hdr.png", "Merged exposures, tone-mapped."], lut: ["lut.png", "The table under its light."], bokeh: ["deconvolved.png", "The highlight, its blur taken out."], spots: ["period.png", "Periods by fringes."], flash: ["orientation.png", "Orientations by flash photographs."],
    camera: ["bad-pixels.png", "Pixels with defects."], flat: ["flat.png", "Relative light."] }[session.plan?.reconstruct?.operation];
  const mapEmpty = h("p", { class: "empty" }, pictured ? "Made after the last exposure." : "The map appears after three angles.");
  const mapAbout = h("span", { class: "soft" });
  const rose = wheel(112);
  const legend = h("div", { class: "legend" }, pictured ? null : rose);
  const log = h("ol", { class: "log scroll", tabindex: 0, "aria-label": "Events" });
  const angles = dial();
  let shown = "orientation";
  const choice = segments("Map", [["orientation", "Orientation"], ["sigma", "σ"], ["dolp", "DoLP"]], shown, (key) => { shown = key; refreshMap(); });
  addEventListener("themechange", () => rose.refresh(), { signal });

  const used = calibrationsUsed();
  const forms = sessionForms(session, () => frames, signal);
  const repeat = session.kind === "calibration" ? h("a", { class: "button", href: `#/calibration/${session.plan?.calibration?.of ?? ""}` }, "Repeat")
    : h("a", { class: "button", href: "#/new", onclick: () => prepare(session.plan) }, "Repeat");
  const tableHolder = scrolling("Frames");
  const table = h("details", { ontoggle: () => table.open && paintFrames() }, h("summary", {}, "Frames"), tableHolder);
  const fileHolder = scrolling("Files");
  const files = h("details", { ontoggle: () => files.open && paintFiles() }, h("summary", {}, "Files"), fileHolder);
  main.append(
    h("div", { class: "head" }, heading(session.name, base), resultLink, repeat),
    h("div", { class: "columns session" },
      h("div", { class: "stack" },
        panel("Progress", h("div", { class: "row" }, notify, Object.values(buttons)), h("div", { class: "stack" },
          h("p", { class: "row" }, lamp, means), phases.element, remedy.element, progress, sigma, figures([["frames", taken], [time, phases.eta], ["on disk", size]]))),
        panel(pictured ? "Picture" : "Map", pictured ? null : choice, h("div", { class: "well mapwell live" }, map, mapEmpty), h("div", { class: "row under" }, legend, mapAbout)), forms),
      h("div", { class: "stack" },
        h("div", { class: "columns pair" },
          panel("Last frame", lastAbout, h("div", { class: "well last" }, last, lastEmpty)),
          planned.length > 0 && panel("Angles", null, angles)),
        panel("Session", null, facts([
          ["Sample", session.sample], ["Operator", session.operator], ["Notes", session.notes], ["Kind", words(session.kind)],
          ["Begun", moment(session.created)], ["Id", h("code", {}, id)]])),
        used.element,
        panel("Events", null, log), h("section", { class: "panel stack" }, table, files,
          h("details", {}, h("summary", {}, "Plan"), h("pre", { class: "scroll code", tabindex: 0 }, session.plan ? pretty(session.plan) : ""))))));

  /** What events told last of state and stage, so that only changes are listed. */
  const told = { state: "", stage: "" };
  /** Number of events about the state. */
  let statesTold = 0;
  /** Lists what happened; the time is the service's, so that it is the same after a reload. */
  function note(text, time) {
    log.prepend(h("li", {}, h("time", {}, happened(time)), text));
    while (log.children.length > LOG_LINES) log.lastElementChild?.remove();
  }

  async function command(verb) {
    for (const button of Object.values(buttons)) button.disabled = true;
    try {
      const before = statesTold;
      const answer = await post(`${base}/${verb}`);
      // An event that came before the answer is newer than it.
      if (statesTold === before) take(answer);
    } catch (problem) {
      complain(problem);
    }
    paint();
  }

  /** @param {Session | null} next */
  function take(next) {
    if (!next) return;
    const results = next.has_results && !session.has_results;
    session = { ...session, ...next };
    phases.update(session);
    paint();
    if (results) refreshMap();
  }

  function paint() {
    const { tone, can, means: meaning } = STATES[session.state] ?? { tone: "quiet", can: [], means: "" };
    say(state, session.state);
    lamp.dataset.tone = tone;
    const going = session.stage !== null;
    say(means, session.state === "finished" && going ? "all frames are there; the results follow" : meaning);
    const title = `${session.name} · Nacre`;
    document.title = going ? `${phases.title()} · ${title}` : title;
    notify.hidden ||= !going;
    for (const [verb, button] of Object.entries(buttons)) button.disabled = !can.includes(verb);
    remedy.update(session);
    used.update(session);
    progress.value = session.frames_planned ? session.frames_committed / session.frames_planned : 0;
    say(taken, `${session.frames_committed} of ${session.frames_planned}`);
    sigma.hidden = !session.sigma;
    if (session.sigma) say(sigma, knownText(session.sigma, session.ended));
    say(time, going ? (session.plan?.reconstruct ? "to go, with results" : "to go") : "taken");
    say(size, bytes(session.bytes));
    resultLink.hidden = !session.has_results;
    forms?.update(session);
    angles.marks(planned, frames.flatMap((f) => f.analyser_deg ?? []));
    const newest = frames.at(-1)?.analyser_deg;
    if (typeof newest === "number") angles.set(newest);
  }

  // Pictures come as fast as they can be fetched, never two of a sort at once; the newest wish wins.
  const latest = (fetchAndShow) => {
    let running = false;
    let wanted = false;
    return async () => {
      wanted = true;
      if (running) return;
      running = true;
      while (wanted && !signal.aborted) {
        wanted = false;
        await fetchAndShow().catch((problem) => problem.slug !== "not-found" && !signal.aborted && complain(problem));
      }
      running = false;
    };
  };
  const pixels = (image) => Math.min(2048, 160 * Math.ceil(((image.parentElement.clientWidth || 400) * devicePixelRatio) / 160));
  const refreshMap = latest(async () => {
    if (pictured) {
      if (!session.has_results) return;
      show(map, (await picture(`/reconstructions/${id}/files/${pictured[0]}`, { signal })).blob);
      mapEmpty.hidden = true;
      return say(mapAbout, pictured[1]);
    }
    // Three angles make a map; asking sooner would be answered with a problem.
    const angles = new Set(frames.map((f) => f.analyser_deg).filter((deg) => typeof deg === "number"));
    if (!session.has_results && angles.size < 3) return;
    const from = session.has_results ? `/reconstructions/${id}/maps/${shown}.png?` : `${base}/live.png?map=${shown}&`;
    const { blob, range, palette } = await picture(`${from}width=${pixels(map)}`, { signal });
    rose.dye(palette);
    show(map, blob);
    mapEmpty.hidden = true;
    legend.replaceChildren(shown === "orientation" ? rose : bar(range, shown === "sigma" ? "°" : ""));
    rose.refresh();
    say(mapAbout, session.has_results ? "Final map." : "So far; σ falls with every angle.");
  });
  const refreshFrame = latest(async () => {
    const frame = frames.at(-1);
    if (!frame) return;
    const name = fileName(frame.file).replace(/\.png$/, "");
    const { blob } = await picture(`${base}/frames/${name}.png?width=${pixels(last)}`, { signal });
    show(last, blob);
    lastEmpty.hidden = true;
    paintFrame();
  });
  function paintFrame() {
    const { file, analyser_deg, exposure_s } = frames.at(-1) ?? {};
    if (file) say(lastAbout, [fileName(file), typeof analyser_deg === "number" && degrees(analyser_deg, 1), duration(exposure_s)].filter(Boolean).join(" · "));
  }

  function paintFrames() {
    tableHolder.replaceChildren(h("table", {},
      h("thead", {}, h("tr", {}, ["File", "For", "Analyser", "Exposure", "Gain", "Sequence", "Dropped"].map((t, i) => h("th", { scope: "col", class: i > 1 && "number" }, t)))),
      h("tbody", {}, frames.map((f) => h("tr", {}, h("td", {}, f.file), h("td", {}, words(f.role ?? "")),
        [degrees(f.analyser_deg), duration(f.exposure_s), f.gain ?? "–", f.sequence, f.dropped].map((v) => h("td", { class: "number" }, String(v))))))));
  }
  const framesLater = settle(400, () => table.open && paintFrames());

  async function paintFiles() {
    try {
      const { items } = await get(`${base}/files`, { signal });
      fileHolder.replaceChildren(h("table", {}, h("tbody", {}, items.map((f) => {
        const link = h("a", {}, f.path);
        makeDownload(link, `${base}/files/${f.path.split("/").map(encodeURIComponent).join("/")}`, fileName(f.path), complain);
        return h("tr", {}, h("td", {}, link), h("td", { class: "number" }, bytes(f.bytes)));
      }))));
    } catch (problem) {
      complain(problem);
    }
  }

  const handlers = {
    state(next) {
      statesTold += 1;
      // The state of a session that nobody works on has no time: its journal has told what happened.
      if (next.time && next.state !== told.state) note(`State: ${next.state}`, next.time);
      if (next.time && next.stage && next.stage !== told.stage) note(`Stage: ${words(next.stage)}`, next.time);
      Object.assign(told, { state: next.state, stage: next.stage });
      take(next);
    },
    stage({ stage, eta_s, time }) {
      if (stage !== told.stage) note(`Stage: ${words(stage)}`, time);
      told.stage = stage;
      // Stages of results do not end the last activity of the devices.
      session = { ...session, stage, eta_s, activity: null };
      phases.update(session);
      paint();
    },
    activity(/** @type {Activity} */ now) {
      session = { ...session, activity: now, eta_s: now.eta_s ?? null };
      phases.update(session);
    },
    frame(frame) {
      note([fileName(frame.file), typeof frame.analyser_deg === "number" && degrees(frame.analyser_deg), duration(frame.exposure_s),
        frame.dropped > 0 && `${frame.dropped} stale dropped`].filter(Boolean).join(" · "), frame.time);
      if (frames.some((f) => f.file === frame.file)) return;
      frames = [...frames, frame];
      session.frames_committed = Math.max(session.frames_committed, frames.length);
      phases.update(session, false);
      paint();
      refreshFrame();
      framesLater();
    },
    map: () => refreshMap(),
    sigma(so_far) {
      session.sigma = so_far;
      paint();
    },
    results({ time }) {
      note("Results are there", time);
      session.has_results = true;
      paint();
      refreshMap();
    },
    note: ({ text, time }) => note(text, time),
  };
  // After a break the session can be anywhere: read it again rather than trust the events that were missed.
  async function reload() {
    try {
      const [next, list] = await Promise.all([get(base, { signal }), get(`${base}/frames`, { signal })]);
      frames = list.items;
      take(next);
      refreshMap();
      refreshFrame();
    } catch (problem) {
      complain(problem);
    }
  }
  onReturn(reload, signal);
  const ticking = setInterval(phases.paint, 1000);
  const hidden = setInterval(async () => {
    if (document.hidden && session.stage !== null) take(await get(base, { signal }).catch(() => null));
  }, HIDDEN_MS);
  signal.addEventListener("abort", () => [ticking, hidden].forEach(clearInterval));
  phases.update(session);
  paint();
  paintFrame();
  refreshMap();
  refreshFrame();
  listen(`${base}/events`, {
    event: (name, value) => signal.aborted || handlers[name]?.(value),
    lost: (problem) => problem && problem.slug !== "unreachable" && complain(problem),
  }, { signal, rest: true });
}
