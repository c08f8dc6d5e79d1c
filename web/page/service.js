// The state of service and devices, polled once a second and shared by header and pages.

import { get, reach } from "./api.js";
import { after, pause } from "./dom.js";

const PERIOD_MS = 1000;
/** Of how many periods the queue is read once. */
const QUEUE = 3;
const target = new EventTarget();

/** What is known now. `reachable` is null before the first answer; `problem` is why devices could not be read. */
/** @type {{ devices: Devices | null, jobs: Job[] | null, reachable: boolean | null, problem: Error & { remedy?: string } | null, since: number }} */
export const service = { devices: null, jobs: null, reachable: null, problem: null, since: 0 };

/**
 * Calls back now and at every change, until the signal fires.
 * @param {(now: typeof service) => void} call
 * @param {AbortSignal} [signal]
 */
export function watch(call, signal) {
  const listener = () => call(service);
  target.addEventListener("change", listener, { signal });
  listener();
}

/**
 * Calls back when the service can be reached again after it could not, until the signal fires.
 * @param {() => void} call
 * @param {AbortSignal} [signal]
 */
export function onReturn(call, signal) {
  target.addEventListener("return", call, { signal });
}

/**
 * Takes a devices document that a command answered with.
 * @param {Devices | null} devices
 */
export function accept(devices) {
  if (!devices?.stage) return;
  service.devices = devices;
  service.problem = null;
  target.dispatchEvent(new Event("change"));
}

reach.changed = (reachable) => {
  if (service.reachable === reachable) return;
  const returned = reachable && service.reachable === false;
  service.reachable = reachable;
  service.since = Date.now();
  target.dispatchEvent(new Event("change"));
  if (returned) target.dispatchEvent(new Event("return"));
};

/** Reads the devices now. */
export async function refresh() {
  try {
    accept(await get("/devices", { signal: after(5000) }));
  } catch (problem) {
    // A service that accepts connections and never answers is as good as gone.
    if (problem.name === "TimeoutError" || problem.name === "AbortError") return reach.changed(false);
    if (service.reachable) {
      service.problem = problem;
      target.dispatchEvent(new Event("change"));
    }
  }
}

/** Reads the jobs that run or wait now. */
export async function refreshJobs() {
  try {
    service.jobs = await get("/queue", { signal: after(5000) });
    target.dispatchEvent(new Event("change"));
  } catch {
    // Reading the devices says what is wrong.
  }
}

/** Polls for ever. */
export async function start() {
  for (let turn = 0; ; turn++) {
    await refresh();
    if (turn % QUEUE === 0 && !document.hidden) await refreshJobs();
    await pause(PERIOD_MS);
  }
}
