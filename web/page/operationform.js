// Forms of operations, made of the JSON Schema of their options: names, units, ranges, defaults and help are those of the command line.

import { get } from "./api.js";
import { check, field, h, number, select } from "./dom.js";

const UNITS = { nm: "nm", um: "µm", mm: "mm", m: "m", deg: "°", px: "pixels", s: "s", ms: "ms", days: "days", kib: "KiB", mib: "MiB" };
/** @type {Map<string, Offered>} */
const offered = new Map();

/** Reads the operations of the service, once. */
export async function loadOperations() {
  if (offered.size === 0) for (const operation of await get("/operations")) offered.set(operation.name, operation);
}

/** What an operation makes, in a few words: its title up to the first comma. */
export const titleOf = (/** @type {string} */ name) => (offered.get(name)?.title ?? name).split(",")[0];

/** A schema without references and without null; what stands beside a reference wins. */
function resolved(root, { $ref: reference, ...schema }) {
  if (reference) schema = { ...resolved(root, reference.slice(2).split("/").reduce((at, key) => at[key], root)), ...schema };
  if (Array.isArray(schema.type)) schema.type = schema.type.filter((type) => type !== "null")[0];
  for (const key of ["anyOf", "oneOf"]) {
    if (!schema[key]) continue;
    const all = schema[key].map((one) => resolved(root, one)).filter((one) => one.type !== "null");
    const { [key]: _, ...rest } = schema;
    schema = all.length === 1 ? { ...all[0], ...rest } : { ...rest, [key]: all };
  }
  return schema;
}

/** Words of a schema of nothing but words, and how they are shown. */
function wordsOf(schema) {
  if (schema.const !== undefined) return [[schema.const, spoken(String(schema.const))]];
  if (schema.enum) return schema.enum.map((word) => [word, spoken(String(word))]);
  const all = schema.oneOf?.map(wordsOf);
  return all?.every(Boolean) ? all.flat() : null;
}

const sentence = (text) => (text ?? "").split("\n\n")[0].replaceAll("\n", " ").replace(/\.$/, "");
const spoken = (key) => key.replaceAll("_", " ");

/** Name of an option with its unit. */
function labelOf(path) {
  const key = path.at(-1);
  const [, name, unit] = key.match(/^(.*)_([a-z]+)$/) ?? [];
  const whole = [...path.slice(0, -1).map(spoken), unit in UNITS ? spoken(name) : spoken(key)].join(": ");
  return whole.replace(/^./, (c) => c.toUpperCase()) + (unit in UNITS ? ` (${UNITS[unit]})` : "");
}

const finite = (input) => (Number.isFinite(input.valueAsNumber) ? input.valueAsNumber : undefined);
const limits = (schema) => ({ min: schema.minimum, max: schema.maximum, step: schema.type === "integer" ? 1 : "any" });

/** A control over one option, whose input has this id: its element, and `value()`, which is undefined for the default. `root` holds the definitions of the schema. */
function control(id, schema, given, root) {
  const usual = schema.default ?? null;
  if (schema.type === "boolean") {
    const box = h("input", { type: "checkbox", id, checked: given ?? usual ?? false });
    return { element: box, value: () => (box.checked === (usual ?? false) ? undefined : box.checked) };
  }
  const words = wordsOf(schema);
  if (words) {
    const list = select(usual === null && !schema.required ? [["", "default"], ...words] : words, given ?? usual ?? "", { id });
    return { element: list, value: () => (list.value === (usual ?? "") ? undefined : list.value) };
  }
  if (schema["x-file"] && (schema.properties || schema.anyOf)) return structureFile(id, given);
  if (schema.type === "number" || schema.type === "integer") {
    const input = number({ id, value: given ?? "", placeholder: usual ?? "", ...limits(schema) });
    return { element: input, value: () => finite(input) };
  }
  if (schema.type === "array" && schema.minItems && schema.minItems === schema.maxItems && schema.items.type !== "array") {
    const inputs = Array.from({ length: schema.minItems }, (_, k) =>
      number({ id: k ? `${id}-${k}` : id, "aria-label": `${id} ${k + 1}`, value: given?.[k] ?? "", placeholder: usual?.[k] ?? "", ...limits(schema.items) }));
    return {
      element: h("div", { class: "row numbers" }, inputs),
      value: () => {
        const values = inputs.map(finite);
        // One that is missing is for the service to refuse.
        return values.every((v) => v === undefined) ? undefined : values.map((v, k) => v ?? usual?.[k] ?? null);
      },
    };
  }
  return schema.oneOf ? variants(id, schema, given, root) : typed(id, schema, given);
}

