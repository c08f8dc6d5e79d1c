// Points picked on a photograph: corners of a sheet, or opposite corners of a rectangle.

import { h, pen, say } from "./dom.js";

const COLORS = ["#ffb000", "#fe6100", "#dc267f", "#648fff"];

/**
 * A picture on which up to `count` points are picked, by pointer or by keys (arrows move the last one, Enter sets one in the middle).
 * `points()` are in pixels of the photograph, centres at integers. `names` are what the points are.
 */
export function picker(names, changed = () => {}) {
  const canvas = h("canvas", { tabindex: 0, role: "img", width: 1, height: 1 });
  const said = h("p", { class: "soft", role: "status", "aria-live": "polite" });
  const again = h("button", { type: "button", class: "quiet", onclick: () => set([]) }, "Pick again");
  const element = h("div", { class: "stack", hidden: true }, h("div", { class: "well picker" }, canvas), h("div", { class: "row" }, said, again));
  let picture = null;
  let points = [];
  let held = -1;

  /** Shows a photograph, or none where the browser cannot draw it. */
  async function show(file) {
    picture = file && (await createImageBitmap(file).catch(() => null));
    element.hidden = !picture;
    if (!picture) return;
    canvas.width = picture.width;
    canvas.height = picture.height;
    set([]);
  }

  function set(next) {
    points = next;
    paint();
    changed();
  }

  function paint() {
    if (!picture) return;
    const context = pen(canvas);
    const size = Math.max(picture.width, picture.height) / 60;
    context.drawImage(picture, 0, 0);
    context.lineWidth = Math.max(1, size / 6);
    points.forEach(([x, y], k) => {
      context.strokeStyle = context.fillStyle = COLORS[k % COLORS.length];
      context.beginPath();
      context.arc(x + 0.5, y + 0.5, size / 2, 0, 2 * Math.PI);
      context.moveTo(x + 0.5 - size, y + 0.5);
      context.lineTo(x + 0.5 + size, y + 0.5);
      context.moveTo(x + 0.5, y + 0.5 - size);
      context.lineTo(x + 0.5, y + 0.5 + size);
      context.stroke();
      context.font = `${1.6 * size}px sans-serif`;
      context.fillText(String(k + 1), x + size, y - size / 2);
    });
    const next = names[points.length];
    say(said, next ? `Now: ${next} (or none of them)` : `${points.length} picked; drag to correct`);
    canvas.setAttribute("aria-label", `Photograph, ${points.length} of ${names.length} points picked. ${next ? `Next: ${next}` : ""}`);
    again.hidden = points.length === 0;
  }

  /** Place of the pointer in the photograph. */
  function at(event) {
    const box = canvas.getBoundingClientRect();
    return [((event.clientX - box.left) / box.width) * canvas.width - 0.5, ((event.clientY - box.top) / box.height) * canvas.height - 0.5];
  }

  canvas.addEventListener("pointerdown", (event) => {
    const [x, y] = at(event);
    const near = points.findIndex((p) => Math.hypot(p[0] - x, p[1] - y) < canvas.width / 30);
    held = near >= 0 ? near : points.length < names.length ? points.push([x, y]) - 1 : -1;
    if (held < 0) return;
    canvas.setPointerCapture(event.pointerId);
    set(points);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (held < 0) return;
    points[held] = at(event);
    set(points);
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => (held = -1));
  canvas.addEventListener("keydown", (event) => {
    const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    const step = steps[event.key];
    if (event.key === "Enter" && points.length < names.length) set([...points, [canvas.width / 2, canvas.height / 2]]);
    else if (step && points.length) set([...points.slice(0, -1), points.at(-1).map((v, k) => v + step[k] * (event.shiftKey ? 20 : 1))]);
    else return;
    event.preventDefault();
  });
  return { element, show, points: () => points };
}
