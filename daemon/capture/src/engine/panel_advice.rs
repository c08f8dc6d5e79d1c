//! Configuration advice derived from a measured panel.

use super::panel::PanelFound;
use nacre_drivers::display::kms::Tone;
use nacre_drivers::display::{DisplayConfig, DisplayDriver};

/// Tone curve that a panel already applies, if any.
pub fn drawn_by(display: &DisplayConfig) -> Option<&Tone> {
    match &display.driver {
        DisplayDriver::Kms(settings) => Some(&settings.tone),
        _ => None,
    }
}

impl PanelFound {
    /// Tone curve for a panel driver that can apply one.
    pub fn tone(&self) -> Tone {
        self.law.tone(&self.luminances)
    }

    /// Settings for the panel, as lines of a configuration or of plans.
    pub fn advice(&self, display: Option<&DisplayConfig>) -> Vec<String> {
        let (found, tone) = (self, &self.tone());
        let mut lines = vec![];
        match (display.map(|d| &d.driver), tone) {
            (Some(DisplayDriver::Kms(_)), Tone::Gamma(gamma)) => {
                lines.push(format!("[bench.display] driver: tone = {{ gamma = {gamma} }}"));
            }
            (Some(DisplayDriver::Kms(_)), Tone::Measured(levels)) => {
                let levels: Vec<String> = levels.iter().map(f64::to_string).collect();
                lines.push(format!("[bench.display] driver: tone = {{ measured = [{}] }}", levels.join(", ")));
            }
            (_, tone) => {
                lines.push(format!("plans: spots.fringes.gamma = {:.3}", found.law.gamma));
                if matches!(tone, Tone::Measured(_)) {
                    lines.push(
                        "fringes on this panel are no cosines: choose its sRGB or gamma preset, then measure again"
                            .into(),
                    );
                }
            }
        }
        if found.late_frames > 0 {
            let more = (found.late_ms + 1.0).ceil();
            let now = display.map_or_else(String::new, |d| format!(", now {} ms", d.response_ms));
            lines.push(format!(
            "{} frames came too early, the last at most {:.0} ms after the panel had said that it shows the pattern: [bench.display] response_ms{now}: \
             add {more}",
            found.late_frames, found.late_ms
        ));
        }
        if found.drift > 0.01 {
            lines.push(
                "panel or camera drift: let the panel warm up, switch dynamic contrast off, then measure again".into(),
            );
        }
        lines
    }
}
