//! What is done about shifts.

use super::Registration;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Root mean square shift in pixels from which moving photographs back gains more at edges than resampling them costs, and
/// how many standard deviations it must have.
const WORTH_PX: f64 = 0.05;
const WORTH_SIGMA: f64 = 3.0;

/// Whether photographs that are shifted against each other are moved back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Align {
    /// Where the shifts are worth it.
    #[default]
    Auto,
    /// Never; the shifts are told all the same.
    Off,
}

/// How far the photographs are shifted against each other.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct Alignment {
    /// Where each photograph's content lies against the mean of all, in pixels right and down; empty when it cannot be told.
    pub shifts_px: Vec<[f64; 2]>,
    /// Largest standard deviation of a shift.
    pub sigma_px: Option<f64>,
    /// The photographs were moved back: the shifts are worth it.
    pub corrected: bool,
    /// Why shifts cannot be told.
    pub doubt: Option<String>,
}

impl Alignment {
    /// Root mean square shift in pixels at which photographs are left, beyond what noise has of it; 0 where they were moved back, or nothing is
    /// known.
    pub fn left_px(&self) -> f64 {
        let sigma = self.sigma_px.unwrap_or(0.0);
        let square = mean_square(&self.shifts_px) - 2.0 * sigma * sigma;
        if self.corrected { 0.0 } else { square.max(0.0).sqrt() }
    }

    /// Whether photographs are left that should be moved back.
    pub fn is_left(&self) -> bool {
        let left = self.left_px();
        left > WORTH_PX && left > WORTH_SIGMA * self.sigma_px.unwrap_or(0.0)
    }

    /// What to say where photographs are left that should be moved back.
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

    /// Shifts that are left are told, less what noise has of them; those that were undone, or are not worth it, are not.
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
