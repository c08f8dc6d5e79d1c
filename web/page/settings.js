// #/settings: the configuration of the service, as a form and as TOML text.

import { get, post, send } from "./api.js";
import { facts, field, h, panel, say, scrolling, segments, settle } from "./dom.js";
import { complain, tell } from "./feedback.js";
import { schemaForm } from "./operationform.js";
import { onReturn } from "./service.js";

const ROLES = { view: "views", operate: "operates", administer: "administers" };
/** Sections of the form: their titles, and which keys have a control of their own. */
const SERVICE = ["version", "hosts", "tokens", "bench", "limits"];

/**
 * Shows the settings until the signal fires.
 * @param {HTMLElement} main
 * @param {Visit} visit
 */
export async function settingsPage(main, { signal }) {
  const [schema, first] = await Promise.all([get("/settings/schema", { signal }), read()]);
  let saved = first;
  /** What is edited: text and the values that it gives. */
  let draft = { text: saved.doc.text, values: saved.doc.values ?? {} };
  let way = saved.doc.values ? "form" : "text";

  const text = h("textarea", { id: "settings-text", class: "code tall", spellcheck: "false", autocomplete: "off", oninput: settle(400, () => review({ text: text.value })) });
  const form = h("div", { class: "stack" });
  const outcome = h("div", { class: "stack", id: "settings-outcome", role: "status", "aria-live": "polite" });
  const about = h("div", { class: "stack" });
  const checking = h("button", { type: "button", id: "settings-check", onclick: () => review(edited(), true) }, "Check");
  const saving = h("button", { type: "button", class: "primary", id: "settings-save", onclick: save }, "Save");
  const editor = h("div", { class: "stack" });
  const ways = segments("Edit as", [["form", "Form"], ["text", "TOML"]], way, change);
  main.append(h("div", { class: "head" }, h("h1", { class: "grow" }, "Settings"), checking, saving),
    h("div", { class: "columns planning" }, panel("Configuration", ways, editor),
      h("div", { class: "stack beside" }, panel("File", null, about), panel("Effects", null, outcome))));

  /** @type {() => Record<string, any>} */
  let values = () => draft.values;
  show();
  onReturn(() => say(checking, "Check"), signal);

  async function read() {
    const response = await send("/settings", { signal });
    /** @type {{ doc: SettingsDoc, etag: string }} */
    const found = { doc: await response.json(), etag: response.headers.get("ETag") ?? "" };
    return found;
  }

  /** What the open editor holds. */
  const edited = () => (way === "form" ? { text: draft.text, values: values() } : { text: text.value });

  async function change(/** @type {string} */ to) {
    const checked = await review(edited());
    if (to === "form" && !checked?.values) {
      ways.mark("text");
      return;
    }
    way = to;
    show();
  }

  /** Fills the open editor from the draft. */
  function show() {
    text.value = draft.text;
    editor.replaceChildren(way === "form" ? form : field("TOML text", text, { hint: "On the command line, nacre schema config describes all keys." }));
    if (way === "form") fillForm();
    paint(saved.doc);
  }

  function fillForm() {
    const given = draft.values;
    const { properties } = schema;
    const plain = { ...schema, properties: Object.fromEntries(Object.entries(properties).filter(([key]) => !SERVICE.includes(key))) };
    const service = schemaForm("service", plain, given, schema);
    const limits = schemaForm("limits", { ...schema, properties: { limits: { ...properties.limits, "x-inline": true } } }, given, schema);
    const bench = schemaForm("bench", { ...schema, properties: { bench: { ...properties.bench, "x-inline": true } } }, given, schema);
    const hosts = h("textarea", { id: "service-hosts", value: (given.hosts ?? []).join("\n"), spellcheck: "false" });
    let tokens = [...(given.tokens ?? [])];
    const list = h("ul", { class: "stack" });
    const paintTokens = () => list.replaceChildren(...tokens.map((token) => h("li", { class: "row" }, h("strong", {}, token.name), h("span", { class: "soft" }, ROLES[token.role] ?? token.role),
      h("button", { type: "button", class: "quiet danger", "aria-label": `Remove the token of ${token.name}`, onclick: () => {
        tokens = tokens.filter((one) => one !== token);
        paintTokens();
        later();
      } }, "Remove"))));
    paintTokens();
    form.replaceChildren(
      section("Service", service.element, field("Hosts", hosts, { hint: "Further names by which browsers reach the service, one a line. Behind a proxy that changes the port: the whole address of the page" })),
      section("Tokens", list, h("p", { class: "soft" }, tokens.length ? "" : "No token: only this machine reaches the service, and all its users may do everything. ", "To add a token, run ", h("code", {}, "nacre token NAME --role ROLE"), " and add the lines that it prints to the TOML text.")),
      section("Limits", limits.element), section("Bench", bench.element));
    values = () => {
      const names = hosts.value.split(/\s+/).filter(Boolean);
      return { ...(given.version !== undefined && { version: given.version }), ...service.value(), ...limits.value(), ...bench.value(), ...(names.length && { hosts: names }), ...(tokens.length && { tokens }) };
    };
  }
  const later = settle(400, () => review(edited()));
  form.addEventListener("input", later);
  form.addEventListener("change", later);

  /**
   * Checks what is edited, and shows its effects.
   * @param {{ text: string, values?: object }} edit
   * @param {boolean} [asked]
   */
  async function review(edit, asked = false) {
    try {
      /** @type {CheckedSettings} */
      const checked = await post("/settings/check", edit, { signal });
      draft = { text: checked.text, values: checked.values ?? draft.values };
      paint(checked, asked);
      return checked;
    } catch (problem) {
      if (asked || problem.status !== 400) complain(problem);
      else outcome.replaceChildren(message("bad", "This cannot be used", problem.message));
      return null;
    }
  }

  async function save() {
    const checked = await review(edited(), true);
    if (!checked || checked.problem) return;
    saving.disabled = true;
    try {
      const body = JSON.stringify({ text: checked.text });
      const response = await send("/settings", { method: "PUT", body, headers: { "Content-Type": "application/json", "If-Match": saved.etag }, signal });
      saved = { doc: await response.json(), etag: response.headers.get("ETag") ?? "" };
      draft = { text: saved.doc.text, values: saved.doc.values ?? {} };
      show();
      tell(saved.doc.backup ? `Saved. The file before is kept as ${saved.doc.backup}.` : "Saved.");
    } catch (problem) {
      complain(problem);
      if (problem.status === 412) outcome.prepend(h("p", {}, h("button", { type: "button", onclick: readAgain }, "Show the file as it is now")));
    } finally {
      saving.disabled = draft.text === saved.doc.text;
    }
  }

  async function readAgain() {
    try {
      saved = await read();
      draft = { text: saved.doc.text, values: saved.doc.values ?? {} };
      show();
    } catch (problem) {
      complain(problem);
    }
  }

  /**
   * Says how the text differs from the configuration in use.
   * @param {CheckedSettings} checked
   * @param {boolean} [asked]
   */
  function paint(checked, asked = false) {
    const { exists, file, overridden } = saved.doc;
    const changed = checked.text !== saved.doc.text;
    saving.disabled = !changed || Boolean(checked.problem);
    about.replaceChildren(facts([["Path", file], ["State", exists ? (changed ? "changed here, not saved" : "as shown") : "not there yet"]]),
      ...present([!exists && h("p", { class: "soft" }, "The service runs without a configuration file. “Save” makes this one; later starts read it with ", h("code", {}, `nacre serve --config ${file}`), "."),
      overridden.length > 0 && h("div", {}, h("h3", {}, "Overridden by the command line or the machine"), table(overridden, false))]));
    const now = checked.changes.filter((one) => one.at_once);
    const restart = checked.changes.filter((one) => !one.at_once);
    outcome.replaceChildren(...present([
      checked.problem && message("bad", "This cannot be used", checked.problem),
      asked && !checked.problem && message("good", "The configuration is valid", changed ? "It is not saved yet." : ""),
      now.length > 0 && h("div", {}, h("h3", {}, "When it is saved"), table(now, true)),
      restart.length > 0 && h("div", {}, h("h3", {}, "After a restart of the service"), table(restart, true)),
      !checked.problem && !checked.changes.length && h("p", { class: "soft" }, "Nothing differs from the configuration in use."),
    ]));
  }
}

