// #/calibration: the calibrations of the bench; #/calibration/KIND: the steps of a new one; #/calibration/ID: one in detail.

import { get, makeDownload } from "./api.js";
import { facts, h, panel } from "./dom.js";
import { complain } from "./feedback.js";
import { bytes, duration, moment, plain } from "./format.js";
import { orientationWizard } from "./calibrationoffset.js";
import { referenceWizard } from "./calibrationsteps.js";
import { age, drafts, KINDS, reportOfReference, valuesOf } from "./references.js";
import { onReturn } from "./service.js";
import { discard } from "./trash.js";

/** Values that sessions use without a calibration of a kind. */
const WITHOUT = {
  camera: "Sessions use the noise that the camera’s driver states.",
  flat: "Uneven light remains in intensities.",
  analyser: "The zero of the stage and an ideal polarizer are assumed.",
  retarder: "An ideal quarter-wave film at 45° is assumed.",
  orientation: "Orientations are relative, with one unknown offset.",
};

/**
 * Shows the page until the signal fires.
 * @param {HTMLElement} main
 * @param {Visit} visit
 */
export async function calibrationPage(main, { id: address, signal }) {
  const [id, query = ""] = address.split("?");
  if (!id) return overview(main, signal);
  if (!KINDS[id]) return detail(main, id, signal);
  main.append(h("div", { class: "head" }, h("h1", { class: "grow" }, `Calibrate: ${KINDS[id][0].toLowerCase()}`), h("a", { class: "button", href: "#/calibration" }, "All calibrations")));
  await (id === "orientation" ? orientationWizard : referenceWizard)(main, id, new URLSearchParams(query), signal);
}

/**
 * @param {HTMLElement} main
 * @param {AbortSignal} signal
 */
async function overview(main, signal) {
  const problems = h("div", { class: "stack" });
  const lead = h("p", { class: "soft lead" });
  const body = h("div", { class: "stack" });
  main.append(h("div", { class: "head" }, h("h1", { class: "grow" }, "Calibration"), h("a", { class: "button", href: "#/calibrate" }, "Geometry, light and panel")), h("div", { class: "stack" }, lead, problems, body));

  async function load() {
    /** @type {CalibrationList} */
    const { items, problems: unread, max_age_days: days } = await get("/calibrations", { signal });
    lead.textContent = `Each session uses the newest calibration of each kind that applies to the bench and is at most ${days} days old. Calibrate in the order of this list.`;
    problems.replaceChildren(...unread.map((text) => h("p", { class: "message", "data-tone": "warn" }, text)));
    const rows = await Promise.all(Object.keys(KINDS).map(async (kind) => {
      const own = items.filter((one) => one.kind === kind);
      const present = own.find((one) => one.applies) ?? own[0];
      // Lists have no reports; some standard deviations are in the report only.
      const full = present && (await get(`/calibrations/${present.id}`, { signal }));
      return row(kind, full, own.filter((one) => one !== present), load);
    }));
    body.replaceChildren(...rows);
  }
  await load();
  onReturn(load, signal);
}

/**
 * One kind with its present calibration and older ones.
 * @param {string} kind
 * @param {Reference | undefined} present
 * @param {Reference[]} older
 * @param {() => unknown} changed
 */
function row(kind, present, older, changed) {
  const [title, about] = KINDS[kind];
  const draft = drafts.read(kind);
  const lamp = h("span", { class: "lamp", "data-tone": present?.applies ? "good" : "warn" }, !present ? "missing" : present.applies ? "in use" : "not in use");
  const start = h("a", { class: present?.applies ? "button" : "button primary", "data-calibrate": kind, href: `#/calibration/${kind}${draft && `?${draft}`}` }, draft ? "Continue" : "Calibrate");
  return h("section", { class: "panel reference", "aria-label": title, "data-kind": kind },
    h("div", { class: "about" }, h("h2", {}, title), h("p", { class: "soft" }, about), lamp),
    present ? h("div", { class: "stack" }, present.reason && h("p", { class: "message", "data-tone": "warn" }, sentence(present.reason)), valuesOf(kind, present.values[kind], present.report))
      : h("p", { class: "soft" }, `Not calibrated. ${WITHOUT[kind]}`),
    h("div", {}, present && facts([["Name", present.name], ["Photographs", moment(present.taken)], ["Age", age(present.age_days)], ["Devices", present.devices.join(", ")]])),
    h("div", { class: "row does" }, start, present && tools(present, changed)),
    older.length > 0 && h("details", { class: "older" }, h("summary", {}, `${older.length} other${older.length === 1 ? "" : "s"}`),
      h("ul", { class: "stack" }, older.map((one) => h("li", { class: "row" }, h("span", {}, one.name || "Unnamed"), h("span", { class: "soft" }, `${moment(one.taken)} · ${age(one.age_days)} · ${one.devices.join(", ")}${one.reason ? ` · ${one.reason}` : ""}`), tools(one, changed))))));
}

