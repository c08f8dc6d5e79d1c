// Results by name: what sessions and reconstructions there are, in words.

import { get, query } from "./api.js";
import { moment, words } from "./format.js";

// Most of each kind that a list offers.
const MOST = 200;
// Methods whose results can be put under a light.
export const VIEWED = ["polarization", "flash", "spots", "map", "lut"];

/** What a reconstruction was made of, in words, given the names of sessions by id. */
export const titled = (job, names) => names.get(job.session) ?? (job.session ? "Deleted session" : "Upload");

/** Names of the newest sessions by id. */
export const namesOf = (sessions) => new Map(sessions.map((s) => [s.id, s.name || s.sample || "Untitled"]));

/** Results that can be put under a light, newest first: { id, title, about }. */
export async function viewable(signal) {
  const [sessions, jobs] = await Promise.all(["/sessions", "/reconstructions"].map((path) => get(`${path}${query({ limit: MOST })}`, { signal })));
  const names = namesOf(sessions.items);
  const own = sessions.items.filter((s) => s.has_results && VIEWED.includes(s.kind));
  const made = jobs.items.filter((j) => j.state === "done" && VIEWED.includes(j.method));
  return [
    ...own.map((s) => ({ id: s.id, created: s.created, title: names.get(s.id), about: `session, ${moment(s.created)}` })),
    ...made.map((j) => ({ id: j.id, created: j.created, title: titled(j, names), about: `${words(j.method)}, ${moment(j.created)}` })),
  ].sort((a, b) => b.created - a.created);
}
