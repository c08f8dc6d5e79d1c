// The service's REST interface: JSON, problems, pictures, event streams, the token.

import { pause } from "./dom.js";

const BASE = "/api/v1";
const TOKEN = "nacre-token";

/** What the service (or the way to it) says went wrong, with what can be done about it. */
export class Problem extends Error {
  /** @param {{ type?: string, title?: string, status?: number, detail?: string, remedy?: string }} told */
  constructor({ type, title, status, detail, remedy }) {
    super(detail || title || "something went wrong");
    this.slug = String(type ?? "").split("/").pop();
    this.title = title || "Problem";
    this.status = status;
    this.remedy = remedy || "";
  }
}

/** Told whenever the service could or could not be reached; set by service.js. */
export const reach = { changed: (/** @type {boolean} */ _) => {} };

/** @type {string | null} */
let token = null;
try {
  token = sessionStorage.getItem(TOKEN);
} catch {
  // Storage can be forbidden; the token is then asked for after each reload.
}
/** @type {Promise<string | null> | null} */
let asking = null;
/** @type {(reason: string) => Promise<string | null>} */
let askToken = async () => null;

/**
 * Sets how the user is asked for the token: an async function from a reason to the token or null.
 * @param {(reason: string) => Promise<string | null>} ask
 */
export function setTokenDialog(ask) {
  askToken = ask;
}

/** Whether requests carry a token, so that plain links would be refused. */
export const hasToken = () => token !== null;

// Several requests can be refused at once; they all wait for one dialog.
async function newToken(reason) {
  asking ??= askToken(reason).finally(() => (asking = null));
  const given = await asking;
  if (given) {
    token = given;
    try {
      sessionStorage.setItem(TOKEN, given);
    } catch {
      // Kept in memory only.
    }
  }
  return given;
}

async function problemOf(response) {
  const said = await response.json().catch(() => null);
  if (said && (said.title || said.detail)) return new Problem({ ...said, status: response.status });
  return new Problem({
    title: `Status ${response.status}`,
    status: response.status,
    detail: `the service answered with ${response.status} ${response.statusText}`.trim(),
    remedy: "Look at the service's log.",
  });
}

/**
 * The response to a request; throws a Problem unless it is a success.
 * @param {string} path
 * @param {Sending} options
 */
export async function send(path, { method = "GET", body, headers = {}, signal, keepalive } = {}) {
  for (;;) {
    const used = token;
    let response;
    try {
      response = await fetch(BASE + path, {
        method, body, signal, keepalive,
        cache: "no-store",
        headers: used ? { ...headers, Authorization: `Bearer ${used}` } : headers,
      });
    } catch (error) {
      if (error.name === "AbortError") throw error;
      reach.changed(false);
      throw new Problem({
        type: "unreachable",
        title: "The service does not answer",
        detail: `There is no connection to ${location.host}.`,
        remedy: "The page connects again by itself; see whether `nacre serve` is running.",
      });
    }
    reach.changed(true);
    if (response.ok) return response;
    const problem = await problemOf(response);
    if (response.status !== 401) throw problem;
    // Another request may have brought a token meanwhile.
    if (used === token && !(await newToken(used ? "The service refused this token." : ""))) throw problem;
  }
}

/**
 * JSON of a GET; whoever asks says of what type.
 * @param {string} path
 * @param {Sending} [options]
 */
export const get = async (path, options) => (await send(path, options)).json();

/**
 * JSON (or null) of a POST.
 * @param {string} path
 * @param {object} value
 * @param {Sending} options
 */
export async function post(path, value = {}, { headers = {}, ...options } = {}) {
  const body = JSON.stringify(value);
  const response = await send(path, { method: "POST", body, headers: { "Content-Type": "application/json", ...headers }, ...options });
  return response.status === 204 ? null : response.json().catch(() => null);
}

/**
 * A query string without what is empty.
 * @param {Record<string, string | number | boolean | null | undefined>} values
 */
export function query(values) {
  const given = Object.entries(values).filter(([, v]) => v !== null && v !== undefined && v !== "");
  return given.length ? `?${new URLSearchParams(given.map(([k, v]) => [k, String(v)]))}` : "";
}

/**
 * A picture with what its headers tell: the range of its colours, if any, and the palette of angles.
 * @param {string} path
 * @param {Sending} [options]
 */
export async function picture(path, options) {
  const response = await send(path, options);
  const range = (response.headers.get("X-Nacre-Range") ?? "").split(/[ ,]+/).filter(Boolean).map(Number);
  /** @type {"cyclic" | "hsv"} */
  const palette = response.headers.get("X-Nacre-Palette") === "hsv" ? "hsv" : "cyclic";
  return { blob: await response.blob(), range: range.length === 2 && range.every(Number.isFinite) ? range : null, palette };
}

