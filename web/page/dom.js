// Building and changing elements. Text is always set as text, never parsed as HTML.

const SVG = "http://www.w3.org/2000/svg";

/**
 * @template {Element} E
 * @param {E} element
 * @param {Attributes | null | undefined} attributes
 * @param {Child[]} children
 */
function fill(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes ?? {})) {
    if (value === null || value === undefined || value === false) continue;
    if (typeof value === "function") element.addEventListener(name.slice(2), value);
    else if (name === "value" || name === "checked" || name === "disabled") element[name] = value;
    // The content security policy forbids attributes of style.
    else if (name === "style") /** @type {any} */ (element).style.cssText = value;
    else element.setAttribute(name, value === true ? "" : String(value));
  }
  const shown = /** @type {(Node | string)[]} */ (/** @type {unknown[]} */ (children).flat(Infinity));
  element.append(...shown.filter((c) => c !== null && c !== undefined && /** @type {unknown} */ (c) !== false));
  return element;
}

/**
 * An HTML element: attributes by name, listeners as `onclick` and so on, then children.
 * @template {keyof HTMLElementTagNameMap} K
 * @param {K} tag
 * @param {Attributes | null} [attributes]
 * @param {...Child} children
 * @returns {HTMLElementTagNameMap[K]}
 */
export function h(tag, attributes, ...children) {
  return fill(document.createElement(tag), attributes, children);
}

/**
 * An SVG element.
 * @template {keyof SVGElementTagNameMap} K
 * @param {K} tag
 * @param {Attributes | null} [attributes]
 * @param {...Child} children
 * @returns {SVGElementTagNameMap[K]}
 */
export function svg(tag, attributes, ...children) {
  return fill(document.createElementNS(SVG, tag), attributes, children);
}

/**
 * Sets text only where it changed, so that live regions do not repeat themselves.
 * @param {Element} element
 * @param {string} text
 */
export function say(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/**
 * A panel with a heading and, to its right, whatever belongs to it as a whole.
 * @param {string} title
 * @param {Child} aside
 * @param {...Child} children
 */
export function panel(title, aside, ...children) {
  return h("section", { class: "panel", "aria-label": title }, h("header", {}, h("h2", {}, title), aside), ...children);
}

/**
 * A part that scrolls when its content is large; the keyboard reaches it.
 * @param {string} label
 * @param {...Child} children
 */
export const scrolling = (label, ...children) => h("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": label }, ...children);

let fields = 0;

/**
 * A labelled input. `control` gets an id if it has none; `hint` says what is expected.
 * @param {string} label
 * @param {HTMLElement} control
 * @param {{ hint?: string | false | null, wide?: boolean }} options
 */
export function field(label, control, { hint, wide } = {}) {
  // Of several controls, the first one has the label.
  const input = /** @type {HTMLElement} */ ((control.matches("div") && control.querySelector("input, select, textarea")) || control);
  input.id ||= `field-${++fields}`;
  const note = hint && h("small", { id: `${input.id}-hint` }, hint);
  if (note) input.setAttribute("aria-describedby", note.id);
  return h("div", { class: wide ? "field wide" : "field" }, h("label", { for: input.id }, label), control, note);
}

/**
 * A number input that takes any decimal.
 * @param {Attributes} attributes
 */
export function number(attributes) {
  return h("input", { type: "number", step: "any", inputmode: "decimal", ...attributes });
}

/**
 * A check box with its label; `box` is the check box itself.
 * @param {string} label
 * @param {Attributes} attributes
 */
export function check(label, attributes) {
  const box = h("input", { type: "checkbox", ...attributes });
  return Object.assign(h("label", { class: "check" }, box, h("span", {}, label)), { box });
}

/**
 * A drop-down list; options are [value, label].
 * @param {string[][]} options
 * @param {string} value
 * @param {Attributes} [attributes]
 */
export function select(options, value, attributes) {
  const list = h("select", attributes, options.map(([v, label]) => h("option", { value: v }, label)));
  list.value = value;
  return list;
}

/**
 * A choice of one among few, as a row of buttons; arrow keys move within it as radio buttons do.
 * @param {string} label
 * @param {string[][]} options
 * @param {string} value
 * @param {(key: string) => void} onchange
 */
export function segments(label, options, value, onchange) {
  const buttons = options.map(([key, text]) =>
    h("button", { type: "button", role: "radio", "data-key": key, onclick: () => choose(key) }, text));
  const group = h("div", { class: "segments", role: "radiogroup", "aria-label": label, onkeydown: move }, buttons);
  function mark(key) {
    for (const button of buttons) {
      const on = button.dataset.key === key;
      button.setAttribute("aria-checked", String(on));
      button.tabIndex = on ? 0 : -1;
    }
  }
  function choose(key) {
    mark(key);
    onchange(key);
  }
  function move(event) {
    const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
    if (!step) return;
    event.preventDefault();
    const next = buttons[(buttons.findIndex((b) => b === document.activeElement) + step + buttons.length) % buttons.length];
    next.focus();
    choose(next.dataset.key);
  }
  mark(value);
  return Object.assign(group, { mark });
}

/**
 * A list of facts; pairs without a value are left out.
 * @param {[string, Child][]} pairs
 */
export function facts(pairs) {
  const given = pairs.filter(([, value]) => value !== null && value !== undefined && value !== "");
  return h("dl", { class: "facts" }, given.map(([name, value]) => [h("dt", {}, name), h("dd", {}, value)]));
}

/**
 * Numbers that matter most, large. Values are elements or text.
 * @param {[Child, Child][]} pairs
 */
export function figures(pairs) {
  return h("div", { class: "figures" }, pairs.map(([name, value]) => h("div", {}, h("strong", {}, value), h("span", {}, name))));
}

/**
 * Resolves after so many milliseconds, or at once when the signal fires.
 * @param {number} ms
 * @param {AbortSignal} [signal]
 * @returns {Promise<void>}
 */
export function pause(ms, signal) {
  return new Promise((resolve) => {
    const timer = setTimeout(resolve, ms);
    signal?.addEventListener("abort", () => (clearTimeout(timer), resolve()), { once: true });
  });
}

const signals = /** @type {Signals} */ (/** @type {unknown} */ (AbortSignal));
/** A signal that fires with the first of several. */
export const firstOf = (/** @type {AbortSignal[]} */ ...several) => signals.any(several);
/** A signal that fires after so many milliseconds. */
export const after = (/** @type {number} */ ms) => signals.timeout(ms);

/**
 * Calls once things have been quiet for a while.
 * @template {unknown[]} T
 * @param {number} ms
 * @param {(...values: T) => unknown} call
 * @returns {(...values: T) => void}
 */
export function settle(ms, call) {
  let timer = 0;
  return (...values) => {
    clearTimeout(timer);
    timer = setTimeout(() => call(...values), ms);
  };
}

/** What draws on a canvas. */
export const pen = (/** @type {HTMLCanvasElement} */ canvas) => /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));

/**
 * The part of an element that is there for sure.
 * @param {ParentNode} whole
 * @param {string} selector
 */
export function part(whole, selector) {
  const found = whole.querySelector(selector);
  if (!(found instanceof HTMLElement)) throw new Error(`${selector} is not there`);
  return found;
}

/** A random word; `crypto.randomUUID` is missing on plain-HTTP addresses other than loopback. */
export function randomId() {
  return Array.from(crypto.getRandomValues(new Uint8Array(16)), (b) => b.toString(16).padStart(2, "0")).join("");
}

/** Puts a blob into a file. */
export function save(blob, name) {
  const url = URL.createObjectURL(blob);
  h("a", { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 60_000);
}
