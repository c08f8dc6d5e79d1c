//! What is done about shifts.

use super::{Registration, Shift};
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

impl std::str::FromStr for Align {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => Ok(Self::Auto),
            "off" => Ok(Self::Off),
            _ => Err(format!("{text:?} is neither auto nor off")),
        }
    }
}

/// How far the photographs are shifted against each other.
#[derive(Clone, Debug, Serialize)]
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

impl From<Registration> for Alignment {
    fn from(registration: Registration) -> Self {
        match registration {
            Registration::Told(shifts) => {
                let sigma = shifts.iter().map(|s| s.sigma).fold(0.0, f64::max);
                let square = |s: &Shift| s.dx * s.dx + s.dy * s.dy;
                let rms = (shifts.iter().map(square).sum::<f64>() / shifts.len().max(1) as f64).sqrt();
                Self {
                    shifts_px: shifts.iter().map(|s| [s.dx, s.dy]).collect(),
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