/** Those of several parts that there are. */
const present = (/** @type {(Element | false | "" | null)[]} */ parts) => /** @type {Element[]} */ (parts.filter(Boolean));

const section = (/** @type {string} */ title, /** @type {Child[]} */ ...children) => h("fieldset", { class: "stack section" }, h("legend", {}, title), ...children);

const message = (/** @type {string} */ tone, /** @type {string} */ title, /** @type {string} */ said) => h("div", { class: "message", "data-tone": tone, role: tone === "bad" ? "alert" : null }, h("strong", {}, title), said);

/** Values of keys, as TOML would give them. */
const shown = (value) => (value === null ? "–" : typeof value === "string" ? value : JSON.stringify(value));

/**
 * @param {SettingsChange[]} changes
 * @param {boolean} fromText Whether the text gives the new values.
 */
function table(changes, fromText) {
  const row = ({ key, from, to }) => {
    const value = (one) => (key === "tokens" ? (one ?? []).map((token) => token.name).join(", ") || "–" : shown(one));
    return h("tr", {}, h("th", { scope: "row" }, h("code", {}, key)), h("td", {}, value(from)), h("td", {}, value(to)));
  };
  const heads = fromText ? ["In use", "New"] : ["File", "In use"];
  return scrolling(heads.join(", "), h("table", { class: "changes" }, h("thead", {}, h("tr", {}, ["Key", ...heads].map((head) => h("th", { scope: "col" }, head)))), h("tbody", {}, changes.map(row))));
}
