// Start of the page: header, routes, stop, theme.

import { get, post } from "./api.js";
import { h, say } from "./dom.js";
import { alarm, complain, problemMessage, tell } from "./feedback.js";
import { onReturn, refresh, service, start, watch } from "./service.js";
import { benchPage } from "./bench.js";
import { calibratePage } from "./calibrate.js";
import { calibrationPage } from "./calibration.js";
import { chartsPage } from "./charts.js";
import { newPage } from "./new.js";
import { loadOperations } from "./operationform.js";
import { queuePage } from "./queue.js";
import { renderPage } from "./render.js";
import { resultPage } from "./result.js";
import { resultsPage } from "./results.js";
import { sessionPage } from "./session.js";
import { sessionsPage } from "./sessions.js";
import { settingsPage } from "./settings.js";
import { trashPage } from "./trash.js";
import { uploadPage } from "./upload.js";

const ROUTES = {
  bench: ["Bench", benchPage],
  calibrate: ["Calibrate", calibratePage],
  calibration: ["Calibration", calibrationPage],
  new: ["New session", newPage],
  session: ["Session", sessionPage],
  sessions: ["Sessions", sessionsPage],
  result: ["Result", resultPage],
  results: ["Results", resultsPage],
  charts: ["Charts", chartsPage],
  trash: ["Trash", trashPage],
  upload: ["Upload", uploadPage],
  render: ["Render", renderPage],
  queue: ["Queue", queuePage],
  settings: ["Settings", settingsPage],
  inspect: ["Inspect", async (/** @type {[HTMLElement, Visit]} */ ...visit) => (await import("./inspect.js")).inspectPage(...visit)],
  maps: ["Maps", async (/** @type {[HTMLElement, Visit]} */ ...visit) => (await import("./mapspage.js")).mapsPage(...visit)],
  // The viewer with its shaders is as much as all else, and is fetched when it is wanted.
  view: ["View", async (/** @type {[HTMLElement, Visit]} */ ...visit) => (await import("./view.js")).viewPage(...visit)],
};
/** Links of pages that have none of their own. */
const PARENTS = {
  session: "#/sessions", trash: "#/sessions", result: "#/results", view: "#/results", maps: "#/results", inspect: "#/results", calibrate: "#/calibration",
};
/** Pages with forms of operations. */
const FORMS = ["new", "result", "upload", "render", "session", "inspect"];
const byId = (/** @type {string} */ id) => /** @type {HTMLElement} */ (document.getElementById(id));
const main = byId("main");
let leaving = new AbortController();
let failed = false;