/** Words, or names with a value or with a structure. */
function variants(id, schema, given, root) {
  const usual = schema.default ?? null;
  const all = schema.oneOf.flatMap((one) => {
    const words = wordsOf(one);
    if (words) return words.map(([name, label]) => ({ name, label, read: () => name, part: null }));
    const [tag, constant] = Object.entries(one.properties).find(([, inner]) => inner.const !== undefined) ?? [];
    if (tag) {
      const form = structure(`${id}-${constant.const}`, { ...one, properties: Object.fromEntries(Object.entries(one.properties).filter(([key]) => key !== tag)) }, given?.[tag] === constant.const ? given : {}, root);
      return [{ name: constant.const, label: spoken(constant.const), read: () => ({ [tag]: constant.const, ...form.value() }), part: form.element }];
    }
    const [name, property] = Object.entries(one.properties)[0];
    const inner = resolved(root, property);
    const [place, otherwise] = [`${id}-${name.replaceAll("_", "-")}`, usual?.[name] ?? one["x-bare"] ?? null];
    const part = inner.properties ? structure(place, inner, given?.[name], root) : control(place, { ...inner, default: otherwise }, given?.[name], root);
    return [{ name, label: spoken(name), read: () => ({ [name]: part.value() ?? otherwise }), part: part.element }];
  });
  const nameOf = (value) => (typeof value === "string" ? value : all.find(({ name }) => value && (name in value || Object.values(value).includes(name)))?.name);
  const list = select([...(usual === null && !schema.required ? [["", "default"]] : []), ...all.map(({ name, label }) => [name, label])], nameOf(given) ?? nameOf(usual) ?? (schema.required ? all[0].name : ""), { id, onchange: paint });
  function paint() {
    for (const { name, part } of all) if (part) part.hidden = name !== list.value;
  }
  paint();
  return {
    element: h("div", { class: "stack" }, list, all.map(({ part }) => part)),
    value: () => all.find(({ name }) => name === list.value)?.read(),
  };
}

/** A JSON file with a structure, which is read here. */
function structureFile(id, given) {
  let known = given ?? undefined;
  const input = h("input", { type: "file", id, accept: ".json", onchange: read });
  async function read() {
    const file = input.files?.[0];
    input.setCustomValidity("");
    known = given ?? undefined;
    try {
      if (file) known = JSON.parse(await file.text());
    } catch {
      input.setCustomValidity("This file is no JSON: give a geometry.json, as a calibration writes it");
      input.reportValidity();
    }
  }
  return { element: input, value: () => known };
}

