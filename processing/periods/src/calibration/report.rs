//! What a calibration says of itself.

use schemars::JsonSchema;
use serde::Serialize;

/// How good a geometry is; standard deviations are in the geometry.
#[derive(Clone, Debug, Default, PartialEq, Serialize, JsonSchema)]
#[schemars(rename = "CalibrationErrors")]
pub struct Report {
    /// Root mean square distance from corner to model over all photographs of the board, in px.
    pub rms_px: Option<f64>,
    /// Each photograph of the board.
    pub photographs: Vec<PhotographReport>,
    /// The same of what lies on the sample.
    pub sample_rms_px: Option<f64>,
    /// The same of the board that the panel shows.
    pub panel_rms_px: Option<f64>,
    /// Misfit of the highlights per degree of freedom; 1 is as expected.
    pub light_chi2: Option<f64>,
    /// What to beware of.
    pub warnings: Vec<String>,
}

/// A photograph of the board.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct PhotographReport {
    /// Its name.
    pub file: String,
    /// Root mean square distance from corner to model, in px.
    pub rms_px: Option<f64>,
    /// Why it could not be used.
    pub unused_because: Option<String>,
}
