//! The numbers behind a picture, as CSV.

use super::{Axis, Summary};
use nacre_base::text::csv_field;
use std::fmt::Write;

/// One line per setting and scene; missing values are empty fields. The header gives units in brackets.
pub(super) fn csv(summary: &Summary) -> String {
    let with = |name: &str, axis: &Axis| match axis.unit.as_str() {
        "" => name.to_owned(),
        unit => format!("{name} [{unit}]"),
    };
    let (knob, stress) = (with("knob", &summary.knob), with("stress", &summary.stress));
    let [error_median, error_q1, error_q3, predicted] =
        ["error_median", "error_q1", "error_q3", "predicted"].map(|name| with(name, &summary.error));
    // The cost column counts photographs where the study does.
    let time = if summary.time.unit.is_empty() { summary.time.name.replace(' ', "_") } else { "time".into() };
    let [time_median, time_q1, time_q3] =
        ["median", "q1", "q3"].map(|name| with(&format!("{time}_{name}"), &summary.time));
    let header = [
        "method",
        "setting",
        &knob,
        "default",
        "scene",
        &stress,
        "runs",
        &error_median,
        &error_q1,
        &error_q3,
        &time_median,
        &time_q1,
        &time_q3,
        "masked",
        "confidently_wrong",
        &predicted,
        "on_front",
    ];
    let mut text = header.map(csv_field).join(",");
    text.push('\n');
    let optional = |v: Option<f64>| v.map_or(String::new(), |v| v.to_string());
    for p in &summary.points {
        let (setting, scene) = (&summary.settings[p.setting], &summary.scenes[p.scene]);
        let error = |pick: fn(&super::Quartiles) -> f64| optional(p.error.as_ref().map(pick));
        let _ = writeln!(
            text,
            "{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}",
            csv_field(&setting.method),
            csv_field(&setting.label),
            setting.value,
            setting.default,
            csv_field(&scene.label),
            scene.value,
            p.runs,
            error(|e| e.median),
            error(|e| e.q1),
            error(|e| e.q3),
            p.seconds.median,
            p.seconds.q1,
            p.seconds.q3,
            p.masked,
            p.wrong,
            optional(p.predicted),
            p.front
        );
    }
    text
}
