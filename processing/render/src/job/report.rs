//! Reports: the prediction, the progress and the result of a rendering.

use super::spectral::SpectralReport;
use super::two_pass::EnvironmentReport;
use crate::material::Notes;
use serde::{Deserialize, Deserializer, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Predicted passes, noise and time.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Prediction {
    /// Passes that the error takes, or the samples allow.
    pub passes: usize,
    /// Error after them.
    pub noise: f64,
    /// Seconds that they take.
    pub seconds: f64,
}

/// Report of a finished rendering.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Method, in words.
    pub method: &'static str,
    /// The graphics card, or "processor".
    pub device: String,
    /// Pixels of a row, and rows.
    pub size: [usize; 2],
    /// Samples of a pixel, on average over those with light.
    pub samples: usize,
    /// Root mean square of the pixels' standard errors over the mean luminance.
    pub noise: f64,
    /// Error of the sums over orders and wavelengths, estimated with finer sums at some pixels: root mean square over their mean
    /// luminance.
    pub predicted_model_error: f64,
    /// The same, measured against much finer sums of more pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub measured_model_error: Option<f64>,
    /// The spectra, if they were asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spectral: Option<SpectralReport>,
    /// Prediction before the first pass.
    pub predicted: Prediction,
    /// How each material is computed.
    pub materials: BTreeMap<String, Notes>,
    /// Shapes whose tables two passes render under environments, or would.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub environments: Vec<EnvironmentReport>,
    /// Defaults that decide the picture and that the scene does not state.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub hints: Vec<String>,
    /// Warnings.
    pub warnings: Vec<String>,
    /// Assumptions of the model.
    pub assumptions: Vec<&'static str>,
    /// Seconds of everything.
    pub seconds: f64,
    /// Seconds of the passes.
    pub seconds_of_passes: f64,
    /// Files that were written.
    pub files: Vec<PathBuf>,
}

/// Progress of a rendering.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SoFar {
    /// Passes that are done.
    pub passes: usize,
    /// Passes that are expected, from how the noise falls.
    pub of: usize,
    /// Root mean square of the pixels' standard errors over the mean luminance; NaN (null in JSON) after one pass.
    #[serde(deserialize_with = "null_is_nan")]
    pub noise: f64,
    /// Seconds that the remaining passes take.
    pub seconds_left: f64,
}

fn null_is_nan<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    Option::deserialize(from).map(|number| number.unwrap_or(f64::NAN))
}