async function route() {
  const [name, id] = location.hash.replace(/^#\/?/, "").split("/");
  if (location.hash === "#main") return main.focus();
  if (!name) return location.replace("#/bench");
  leaving.abort();
  leaving = new AbortController();
  const { signal } = leaving;
  if (!ROUTES[name]) return nowhere();
  const [title, page] = ROUTES[name];
  document.title = `${title} · Nacre`;
  const links = /** @type {NodeListOf<HTMLAnchorElement>} */ (document.querySelectorAll(".nav a"));
  for (const link of links) {
    const here = link.hash === `#/${name}` || PARENTS[name] === link.hash;
    if (here) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  clear();
  try {
    if (FORMS.includes(name)) await loadOperations();
    await page(main, { id: decodeURIComponent(id ?? ""), signal });
  } catch (problem) {
    if (signal.aborted) return;
    failed = problem.status !== 404;
    if (problem.slug === undefined) console.error(problem);
    const gone = problem.status === 404 && id;
    main.replaceChildren(h("div", { class: "head" }, h("h1", {}, title)),
      gone ? h("div", { class: "message", role: "alert" }, h("strong", {}, `This ${["session", "calibration"].includes(name) ? name : "result"} does not exist`), "It may have been deleted; the trash keeps what was deleted for some days.") : problemMessage(problem),
      h("p", { class: "row ways" }, failed && h("button", { type: "button", onclick: route }, "Try again"), ...waysBack(name).map(([href, text]) => h("a", { class: "button", href }, text))));
  }
}

/** Empties the page. The focus does not stay at what is gone. */
function clear() {
  failed = false;
  const inside = main.contains(document.activeElement);
  main.replaceChildren();
  if (inside) main.focus({ preventScroll: true });
}

/** Says that an address has no page. */
function nowhere() {
  document.title = "Unknown address · Nacre";
  clear();
  main.replaceChildren(h("div", { class: "head" }, h("h1", {}, "Unknown address")), h("p", {}, "There is no page at this address."),
    h("p", { class: "row ways" }, waysBack("").map(([href, text]) => h("a", { class: "button", href }, text))));
}

/** Where to go from a page that could not be shown. */
function waysBack(/** @type {string} */ name) {
  const lists = [["#/sessions", "Sessions"], ["#/results", "Results"]];
  if (["session", "result", "view", "maps"].includes(name)) return [...lists, ["#/trash", "Trash"]];
  return [["#/bench", "Bench"], ...lists].filter(([href]) => href !== `#/${name}`);
}

// A page that could not be loaded is tried again as soon as there is hope; the others go on by themselves.
onReturn(() => failed && route());
addEventListener("hashchange", route);

const ACTIVITY = { idle: ["good", "Idle"], manual: ["busy", "Manual control"], session: ["busy", "Session running"] };
const state = byId("service");
const lost = byId("lost");

watch(({ devices, jobs, reachable, problem, since }) => {
  lost.hidden = reachable !== false;
  if (reachable === false) {
    const time = new Date(since).toTimeString().slice(0, 8);
    say(lost, `No connection to the service since ${time}. Trying again every second; what is shown may be out of date.`);
    return paint("bad", "Not connected");
  }
  if (problem) {
    state.title = `${problem.message} ${problem.remedy}`;
    return paint("bad", "Devices do not answer");
  }
  state.title = "";
  if (!devices) return;
  const open = devices.interlocks.filter((i) => i.holds === false);
  if (open.length) return paint("warn", `Interlock open: ${open.map((i) => i.id).join(", ")}`, devices, jobs);
  const [tone, text] = ACTIVITY[devices.activity] ?? ["quiet", devices.activity];
  paint(tone, text, devices, jobs);
});

/**
 * @param {string} tone
 * @param {string} text
 * @param {Devices} [devices]
 * @param {Job[] | null} [jobs]
 */
function paint(tone, text, devices, jobs) {
  state.dataset.tone = tone;
  const count = jobs?.length ?? 0;
  const key = [text, devices?.session, devices?.simulated, count].join();
  if (state.dataset.key === key) return;
  state.dataset.key = key;
  state.replaceChildren(h("a", { href: devices?.session ? `#/session/${devices.session}` : "#/queue" }, text),
    ...(count ? [h("a", { class: "badge", id: "jobs", href: "#/queue" }, count === 1 ? "1 job" : `${count} jobs`)] : []),
    ...(devices?.simulated ? [h("span", { class: "badge", title: "No real device is moved" }, "simulated")] : []));
}

const stop = byId("stop");

async function stopAll() {
  stop.textContent = "STOPPING";
  dispatchEvent(new Event("nacre-stop"));
  try {
    await post("/stop", {}, { keepalive: true });
    tell("Stopped. All light is off.");
    refresh();
  } catch (problem) {
    alarm("STOP did not reach the service", problem.message, "Switch off light and motion at the bench itself. " + (problem.remedy ?? ""));
  } finally {
    stop.textContent = "STOP";
  }
}
stop.addEventListener("click", stopAll);

// Escape twice works while typing in a field too, which a letter could not.
let lastEscape = -Infinity;
addEventListener("keydown", (event) => {
  if (event.key !== "Escape" || event.repeat) return;
  const twice = event.timeStamp - lastEscape < 700;
  lastEscape = twice ? -Infinity : event.timeStamp;
  if (twice) stopAll();
}, { capture: true });

const theme = byId("theme");
const systemDark = matchMedia("(prefers-color-scheme: dark)");
const isDark = () => (document.documentElement.dataset.theme ?? (systemDark.matches ? "dark" : "light")) === "dark";

function labelTheme() {
  const next = isDark() ? "light" : "dark";
  theme.textContent = isDark() ? "☀" : "☾";
  theme.title = `Use the ${next} theme`;
  theme.setAttribute("aria-label", theme.title);
}
theme.addEventListener("click", () => {
  const next = isDark() ? "light" : "dark";
  document.documentElement.dataset.theme = next;
  try {
    localStorage.setItem("nacre-theme", next);
  } catch {
    // Storage can be forbidden; the choice then lasts until the page is closed.
  }
  labelTheme();
  dispatchEvent(new Event("themechange"));
});
systemDark.addEventListener("change", labelTheme);
labelTheme();

let aboutShown = false;
async function about() {
  if (aboutShown || !service.reachable) return;
  aboutShown = true;
  try {
    const { version, problems } = await get("/about");
    for (const problem of problems) alarm("The service has a problem", problem, "");
    byId("about").replaceChildren(
      h("span", {}, `Nacre ${version}`),
      h("a", { href: "/display", target: "_blank", rel: "noopener" }, "Page for the panel"), h("a", { href: "/api/v1/openapi.json" }, "OpenAPI"));
  } catch (problem) {
    aboutShown = false;
    complain(problem);
  }
}
watch(about);
start();
route();
