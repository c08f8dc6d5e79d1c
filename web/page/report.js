// What the report says about a result, in the order in which it matters.

import { facts, figures, h, scrolling } from "./dom.js";
import { count, degrees, duration, fixed, percent, significant, words } from "./format.js";

/** Warnings, the figures that count, and the rest as facts. */
export function reportView(report) {
  const { pixels = {}, noise, circle, models = [], seconds = {}, smoothing, period, error, repeats, registration } = report;
  const moved = registration?.corrected && Math.max(...registration.shifts_px.map(([x, y]) => Math.hypot(x, y)));
  const plain = report.model === "plain";
  const term = (deg) => (deg === null ? "unknown" : degrees(deg, 3));
  const share = (n) => (n === undefined ? null : `${percent(n / pixels.all, 2)} (${count(n)})`);
  const warnings = report.warnings ?? [];
  return h("div", { class: "stack" },
    warnings.length
      ? h("ul", { class: "problems" }, warnings.map((w) => h("li", { class: "message", "data-tone": "warn" }, w)))
      : h("p", { class: "message", "data-tone": "good" }, "No warnings."),
    figures([
      ["expected error", report.error_estimate_deg === null ? "unknown" : degrees(report.error_estimate_deg)],
      ["σ, median", degrees(pixels.sigma_median_deg)],
      ["σ, 90 % below", degrees(pixels.sigma_p90_deg)],
      ["of pixels valid", percent(pixels.valid / pixels.all, 1)],
    ]),
    facts([
      ["Model", words(report.model)],
      ["Reason", report.model_reason],
      ["Saturated", share(pixels.saturated)],
      ["Too little modulation", share(pixels.too_little_modulation)],
      ["Metal without a grating", pixels.without_grating ? share(pixels.without_grating) : null],
      ["Fit", pixels.correlation_mean && `${fixed(pixels.correlation_mean, 5)} mean correlation`],
      ["Error by noise", error && term(error.noise_deg)],
      ["By analyser angles", error && term(error.angle_deg) + (error.angle_sigma_deg === null ? "" : `; ${error.angle_source === "corrected" ? "corrected to" : "error of an angle"} ${degrees(error.angle_sigma_deg, 3)}`)],
      ["By registration", error && term(error.registration_deg) + (moved ? `; photographs were moved back by up to ${fixed(moved, 2)} px` : "")],
      ["By the model", plain ? null : error && term(error.model_deg)],
      ["Repeats", repeats && `${repeats.pairs} pairs; halves differ by ${degrees(repeats.difference_deg, 3)}, σ says ${degrees(repeats.expected_deg, 3)} (reduced χ² ${fixed(repeats.chi2, 2)})`],
      ["Bias of the model", circle && (circle.bias_deg === null ? "cannot be told" : degrees(circle.bias_deg))],
      ["Modulation varies", circle && `by ${percent(circle.spread)}; noise explains ${percent(circle.spread_of_noise)}`],
      ["Not in view", circle && `${fixed(circle.gap_deg, 0)}° of the half turn`],
      ["Smoothing", !smoothing || smoothing.strength === "none" ? null : `${smoothing.strength}, ${smoothing.rounds} rounds; ${smoothing.map ? "of the map and its σ" : "of pictures only"}`],
      ["Period, median", period?.median_um && `${fixed(period.median_um, 3)} µm, ${period.heuristic ? "heuristic" : "for the assumed surface"}`],
      ["σ of the period", period?.sigma_median_um && `${significant(period.sigma_median_um, 2)} µm, from noise alone`],
      ["Periods told apart", period?.unique_um?.length && `${period.unique_um.map(([a, b]) => `${fixed(a, 2)}–${fixed(b, 2)}`).join(", ")} µm`],
      ["Period ambiguous", period && share(period.ambiguous)],
      ["Noise", noise && words(noise.source)],
      ["Offset", plain ? null : degrees(report.offset_deg)],
      ["Analyser", report.analyser_deg && `${report.analyser_deg.length} angles: ${report.analyser_deg.slice(0, 24).map((a) => fixed(a, Number.isInteger(a) ? 0 : 1)).join(", ")}${report.analyser_deg.length > 24 ? " …" : ""}`],
      ["Condition", report.condition && `${fixed(report.condition, 3)} (√2 at best)`],
      ["Size", `${report.width} × ${report.height}`],
      ["Took", seconds.total && `${duration(seconds.total)}: reading and fitting ${duration(seconds.read_and_fit)}, solving ${duration(seconds.solve)}, writing ${duration(seconds.write)}`],
    ]),
    models.length ? modelTable(models) : null);
}

/** All models that were compared. */
function modelTable(models) {
  const film = (m) => m.film && `r ${fixed(m.film.r, 3)}, ζ ${fixed(m.film.zeta_deg, 1)}°, Δn ${fixed(m.film.retardance_deg, 2)}°, axis ${fixed(m.film.axis_deg, 1)}°${m.film.front > 0 ? `, front ${fixed(m.film.front, 3)}` : ""}`;
  const center = (m) => m.center && `centre ${m.center.map((v) => fixed(v, 4)).join(", ")}`;
  return scrolling("Models", h("table", {},
    h("caption", {}, "Models, simplest first: how much less likely than the best, how far the points lie off it, and how its orientations differ"),
    h("thead", {}, h("tr", {}, ["Model", "Behind", "Scatter / noise", "Differs by", "Found"].map((t) => h("th", { scope: "col" }, t)))),
    h("tbody", {}, models.map((m) => h("tr", {},
      h("th", { scope: "row" }, m.model), h("td", {}, fixed(m.behind, 0)), h("td", {}, fixed(m.scatter, 2)),
      h("td", {}, degrees(m.difference_deg)), h("td", {}, film(m) ?? center(m) ?? ""))))));
}
