//! Correction of shifts between photographs.

use super::Registration;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Root mean square shift in pixels above which resampling gains more at edges than it costs, and its minimum in
/// standard deviations.
const WORTH_PX: f64 = 0.05;
const WORTH_SIGMA: f64 = 3.0;

/// Correction of shifts between photographs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Align {
    /// Resample the photographs if the shifts are significant.
    #[default]
    Auto,
    /// Never resample; shifts are reported only.
    Off,
}

/// Shifts between photographs.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct Alignment {
    /// Shift of each photograph against the mean of all, in pixels right and down; empty if unknown.
    pub shifts_px: Vec<[f64; 2]>,
    /// Largest standard deviation of a shift, in pixels.
    pub sigma_px: Option<f64>,
    /// Whether the photographs were resampled to correct the shifts.
    pub corrected: bool,
    /// Reason for which the shifts are unknown.
    pub doubt: Option<String>,
}

impl Alignment {
    /// Root mean square of the uncorrected shifts in pixels, less the contribution of noise; 0 if corrected or unknown.
    pub fn left_px(&self) -> f64 {
        let sigma = self.sigma_px.unwrap_or(0.0);
        let square = mean_square(&self.shifts_px) - 2.0 * sigma * sigma;
        if self.corrected { 0.0 } else { square.max(0.0).sqrt() }
    }

    /// Whether significant shifts are uncorrected.
    pub fn is_left(&self) -> bool {
        let left = self.left_px();
        left > WORTH_PX && left > WORTH_SIGMA * self.sigma_px.unwrap_or(0.0)
    }

    /// Warning about significant uncorrected shifts.
    pub fn warning(&self) -> Option<String> {
        self.is_left().then(|| {
            let left = self.left_px();
            format!(
                "photographs are shifted by {left:.2} pixels against each other (root mean square), and not moved back: at edges they show different \
                 places, which widens σ; --align auto moves them back"
            )
        })
    }
}

/// Mean square shift.
fn mean_square(shifts: &[[f64; 2]]) -> f64 {
    shifts.iter().map(|[x, y]| x * x + y * y).sum::<f64>() / shifts.len().max(1) as f64
}

impl From<Registration> for Alignment {
    fn from(registration: Registration) -> Self {
        match registration {
            Registration::Told(shifts) => {
                let sigma = shifts.iter().map(|s| s.sigma).fold(0.0, f64::max);
                let shifts_px: Vec<[f64; 2]> = shifts.iter().map(|s| [s.dx, s.dy]).collect();
                let rms = mean_square(&shifts_px).sqrt();
                Self {
                    shifts_px,
                    sigma_px: Some(sigma),
                    corrected: rms > WORTH_PX && rms > WORTH_SIGMA * sigma,
                    doubt: None,
                }
            }
            Registration::CannotTell(doubt) => {
                Self { shifts_px: vec![], sigma_px: None, corrected: false, doubt: Some(doubt.to_string()) }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Uncorrected shifts count, less their noise; corrected or insignificant ones do not.
    #[test]
    fn what_is_left_is_told() {
        let apart = |shift: f64, corrected| Alignment {
            shifts_px: vec![[shift, 0.0], [0.0, -shift]],
            sigma_px: Some(0.01),
            corrected,
            doubt: None,
        };
        assert!((apart(0.5, false).left_px() - (0.25_f64 - 2e-4).sqrt()).abs() < 1e-12);
        assert!(apart(0.5, false).warning().unwrap().contains("0.50 pixels"));
        assert_eq!(apart(0.5, true).left_px(), 0.0);
        assert_eq!((apart(0.02, false).warning(), apart(0.01, false).left_px()), (None, 0.0));
        let unknown = Alignment { shifts_px: vec![], sigma_px: None, ..apart(0.0, false) };
        assert_eq!((unknown.left_px(), unknown.warning()), (0.0, None));
    }
}
