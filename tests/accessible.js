// What keeps people from using a page, as sentences: names, labels, headings, contrast, targets, ids, focus. Run within the page.
const problems = [];
const seen = (e) => e.checkVisibility({ checkOpacity: true, checkVisibilityCSS: true }) && e.getClientRects().length > 0;
const all = (css) => [...document.querySelectorAll(css)].filter(seen);
const where = (e) => `${e.tagName.toLowerCase()}${e.id ? `#${e.id}` : ""} "${(e.getAttribute("aria-label") ?? e.textContent).trim().slice(0, 40)}"`;

const nameOf = (e) => {
  const by = (e.getAttribute("aria-labelledby") ?? "").split(" ").filter(Boolean).map((id) => document.getElementById(id)?.textContent ?? "").join(" ");
  const labels = [...(e.labels ?? [])].map((l) => l.textContent).join(" ");
  // Hidden text is no part of a name. SVG elements have no innerText, so all of their text counts.
  const within = /^(INPUT|SELECT|TEXTAREA|CANVAS)$/.test(e.tagName) ? "" : [e.innerText ?? e.textContent, ...[...e.querySelectorAll("img")].map((i) => i.alt)].join("");
  return [by, e.getAttribute("aria-label"), labels, within, e.title].find((t) => t && t.trim()) ?? "";
};
const CONTROLS = "a[href], button, input, select, textarea, summary, [tabindex='0'], [role=button], [role=slider], [role=radio]";
for (const e of all(CONTROLS)) {
  if (!nameOf(e)) problems.push(`${where(e)} has no name`);
  if (/^(INPUT|SELECT|TEXTAREA)$/.test(e.tagName) && !e.labels.length && !e.getAttribute("aria-label")) problems.push(`${where(e)} has no label`);
}
for (const e of document.querySelectorAll("label[for]")) if (!document.getElementById(e.htmlFor)) problems.push(`${where(e)} is the label of nothing`);
for (const e of document.querySelectorAll("img")) if (!e.hasAttribute("alt")) problems.push(`a picture has no alt: ${e.src.slice(-40)}`);
for (const e of all("[role=img]")) if (!nameOf(e)) problems.push(`${where(e)} is a picture without a name`);

const levels = all("h1, h2, h3, h4").map((e) => Number(e.tagName[1]));
if (levels.filter((l) => l === 1).length !== 1) problems.push(`${levels.filter((l) => l === 1).length} headings of the first level`);
levels.forEach((level, k) => { if (k && level > levels[k - 1] + 1) problems.push(`a heading of level ${level} after one of level ${levels[k - 1]}`); });

const ids = [...document.querySelectorAll("[id]")].map((e) => e.id);
for (const id of new Set(ids.filter((id, k) => ids.indexOf(id) !== k))) problems.push(`the id ${id} occurs twice`);
for (const attribute of ["aria-describedby", "aria-labelledby", "aria-controls"]) {
  for (const e of document.querySelectorAll(`[${attribute}]`)) {
    for (const id of e.getAttribute(attribute).split(" ")) if (!document.getElementById(id)) problems.push(`${where(e)}: ${attribute} names ${id}, which is not there`);
  }
}

for (const e of document.querySelectorAll("div[aria-label], span[aria-label], p[aria-label]")) if (!e.hasAttribute("role")) problems.push(`${where(e)} has an aria-label, but no role`);
for (const e of all("*")) {
  const scrolls = (e.scrollHeight > e.clientHeight + 1 && /auto|scroll/.test(getComputedStyle(e).overflowY)) || (e.scrollWidth > e.clientWidth + 1 && /auto|scroll/.test(getComputedStyle(e).overflowX));
  if (scrolls && e !== document.documentElement && e.tabIndex < 0 && !e.querySelector("a[href], button:enabled, input:enabled, select:enabled, textarea, [tabindex='0']")) problems.push(`${where(e)} scrolls, but takes no focus`);
}
for (const e of all("body > :not(header, main, footer, nav, section[aria-label], script, noscript, .skip, .veil, dialog, [role])")) problems.push(`${where(e)} is outside of all landmarks`);
if (document.documentElement.scrollWidth > innerWidth) problems.push(`the page is ${document.documentElement.scrollWidth} pixels wide in a window of ${innerWidth}`);

// Colours are drawn and read back, so that every notation counts.
const context = Object.assign(document.createElement("canvas"), { width: 1, height: 1 }).getContext("2d", { willReadFrequently: true });
const rgba = (color) => {
  context.clearRect(0, 0, 1, 1);
  context.fillStyle = color;
  context.fillRect(0, 0, 1, 1);
  return [...context.getImageData(0, 0, 1, 1).data].map((v) => v / 255);
};
const over = (top, below) => [0, 1, 2].map((k) => top[k] * top[3] + below[k] * (1 - top[3]));
const behind = (e) => {
  if (!e) return [1, 1, 1];
  const color = rgba(getComputedStyle(e).backgroundColor);
  return color[3] === 1 ? color.slice(0, 3) : over(color, behind(e.parentElement));
};
const luminance = (rgb) => rgb.map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)).reduce((sum, v, k) => sum + v * [0.2126, 0.7152, 0.0722][k], 0);
const contrast = (a, b) => {
  const [high, low] = [luminance(a), luminance(b)].sort((x, y) => y - x);
  return (high + 0.05) / (low + 0.05);
};
const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
const judged = new Set();
while (texts.nextNode()) {
  const e = texts.currentNode.parentElement;
  if (!texts.currentNode.data.trim() || judged.has(e) || !seen(e) || e.closest("option, .sr, .skip, [disabled], noscript, script")) continue;
  judged.add(e);
  const style = getComputedStyle(e);
  const below = behind(e);
  const ink = rgba(e instanceof SVGElement ? style.fill : style.color);
  const found = contrast(over(ink, below), below);
  const large = parseFloat(style.fontSize) >= 24 || (parseFloat(style.fontSize) >= 18.66 && Number(style.fontWeight) >= 700);
  if (found < (large ? 3 : 4.5)) problems.push(`${where(e)}: contrast ${found.toFixed(2)}`);
}

// Targets of 24 pixels (WCAG 2.2, 2.5.8); links within text, and boxes whose label is the target, are excepted there. So are
// marks of a chart, whose places are values; they are as large where there is room.
for (const e of all("button, select, input, summary, [role=slider], [role=button]")) {
  if (e.ownerSVGElement && innerWidth < 600) continue;
  const target = (e.tagName === "INPUT" && (e.closest("label") ?? (e.matches(".sr") && e.labels[0]))) || e;
  const { width, height } = target.getBoundingClientRect();
  if (width < 23.5 || height < 23.5) problems.push(`${where(e)} is ${Math.round(width)} by ${Math.round(height)} pixels`);
}

// Whatever has the focus shows it by an outline or a line of its own.
for (const e of all(CONTROLS).filter((c) => c.tabIndex >= 0 && !c.disabled)) {
  const before = ["outlineStyle", "borderColor", "boxShadow"].map((k) => getComputedStyle(e)[k]).join();
  const inner = [...e.children].map((c) => getComputedStyle(c).stroke).join();
  e.focus({ preventScroll: true, focusVisible: true });
  if (document.activeElement !== e) problems.push(`${where(e)} takes no focus`);
  else if (before === ["outlineStyle", "borderColor", "boxShadow"].map((k) => getComputedStyle(e)[k]).join() && inner === [...e.children].map((c) => getComputedStyle(c).stroke).join()) problems.push(`${where(e)} does not show its focus`);
}
document.activeElement.blur();
return [problems, judged.size, all(CONTROLS).length];