/**
 * Puts a blob into an <img>, and lets go of the one before.
 * @param {HTMLImageElement} image
 * @param {Blob} blob
 */
export function show(image, blob) {
  const before = image.src;
  image.src = URL.createObjectURL(blob);
  image.hidden = false;
  if (before.startsWith("blob:")) URL.revokeObjectURL(before);
}

/**
 * A link to a download. With a token the file is fetched first, since a link cannot carry it.
 * @param {HTMLAnchorElement} link
 * @param {string} path
 * @param {string} name
 * @param {(problem: Error) => void} complain
 */
export function makeDownload(link, path, name, complain) {
  link.href = BASE + path;
  link.download = name;
  link.onclick = async (event) => {
    if (!hasToken()) return;
    event.preventDefault();
    try {
      const { blob } = await picture(path);
      const url = URL.createObjectURL(blob);
      const save = document.createElement("a");
      save.href = url;
      save.download = name;
      save.click();
      setTimeout(() => URL.revokeObjectURL(url), 60_000);
    } catch (problem) {
      complain(problem);
    }
  };
}

/**
 * The events in a stream of text: call with each chunk.
 * @param {(name: string, data: string) => void} onEvent
 * @param {{ last: string | null }} seen
 */
function eventParser(onEvent, seen) {
  let rest = "";
  /** @type {{ name: string, data: string[] }} */
  let event = { name: "message", data: [] };
  return (/** @type {string} */ chunk) => {
    const lines = (rest + chunk).split(/\r\n|\n|\r(?!$)/);
    rest = lines.pop() ?? "";
    for (const line of lines) {
      if (line === "") {
        if (event.data.length) onEvent(event.name, event.data.join("\n"));
        event = { name: "message", data: [] };
        continue;
      }
      const [, key, value] = /^([^:]*):? ?(.*)$/.exec(line) ?? [];
      if (key === "event") event.name = value;
      else if (key === "data") event.data.push(value);
      else if (key === "id") seen.last = value;
    }
  };
}

/**
 * Listens to an event stream until the signal fires, connecting again whenever it ends or falls silent. Own parsing,
 * since EventSource cannot send a token. `on.event(name, value)`, `on.heard()` for anything at all, `on.open()`,
 * `on.lost(problem)`; a 4xx answer ends it, as it would come again. `silence` is how long nothing may come, in ms. With
 * `rest` a hidden page lets go of its connection: a browser has few for each host, and STOP must never wait for one.
 * @param {string} path
 * @param {{ event?: (name: string, value: any) => void, heard?: () => void, open?: () => void, lost?: (problem: Problem | null) => void }} on
 * @param {{ signal: AbortSignal, silence?: number, rest?: boolean }} options
 */
export async function listen(path, on, { signal, silence = 25_000, rest = false }) {
  const seen = { last: /** @type {string | null} */ (null) };
  while (!signal.aborted) {
    if (rest && document.hidden) await comesToFront(signal);
    const attempt = new AbortController();
    const end = () => attempt.abort();
    signal.addEventListener("abort", end, { once: true });
    if (rest) document.addEventListener("visibilitychange", end, { signal: attempt.signal });
    let watchdog = setTimeout(end, silence);
    let problem = null;
    try {
      const headers = { Accept: "text/event-stream", ...(seen.last === null ? {} : { "Last-Event-ID": seen.last }) };
      const response = await send(path, { headers, signal: attempt.signal });
      on.open?.();
      const feed = eventParser((name, data) => deliver(on, name, data), seen);
      const reader = /** @type {ReadableStream<Uint8Array>} */ (response.body).pipeThrough(new TextDecoderStream()).getReader();
      for (let part = await reader.read(); !part.done; part = await reader.read()) {
        clearTimeout(watchdog);
        watchdog = setTimeout(end, silence);
        on.heard?.();
        feed(part.value);
      }
    } catch (error) {
      problem = error instanceof Problem ? error : null;
    } finally {
      clearTimeout(watchdog);
      signal.removeEventListener("abort", end);
      // Also ends the listener above, and a stream whose reading failed half-way.
      attempt.abort();
    }
    if (signal.aborted) return;
    on.lost?.(problem);
    const { status = 0 } = problem ?? {};
    if (status >= 400 && status < 500 && status !== 429) return;
    await pause(1000, signal);
  }
}

function comesToFront(signal) {
  return new Promise((resolve) => {
    signal.addEventListener("abort", resolve, { once: true });
    document.addEventListener("visibilitychange", resolve, { once: true, signal });
  });
}

function deliver(on, name, data) {
  try {
    on.event?.(name, JSON.parse(data));
  } catch (error) {
    // One bad event must not end the stream.
    console.error(`event ${name} could not be used`, error);
  }
}
