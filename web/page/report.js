// What the report says about a result, in the order in which it matters.

import { facts, figures, h } from "./dom.js";
import { count, degrees, duration, fixed, percent, words } from "./format.js";

/** Warnings, the figures that count, and the rest as facts. */
export function reportView(report) {
  const { pixels = {}, noise, circle, seconds = {} } = report;
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
      ["Fit", pixels.correlation_mean && `${fixed(pixels.correlation_mean, 5)} mean correlation`],
      ["Bias of the model", circle && (circle.bias_deg === null ? "cannot be told" : degrees(circle.bias_deg))],
      ["Modulation varies", circle && `by ${percent(circle.spread)}; noise explains ${percent(circle.spread_of_noise)}`],
      ["Not in view", circle && `${fixed(circle.gap_deg, 0)}° of the half turn`],
      ["Noise", noise && words(noise.source)],
      ["Offset", degrees(report.offset_deg)],
      ["Analyser", report.analyser_deg && `${report.analyser_deg.length} angles: ${report.analyser_deg.slice(0, 24).map((a) => fixed(a, Number.isInteger(a) ? 0 : 1)).join(", ")}${report.analyser_deg.length > 24 ? " …" : ""}`],
      ["Condition", report.condition && `${fixed(report.condition, 3)} (√2 at best)`],
      ["Size", `${report.width} × ${report.height}`],
      ["Took", seconds.total && `${duration(seconds.total)}: reading and fitting ${duration(seconds.read_and_fit)}, solving ${duration(seconds.solve)}, writing ${duration(seconds.write)}`],
    ]));
}
