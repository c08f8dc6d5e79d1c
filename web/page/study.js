// A study that `nacre chart` has measured: time against error with its front, and error against the scenes' difficulty.

import { facts, field, h, select, svg } from "./dom.js";
import { count, percent, plain, significant } from "./format.js";

const [WIDTH, HEIGHT] = [460, 300];
const [LEFT, RIGHT, TOP, BOTTOM] = [58, 12, 10, 42];
const SHAPES = ["M0-5.5A5.5 5.5 0 1 1 0 5.5A5.5 5.5 0 1 1 0-5.5Z", "M-5-5H5V5H-5Z", "M0-6.5L6 4.5H-6Z", "M0-6.5L6.5 0L0 6.5L-6.5 0Z"];
const COLORS = 4;
// Room right of the lines for what their settings are called.
const CALLED = 76;
// Share of confident errors from which a point is marked, as in the pictures.
const WRONG = 0.01;

const titleOf = ({ name, unit }) => (unit ? `${name} (${unit})` : name);

/** A ruler over values: where a value lies, and its marks. `names` are those of cases that are no numbers. */
function ruler({ scale, names = [] }, values, [from, to]) {
  const known = values.filter((v) => Number.isFinite(v) && (scale !== "log" || v > 0));
  const of = scale === "log" ? Math.log10 : (v) => v;
  let [low, high] = [Math.min(...known.map(of)), Math.max(...known.map(of))];
  if (!known.length) [low, high] = [0, 1];
  const room = Math.max(0.06 * (high - low), scale === "log" ? 0.08 : 1e-9 + 0.05 * Math.abs(high));
  [low, high] = [low - room, high + room];
  const at = (value) => from + ((of(value) - low) / (high - low)) * (to - from);
  if (scale === "names") return { at, marks: names.map((label, k) => [k, label]) };
  if (scale !== "log") {
    const power = 10 ** Math.floor(Math.log10((high - low) / 4));
    const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= (high - low) / 5) ?? 10 * power;
    const first = Math.ceil(low / step);
    return { at, marks: Array.from({ length: Math.floor(high / step) - first + 1 }, (_, k) => [(first + k) * step, plain((first + k) * step)]) };
  }
  const decades = Array.from({ length: Math.ceil(high) - Math.floor(low) + 1 }, (_, k) => Math.floor(low) + k);
  const factors = high - low > 2.5 ? [1] : high - low > 0.9 ? [1, 2, 5] : [1, 1.5, 2, 3, 4, 5, 6, 8];
  const marks = decades.flatMap((d) => factors.map((f) => f * 10 ** d)).filter((v) => of(v) >= low && of(v) <= high);
  return { at, marks: marks.map((v) => [v, v >= 1e4 || v < 1e-3 ? v.toExponential(0).replace("e+", "e") : plain(v)]) };
}

/** Axes with their marks and titles. */
function axes(x, y, xTitle, yTitle) {
  return svg("g", { "aria-hidden": "true" },
    x.marks.map(([v, text]) => [svg("line", { class: "grid", x1: x.at(v), x2: x.at(v), y1: TOP, y2: HEIGHT - BOTTOM }),
      svg("text", { x: x.at(v), y: HEIGHT - BOTTOM + 16, "text-anchor": "middle" }, text)]),
    y.marks.map(([v, text]) => [svg("line", { class: "grid", x1: LEFT, x2: WIDTH - RIGHT, y1: y.at(v), y2: y.at(v) }),
      svg("text", { x: LEFT - 6, y: y.at(v) + 4, "text-anchor": "end" }, text)]),
    svg("text", { x: (LEFT + WIDTH - RIGHT) / 2, y: HEIGHT - 6, "text-anchor": "middle" }, xTitle),
    svg("text", { transform: `translate(13 ${(TOP + HEIGHT - BOTTOM) / 2}) rotate(-90)`, "text-anchor": "middle" }, yTitle));
}