/** A text: numbers with commas, a name, or JSON of what has no better control. */
function typed(id, schema, given) {
  const text = given === undefined || given === null ? "" : typeof given === "string" ? given : [given].flat(2).every((v) => typeof v === "number") ? [given].flat(2).join(", ") : JSON.stringify(given);
  const usual = schema.default ?? "";
  const input = h("input", { id, value: text, placeholder: typeof usual === "string" ? usual : JSON.stringify(usual), autocomplete: "off", spellcheck: "false" });
  const numbers = () => input.value.split(/[,;:\s]+/).filter(Boolean).map(Number);
  const examples = schema.examples && h("datalist", { id: `${id}-examples` }, schema.examples.map((value) => h("option", { value })));
  if (examples) input.setAttribute("list", examples.id);
  return {
    element: examples ? h("div", {}, input, examples) : input,
    value: () => {
      const typed = input.value.trim();
      if (typed === "") return undefined;
      if (schema.type === "string") return typed;
      if (/^[[{"]/.test(typed)) {
        try {
          return JSON.parse(typed);
        } catch {
          return typed;
        }
      }
      const list = numbers();
      if (!list.every(Number.isFinite)) return typed;
      const inner = schema.items?.minItems;
      if (inner) return Array.from({ length: Math.ceil(list.length / inner) }, (_, k) => list.slice(k * inner, (k + 1) * inner));
      return list.length === 1 && schema.type !== "array" ? list[0] : list;
    },
  };
}

/** All options of a structure, those marked as advanced folded away. `without` names options, such as `light`, that have controls of their own. */
function structure(id, schema, given, root, without = []) {
  const parts = [];
  // Structures whose name is no part of their options' labels.
  const inline = new Set();
  const add = (inner, values, path, folded = false) => {
    for (const [key, property] of Object.entries(inner.properties ?? {})) {
      const own = resolved(root, property);
      const place = [...path, key];
      if (without.includes(place.join("."))) continue;
      if (own.properties && !own["x-file"]) {
        if (own["x-inline"]) inline.add(key);
        add(own, values?.[key], place, folded || Boolean(own["x-advanced"]));
        continue;
      }
      const name = `${id}-${place.join("-").replaceAll("_", "-")}`;
      const required = (inner.required ?? []).includes(key) && path.length === 0;
      const made = control(name, { ...own, ...(own.items && { items: resolved(root, own.items) }), required }, values?.[key], root);
      const label = own.title ?? labelOf(place.filter((key) => !inline.has(key)));
      const element = own.type === "boolean" ? h("label", { class: "check", title: own.description }, made.element, h("span", {}, sentence(own.description)))
        : field(label, made.element, { hint: sentence(own.description) });
      parts.push({ place, value: made.value, element, advanced: folded || Boolean(own["x-advanced"]), wide: own.type === "boolean" });
    }
  };
  add(schema, given, []);
  const shown = (advanced) => {
    const some = parts.filter((part) => part.advanced === advanced);
    return [h("div", { class: "fields options" }, some.filter((p) => !p.wide).map((p) => p.element)), some.filter((p) => p.wide).map((p) => p.element)];
  };
  return {
    element: h("div", { class: "stack" }, shown(false), parts.some((p) => p.advanced) && h("details", {}, h("summary", {}, "More options"), h("div", { class: "stack" }, shown(true)))),
    value: () => {
      /** @type {Record<string, any>} */
      const options = {};
      for (const { place, value } of parts) {
        const given = value();
        if (given === undefined) continue;
        let at = options;
        for (const key of place.slice(0, -1)) at = at[key] ??= {};
        at[place.at(-1)] = given;
      }
      return options;
    },
  };
}

/**
 * The form of a structure in a schema whose definitions are in `root`; `value()` leaves out defaults.
 * @param {string} id
 * @param {any} schema
 * @param {Record<string, any>} given
 * @param {any} root
 * @param {string[]} [without]
 */
export const schemaForm = (id, schema, given, root, without) => structure(id, resolved(root, schema), given, root, without);

/**
 * The kinds of a tagged structure, by the word that its `type` has.
 * @returns {Map<string, any>}
 */
export function kindsOf(schema, root) {
  const kinds = resolved(root, schema).oneOf.map((/** @type {any} */ { properties: { type, ...properties }, ...kind }) => [type.const, { ...kind, properties }]);
  return new Map(kinds);
}

/**
 * The form of an operation, as an earlier one left it if there is one; `options()` is what the service takes.
 * @param {string} name
 * @param {Record<string, any>} [given]
 * @param {{ without?: string[] }} [more]
 */
export function operationForm(name, given = {}, more = {}) {
  const root = offered.get(name)?.options ?? { properties: {} };
  const form = structure(name, root, given, root, more.without);
  return { element: form.element, options: form.value };
}
