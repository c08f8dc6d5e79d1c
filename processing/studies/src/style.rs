//! Colours and marks of methods and settings.

use super::Summary;

/// Colours of Okabe and Ito without yellow, which is invisible on white; distinguishable with all common forms of
/// colour blindness.
const METHODS: [&str; 7] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#333333"];

/// Colours for the settings of one method. Darker means more, so that the order is visible without colour.
const RAMP: [&str; 6] = ["#e8a33a", "#dd6f4d", "#bd4576", "#8a2f8f", "#54278f", "#1f1a5c"];

/// Fraction of confidently wrong pixels from which a point is ringed.
pub(super) const WRONG: f64 = 0.01;

/// Methods of a study, in the order of their first setting.
pub(super) fn methods(summary: &Summary) -> Vec<&str> {
    let mut names: Vec<&str> = vec![];
    for setting in &summary.settings {
        if !names.contains(&setting.method.as_str()) {
            names.push(&setting.method);
        }
    }
    names
}

/// Colour of a setting: that of its method, or of the ramp if there is only one method. Settings of a method that are
/// drawn together go from light to dark.
pub(super) fn color(summary: &Summary, setting: usize) -> String {
    if methods(summary).len() > 1 || summary.settings.len() == 1 {
        let (base, together) = (method_color(summary, setting), beside(summary, setting));
        return match together.iter().position(|s| *s == setting) {
            Some(k) if together.len() > 1 => shade(&base, k as f64 / (together.len() - 1) as f64),
            _ => base,
        };
    }
    let last = (summary.settings.len() - 1).max(1);
    RAMP[(setting * (RAMP.len() - 1) + last / 2) / last].into()
}

/// Colour of a setting's method in a study of several methods.
pub(super) fn method_color(summary: &Summary, setting: usize) -> String {
    let at = methods(summary).iter().position(|m| *m == summary.settings[setting].method).unwrap_or(0);
    METHODS[at % METHODS.len()].into()
}

/// Settings of the same method that are drawn in the sweep.
fn beside(summary: &Summary, setting: usize) -> Vec<usize> {
    let method = &summary.settings[setting].method;
    (0..summary.settings.len())
        .filter(|s| summary.settings[*s].in_sweep && summary.settings[*s].method == *method)
        .collect()
}

/// A colour (`#rrggbb`), lightened at 0, darkened at 1.
fn shade(color: &str, dark: f64) -> String {
    let (towards, share) =
        if dark < 0.5 { (255.0, 0.45 * (1.0 - 2.0 * dark)) } else { (0.0, 0.45 * (2.0 * dark - 1.0)) };
    let part = |k: usize| {
        let value = u8::from_str_radix(color.get(1 + 2 * k..3 + 2 * k).unwrap_or("00"), 16).unwrap_or(0);
        (f64::from(value) * (1.0 - share) + towards * share).round() as u8
    };
    format!("#{:02x}{:02x}{:02x}", part(0), part(1), part(2))
}

/// Label of a setting beside its curve: the method's name if it has one setting, otherwise the setting's. The method is
/// added if another curve has the same label.
pub(super) fn label(summary: &Summary, setting: usize) -> String {
    let own = &summary.settings[setting];
    if methods(summary).len() < 2 {
        return own.label.clone();
    }
    let alone = |method: &str| summary.settings.iter().filter(|s| s.method == method).count() < 2;
    if alone(&own.method) {
        return own.method.clone();
    }
    let same = |s: &super::Setting| s.in_sweep && s.label == own.label && s.method != own.method && !alone(&s.method);
    if summary.settings.iter().any(same) { format!("{}, {}", own.method, own.label) } else { own.label.clone() }
}

/// Mark shape of a setting, to distinguish methods in black and white.
pub(super) fn shape(summary: &Summary, setting: usize) -> usize {
    methods(summary).iter().position(|m| *m == summary.settings[setting].method).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shades_go_from_light_to_dark() {
        assert_eq!([0.0, 0.5, 1.0].map(|d| shade("#0072b2", d)), ["#73b1d5", "#0072b2", "#003f62"]);
    }

    /// Settings of one method that are drawn together differ in colour and in label.
    #[test]
    fn every_curve_is_distinguishable() {
        for study in crate::polarimetry::studies(crate::Effort::Quick) {
            let summary = crate::summarize(&study, &crate::Plan::new(1, "test"), &[]);
            let shown: Vec<usize> = (0..study.settings.len()).filter(|s| study.settings[*s].in_sweep).collect();
            for (i, a) in shown.iter().enumerate() {
                for b in &shown[i + 1..] {
                    assert_ne!(label(&summary, *a), label(&summary, *b), "{}", study.name);
                    assert_ne!(color(&summary, *a), color(&summary, *b), "{}", study.name);
                }
            }
        }
    }
}