/** The interactive charts of a study, from its JSON. */
export function studyView(study) {
  const methods = [...new Set(study.settings.map((s) => s.method))];
  const look = ({ setting }) => methods.indexOf(study.settings[setting].method);
  const sceneName = (k) => study.scenes[k].label || `${plain(study.scenes[k].value)} ${study.stress.unit}`.trim();
  const all = study.points.filter((p) => p.error);
  const detail = h("div", { class: "detail", "aria-live": "polite" }, h("p", { class: "soft" }, "Choose a point: click it, or Tab to a chart and move with the arrow keys."));
  const [trade, sweep] = [h("div", {}), h("div", {})];
  const sweepInk = new Map(study.settings.flatMap((s, k) => (s.in_sweep ? [k] : [])).map((k, place) => [k, place % COLORS]));

  /** Marks that are one stop of the Tab key together; arrows go from one to the next. */
  function marks(points, at, ink) {
    const made = points.map((point, k) => {
      const setting = study.settings[point.setting];
      const words = `${setting.method}, ${setting.label}, ${sceneName(point.scene)}: ${titleOf(study.error)} ${significant(point.error.median)}, ${significant(point.seconds.median)} s`;
      const [x, y] = at(point);
      const mark = svg("g", { class: "mark", role: "button", tabindex: k ? -1 : 0, "aria-label": words, "data-ink": ink(point), transform: `translate(${x} ${y})`, onclick: () => choose(k), onkeydown: (event) => move(event, k) },
        svg("circle", { class: "reach", r: 14 }), point.wrong > WRONG && svg("circle", { class: "alarm", r: 10 }),
        svg("path", { class: point.masked > 0.5 ? "shape hollow" : "shape", d: SHAPES[look(point) % SHAPES.length] }), svg("title", {}, words));
      return mark;
    });
    function choose(k) {
      made.forEach((mark, other) => {
        mark.setAttribute("tabindex", other === k ? "0" : "-1");
        mark.classList.toggle("chosen", other === k);
      });
      tell(points[k]);
    }
    function move(event, k) {
      const to = { ArrowRight: k + 1, ArrowDown: k + 1, ArrowLeft: k - 1, ArrowUp: k - 1, Home: 0, End: made.length - 1, Enter: k, " ": k }[event.key];
      if (to === undefined) return;
      event.preventDefault();
      const next = (to + made.length) % made.length;
      made[next].focus();
      choose(next);
    }
    return made;
  }

  function tell(point) {
    const setting = study.settings[point.setting];
    const spread = (q, unit) => `${significant(q.median)} ${unit} (quartiles ${significant(q.q1)} to ${significant(q.q3)})`;
    detail.replaceChildren(h("h3", {}, `${setting.method}: ${setting.label}`), facts([
      [titleOf(study.knob), `${plain(setting.value)}${setting.default ? ", what the program does unless asked" : ""}`],
      [titleOf(study.stress), sceneName(point.scene)],
      [study.error.name, spread(point.error, study.error.unit)],
      [study.time.name, spread(point.seconds, study.time.unit)],
      [study.predicted || "Expected", point.predicted === null ? "" : `${significant(point.predicted)} ${study.error.unit}`],
      ["Masked", percent(point.masked)],
      ["Wrong and confident", percent(point.wrong)],
      ["Runs", count(point.runs)],
      ["Pareto front", point.front ? "On it: nothing is both faster and better" : "Off it"],
    ]));
  }

  const polyline = (points, at, attributes) => svg("polyline", { ...attributes, points: points.map((p) => at(p).join()).join(" ") });

  function paintTrade(scene) {
    const points = all.filter((p) => p.scene === scene).sort((a, b) => a.seconds.median - b.seconds.median);
    const x = ruler(study.time, points.map((p) => p.seconds.median), [LEFT, WIDTH - RIGHT]);
    const y = ruler(study.error, points.map((p) => p.error.median), [HEIGHT - BOTTOM, TOP]);
    const at = (p) => [x.at(p.seconds.median), y.at(p.error.median)];
    const bars = points.map((p) => {
      const [px, py] = at(p);
      const ends = [p.error.q1, p.error.q3].map((v) => (study.error.scale === "log" && v <= 0 ? py : y.at(v)));
      return svg("line", { class: "spread", x1: px, x2: px, y1: ends[0], y2: ends[1] });
    });
    trade.replaceChildren(svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "chart study", role: "group", "aria-label": `${study.title}: ${study.error.name} against ${study.time.name}` },
      axes(x, y, titleOf(study.time), titleOf(study.error)), bars,
      polyline(points.filter((p) => p.front), at, { class: "front" }), marks(points, at, (p) => look(p) % COLORS)));
  }

  /** The setting's name right of its line. */
  function called(k, points, at) {
    if (!points.length) return null;
    const [x, y] = at(points.at(-1));
    return svg("text", { x: x + 10, y: y + 4 }, study.settings[k].label);
  }

  function paintSweep() {
    const points = all.filter((p) => sweepInk.has(p.setting)).sort((a, b) => a.setting - b.setting || study.scenes[a.scene].value - study.scenes[b.scene].value);
    const stress = (p) => study.scenes[p.scene].value;
    const x = ruler({ ...study.stress, names: study.scenes.map((_, k) => sceneName(k)) }, points.map(stress), [LEFT, WIDTH - RIGHT - CALLED]);
    const y = ruler(study.error, points.flatMap((p) => [p.error.median, p.predicted ?? NaN]), [HEIGHT - BOTTOM, TOP]);
    const at = (p) => [x.at(stress(p)), y.at(p.error.median)];
    const ink = (p) => sweepInk.get(p.setting);
    const lines = [...sweepInk.keys()].flatMap((k) => {
      const of = points.filter((p) => p.setting === k);
      const told = of.filter((p) => p.predicted > 0);
      return [polyline(told, (p) => [x.at(stress(p)), y.at(p.predicted)], { class: "expected", "data-ink": sweepInk.get(k) }), polyline(of, at, { class: "line", "data-ink": sweepInk.get(k) }), called(k, of, at)];
    });
    sweep.replaceChildren(svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "chart study", role: "group", "aria-label": `${study.title}: ${study.error.name} against ${study.stress.name}` },
      axes(x, y, titleOf(study.stress), titleOf(study.error)), lines, marks(points, at, ink)));
  }

  const scenes = select(study.scenes.map((_, k) => [String(k), sceneName(k)]), String(study.reference), { onchange: (e) => paintTrade(Number(e.target.value)) });
  paintTrade(study.reference);
  paintSweep();
  const keys = h("p", { class: "row soft" }, methods.map((method, k) => h("span", { class: "row" },
    svg("svg", { viewBox: "-8 -8 16 16", width: 14, height: 14, class: "study", "aria-hidden": "true" }, svg("g", { class: "mark", "data-ink": k % COLORS }, svg("path", { class: "shape", d: SHAPES[k % SHAPES.length] }))), method)),
    h("span", {}, "thick line: nothing is both faster and better; ring: over 1 % wrong and confident; hollow: most is masked", study.predicted && `; dashed: ${study.predicted}`));
  return h("div", { class: "stack" }, h("div", { class: "studies" },
    h("figure", { class: "stack" }, h("figcaption", { class: "row between" }, h("h3", {}, "Speed against error"), field(`At ${study.stress.name}`, scenes)), trade),
    h("figure", { class: "stack" }, h("figcaption", {}, h("h3", {}, "Where it breaks")), sweep), detail), keys);
}