const sentence = (/** @type {string} */ text) => `${text[0].toUpperCase()}${text.slice(1)}${text.endsWith(".") ? "" : "."}`;
const nameOf = (/** @type {Reference} */ one) => one.name || `${KINDS[one.kind][0]} of ${moment(one.taken)}`;

/** @param {Reference} one @param {() => unknown} changed */
function tools(one, changed) {
  const name = nameOf(one);
  return [h("a", { class: "button", href: `#/calibration/${one.id}`, "aria-label": `Report of ${name}` }, "Report"),
    h("button", { type: "button", class: "quiet danger", "aria-label": `Delete ${name}`, onclick: () => discard(`/calibrations/${one.id}`, { id: one.id, name }, changed) }, "Delete")];
}

/**
 * Conditions of the photographs, as far as they are known.
 * @param {Reference} one
 * @returns {[string, Child][]}
 */
function conditionsOf({ conditions: { exposure_s, gain, average, wavelength_nm, region, mounting } }) {
  const set = Object.entries(mounting ?? {}).map(([key, value]) => `${key.replace(/_deg$/, "").replaceAll("_", " ")} ${value}${key.endsWith("_deg") ? "°" : ""}`);
  return [["Exposure", exposure_s && duration(exposure_s)], ["Gain", gain && plain(gain)], ["Average", average > 1 && `${average} frames`],
    ["Wavelength", wavelength_nm && `${plain(wavelength_nm)} nm`], ["Region", region && region.join(", ")], ["Mounting", set.join(", ")]];
}

/**
 * @param {HTMLElement} main
 * @param {string} id
 * @param {AbortSignal} signal
 */
async function detail(main, id, signal) {
  /** @type {[Reference, { name: string, bytes: number }[]]} */
  const [one, files] = await Promise.all([get(`/calibrations/${id}`, { signal }), get(`/calibrations/${id}/files`, { signal })]);
  const [title] = KINDS[one.kind];
  document.title = `${nameOf(one)} · Nacre`;
  const links = files.map(({ name, bytes: size }) => {
    const link = h("a", { title: bytes(size) }, name);
    makeDownload(link, `/calibrations/${id}/files/${encodeURIComponent(name)}`, `${id}-${name}`, complain);
    return link;
  });
  const back = () => (location.hash = "#/calibration");
  const from = one.reconstruction ?? one.session;
  main.append(h("div", { class: "head" }, h("h1", { class: "grow" }, nameOf(one)),
    from && h("a", { class: "button", href: `#/result/${from}` }, "Result"), one.session && h("a", { class: "button", href: `#/session/${one.session}` }, "Session"),
    h("button", { type: "button", class: "quiet danger", onclick: () => discard(`/calibrations/${id}`, { id, name: nameOf(one) }, back) }, "Delete")),
    h("div", { class: "columns result" },
      panel("Values", h("span", { class: "lamp", "data-tone": one.applies ? "good" : "warn" }, one.applies ? "applies to the bench" : "does not apply"), h("div", { class: "stack" },
        one.reason && h("p", { class: "message", "data-tone": "warn" }, sentence(one.reason)), valuesOf(one.kind, one.values[one.kind], one.report), h("p", { class: "row downloads" }, h("span", { class: "soft" }, "Download"), links))),
      h("div", { class: "stack" },
        panel("Report", null, reportOfReference(one.report)),
        panel("Origin", null, facts([["Kind", title], ["Photographs", moment(one.taken)], ["Age", age(one.age_days)], ["Devices", one.devices.join(", ")], ["Notes", one.notes],
          ...conditionsOf(one), ["Program", one.software], ["Id", h("code", {}, one.id)]])))));
}
