// A second map over the first one: beyond a line that is moved, in turn with it, or as the difference of both.

import { get, query } from "./api.js";
import { movableLine } from "./comparing.js";
import { field, h, say, segments, select } from "./dom.js";
import { complain } from "./feedback.js";
import { moment } from "./format.js";
import { titleOf } from "./mapvalues.js";

const MODES = [["slider", "Slider"], ["blink", "Blink"], ["difference", "Difference"]];
/** Time that each map is shown in turn, in ms: slower than flashes that may harm. */
const TURN = 700;
/** Results that are offered. */
const MOST = 200;

/**
 * The choice of a second map. `changed()` is called when another picture is wanted, `chosen(choice)` with the map that
 * was chosen, null for none: the id of its result and its description.
 * @param {{ id: string, method: string, maps: MapInfo[], first: () => MapInfo, chosen: (choice: { id: string, info: MapInfo } | null) => void,
 *   changed: () => void, signal: AbortSignal }} options
 */
export function comparison({ id, method, maps, first, chosen, changed, signal }) {
  const state = { mode: "slider", split: 50, second: false, on: false };
  let timer = 0;
  const [left, right] = [h("span", { class: "called" }), h("span", { class: "called right" })];
  const line = movableLine({ id: "map-divider", within: () => over, split: () => state.split, signal, moved: (percent) => {
    state.split = percent;
    paint();
    changed();
  } });
  const over = h("div", { class: "comparing", hidden: true }, left, right, line);
  const list = h("select", { id: "compare-with", onchange: choose });
  const pause = h("button", { type: "button", id: "blink-pause", "aria-pressed": "false", onclick: () => { if (timer) stop(); else start(); } }, "Pause");
  const mode = segments("Comparison", MODES, state.mode, (key) => {
    state.mode = key;
    if (key === "blink" && !matchMedia("(prefers-reduced-motion: reduce)").matches) start();
    else stop();
    paint();
    changed();
  });
  const modes = h("div", { class: "row", hidden: true }, mode, pause);
  const element = h("div", { class: "row end compare" }, field("Compare with", list), modes);
  /** @type {Map<string, { id: string, info: MapInfo, name: string }>} */
  const offered = new Map();
  signal.addEventListener("abort", () => clearInterval(timer));

  function start() {
    clearInterval(timer);
    timer = setInterval(flip, TURN);
    pausePaint();
  }
  function stop() {
    clearInterval(timer);
    timer = 0;
    pausePaint();
  }
  function pausePaint() {
    say(pause, timer ? "Pause" : "Go on");
    pause.setAttribute("aria-pressed", String(!timer));
  }
  function flip() {
    state.second = !state.second;
    paint();
    changed();
  }

  function paint() {
    const name = offered.get(list.value)?.name ?? "";
    pause.hidden = state.mode !== "blink";
    over.hidden = !state.on;
    line.hidden = state.mode !== "slider";
    line.refresh(titleOf(first()), name);
    const names = { slider: [titleOf(first()), name], blink: state.second ? ["", name] : [titleOf(first()), ""], difference: [`${titleOf(first())} minus ${name}`, ""] }[state.mode] ?? [];
    [left, right].forEach((label, k) => {
      say(label, names[k]);
      label.hidden = !names[k];
      label.classList.toggle("alone", !names[1 - k]);
    });
  }

  /** @type {Promise<any[]> | null} Other results of the method, newest first. */
  let others = null;
  async function otherResults() {
    const [sessions, jobs] = await Promise.all(["/sessions", "/reconstructions"].map((path) => get(`${path}${query({ limit: MOST })}`, { signal })));
    const own = sessions.items.filter((s) => s.has_results && s.kind === method);
    const made = jobs.items.filter((j) => j.state === "done" && j.method === method);
    return [...made, ...own].filter((o) => o.id !== id);
  }

  /** Offers the maps of this result, and the same map of other results of this size. */
  async function offer() {
    const before = list.value;
    const info = first();
    offered.clear();
    const alike = (other) => other.width === info.width && other.height === info.height;
    for (const other of maps) if (other !== info && alike(other)) offered.set(`${id} ${other.name}`, { id, info: other, name: titleOf(other) });
    const here = [...offered].map(([key, { name }]) => h("option", { value: key }, name));
    const there = [];
    try {
      others ??= otherResults();
      for (const other of await others) {
        const key = `${other.id} ${info.name}`;
        offered.set(key, { id: other.id, info, name: other.name });
        there.push(h("option", { value: key }, `${other.name} · ${moment(other.created)}`));
      }
    } catch (problem) {
      others = null;
      complain(problem);
    }
    list.replaceChildren(h("option", { value: "" }, "Nothing"), h("optgroup", { label: "This result" }, here), ...(there.length ? [h("optgroup", { label: `${titleOf(info)} of other results` }, there)] : []));
    list.value = offered.has(before) ? before : "";
    if (list.value !== before) choose();
  }

  async function choose() {
    const choice = offered.get(list.value) ?? null;
    state.on = choice !== null;
    state.second = false;
    modes.hidden = !choice;
    if (!choice || state.mode !== "blink") stop();
    else start();
    try {
      // The same map of another result may be missing or have another size.
      if (choice && choice.id !== id) {
        const found = (await get(`/reconstructions/${choice.id}/maps`, { signal })).find((m) => m.name === choice.info.name);
        if (!found || found.width !== choice.info.width || found.height !== choice.info.height) {
          list.value = "";
          choose();
          return complain(Object.assign(new Error(`${choice.name} has no map ${titleOf(choice.info)} of this size.`), { title: "These results cannot be compared" }));
        }
        choice.info = found;
      }
    } catch (problem) {
      return complain(problem);
    }
    paint();
    chosen(choice);
  }

  return {
    element, over, state, offer, flip,
    /** Shows the names anew, as after a change of the first map. */
    refresh: paint,
  };
}
