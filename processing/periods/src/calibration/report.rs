//! Report of a calibration.

use schemars::JsonSchema;
use serde::Serialize;

/// Accuracy of a geometry; standard deviations are in the geometry itself.
#[derive(Clone, Debug, Default, PartialEq, Serialize, JsonSchema)]
#[schemars(rename = "CalibrationErrors")]
pub struct Report {
    /// Root mean square reprojection error over all photographs of the board, in px.
    pub rms_px: Option<f64>,
    /// Each photograph of the board.
    pub photographs: Vec<PhotographReport>,
    /// Root mean square reprojection error of the board on the sample, in px.
    pub sample_rms_px: Option<f64>,
    /// Root mean square reprojection error of the board on the panel, in px.
    pub panel_rms_px: Option<f64>,
    /// Reduced χ² of the highlights, expected to be 1.
    pub light_chi2: Option<f64>,
    /// Limitations of the result.
    pub warnings: Vec<String>,
}

/// A photograph of the board.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct PhotographReport {
    /// File name.
    pub file: String,
    /// Root mean square reprojection error in px.
    pub rms_px: Option<f64>,
    /// Reason for rejection.
    pub unused_because: Option<String>,
}
