// Results by name: what sessions and reconstructions there are, in words.

import { get, query } from "./api.js";
import { moment, words } from "./format.js";

// Most of each kind that a list offers.
const MOST = 200;
// Methods whose results can be put under a light.
// Methods whose results hold orientations.
export const INSPECTED = ["polarization", "flash", "spots", "map"];
export const VIEWED = ["polarization", "flash", "spots", "map", "lut"];

/** Results of methods, those that can be put under a light by default, newest first: { id, title, about }. */
export async function viewable(signal, methods = VIEWED) {
  const [sessions, jobs] = await Promise.all(["/sessions", "/reconstructions"].map((path) => get(`${path}${query({ limit: MOST })}`, { signal })));
  const own = sessions.items.filter((s) => s.has_results && methods.includes(s.kind));
  const made = jobs.items.filter((j) => j.state === "done" && methods.includes(j.method));
  return [
    ...own.map((s) => ({ id: s.id, created: s.created, title: s.name, about: `session, ${moment(s.created)}` })),
    ...made.map((j) => ({ id: j.id, created: j.created, title: j.name, about: `${words(j.method)}, ${moment(j.created)}` })),
  ].sort((a, b) => b.created - a.created);
}
