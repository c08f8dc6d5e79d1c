//! Colours and marks of methods and settings.

use super::Summary;

/// Okabe and Ito's colours without the yellow, which is lost on white; told apart with every common colour blindness.
const METHODS: [&str; 7] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#333333"];

/// For settings of one method: darker is more, so that the order shows without colour.
const RAMP: [&str; 6] = ["#e8a33a", "#dd6f4d", "#bd4576", "#8a2f8f", "#54278f", "#1f1a5c"];

/// Share of confidently wrong pixels from which a point is ringed.
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

/// Colour of a setting: its method's, or its place on the ramp where there is but one method.
pub(super) fn color(summary: &Summary, setting: usize) -> &'static str {
    let methods = methods(summary);
    if methods.len() > 1 || summary.settings.len() == 1 {
        let at = methods.iter().position(|m| *m == summary.settings[setting].method).unwrap_or(0);
        return METHODS[at % METHODS.len()];
    }
    let last = (summary.settings.len() - 1).max(1);
    RAMP[(setting * (RAMP.len() - 1) + last / 2) / last]
}

/// Shape of a setting's marks, which tells methods apart in black and white.
pub(super) fn shape(summary: &Summary, setting: usize) -> usize {
    methods(summary).iter().position(|m| *m == summary.settings[setting].method).unwrap_or(0)
}
