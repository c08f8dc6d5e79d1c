// The page for the panel: shows what the service asks for and proves that it does.
//
// It fails dark. When the service falls silent or the page is hidden it is black, and it acknowledges nothing that
// cannot be seen.

import { listen, post, setTokenDialog } from "./api.js";
import { after, h, randomId } from "./dom.js";
import { draw, panelOf } from "./patterns.js";

const SILENCE_MS = 3000;
const BEAT_MS = 1000;
const page = randomId();
const canvas = /** @type {HTMLCanvasElement} */ (document.getElementById("panel"));
const hint = /** @type {HTMLElement} */ (document.getElementById("hint"));

// What the service wants shown: { pattern, hash, size_mm }. It stays while the page is hidden, to come back to.
let wanted = null;
let heard = -Infinity;
let drawing = 0;

const visible = () => document.visibilityState === "visible";
const alive = () => performance.now() - heard < SILENCE_MS;

/** Draws what is to be seen now; acknowledges it once it can be seen. */
function paint() {
  const turn = ++drawing;
  const [width, height] = [Math.round(innerWidth * devicePixelRatio), Math.round(innerHeight * devicePixelRatio)];
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const lit = wanted !== null && visible() && alive();
  const drawn = draw(canvas, lit ? wanted.pattern : { kind: "black" }, panelOf(canvas, wanted?.size_mm, screen, devicePixelRatio));
  if (!lit || !drawn) return;
  const shown = wanted;
  // The first frame after drawing hands the picture to the screen; by the second it is there.
  requestAnimationFrame(() => requestAnimationFrame(() => {
    if (turn !== drawing || shown !== wanted || !visible() || !alive()) return;
    tell("/display/acknowledge", { hash: shown.hash, viewport: [innerWidth, innerHeight], pixel_ratio: devicePixelRatio, visible: true });
  }));
}

async function tell(path, value) {
  try {
    await post(path, { page, ...value }, { signal: after(2000) });
  } catch {
    // A service that does not hear takes the panel for dark, which is what it then is.
  }
}

const beat = () => tell("/display/beat", { visible: visible() });

listen(`/display/link?page=${page}`, {
  heard() {
    const silent = !alive();
    heard = performance.now();
    // Whatever was on before a silence is asked for again by the service, or shown again here.
    if (silent && wanted) paint();
  },
  event(name, value) {
    if (name !== "pattern") return;
    wanted = value;
    hint.hidden = true;
    document.body.classList.remove("free");
    paint();
  },
  lost() {
    heard = -Infinity;
    paint();
  },
}, { signal: new AbortController().signal, silence: SILENCE_MS });

setInterval(() => {
  if (alive()) beat();
}, BEAT_MS);

let wasAlive = false;
setInterval(() => {
  const now = alive();
  if (wasAlive && !now) paint();
  wasAlive = now;
}, 100);

document.addEventListener("visibilitychange", () => {
  paint();
  beat();
  if (visible()) stayAwake();
});
addEventListener("resize", paint);

/** Keeps the screen from going to sleep; the lock is lost whenever the page is hidden. */
async function stayAwake() {
  try {
    // Missing on plain-HTTP addresses other than loopback.
    await navigator.wakeLock?.request("screen");
  } catch {
    // Refused, as on low battery; the service sees whether the page is visible.
  }
}

document.addEventListener("click", async (event) => {
  if (event.target instanceof Element && event.target.closest("dialog")) return;
  hint.hidden = true;
  stayAwake();
  try {
    await document.documentElement.requestFullscreen({ navigationUI: "hide" });
  } catch {
    // Full screen can be forbidden; the pattern is then shown in the window.
  }
});

setTokenDialog((reason) => new Promise((resolve) => {
  // Only before the first pattern: text is light. Later the panel stays black until the page is loaded again.
  if (wanted) return resolve(null);
  const input = h("input", { type: "password", "aria-label": "Token", autocomplete: "off" });
  const dialog = h("dialog", { "aria-label": "Token" }, h("form", { method: "dialog" }, reason || "Token of the service", input, h("button", { value: "yes" }, "Connect")));
  dialog.addEventListener("close", () => {
    dialog.remove();
    resolve(input.value.trim() || null);
  });
  document.body.append(dialog);
  dialog.showModal();
}));

paint();
stayAwake();
