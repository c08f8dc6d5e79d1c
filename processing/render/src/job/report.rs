//! Reports: the prediction, the progress and the result of a rendering.

use super::spectral::SpectralReport;
use super::two_pass::EnvironmentReport;
use crate::material::Notes;
use nacre_base::operation::{Summary, lines};
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::PathBuf;

/// Predicted passes, noise and time.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct Prediction {
    /// Number of passes required by the target error, or permitted by the sample limit.
    pub passes: usize,
    /// Expected error after these passes.
    pub noise: f64,
    /// Expected time in s.
    pub seconds: f64,
}

/// Report of a finished rendering.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[schemars(rename = "RenderingReport")]
pub struct Report {
    /// Description of the method.
    pub method: &'static str,
    /// The graphics card, or "processor".
    pub device: String,
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// Samples per pixel, averaged over lit pixels.
    pub samples: usize,
    /// Root mean square of the pixels' standard errors, relative to the mean luminance.
    pub noise: f64,
    /// Truncation error of sums over orders and wavelengths, estimated with finer sums at some pixels: root mean square
    /// relative to their mean luminance.
    pub predicted_model_error: f64,
    /// Truncation error, measured against much finer sums at more pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub measured_model_error: Option<f64>,
    /// Properties of the spectra, if requested.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spectral: Option<SpectralReport>,
    /// Prediction before the first pass.
    pub predicted: Prediction,
    /// Method of each material.
    pub materials: BTreeMap<String, Notes>,
    /// Shapes whose tables are rendered, or could be rendered, by two passes under environments.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub environments: Vec<EnvironmentReport>,
    /// Defaults that determine the picture and are not stated in the scene.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub hints: Vec<String>,
    /// Warnings.
    pub warnings: Vec<String>,
    /// Assumptions of the model.
    pub assumptions: Vec<&'static str>,
    /// Total time in s.
    pub seconds: f64,
    /// Time of the passes in s.
    pub seconds_of_passes: f64,
    /// Written files.
    pub files: Vec<PathBuf>,
}

/// Progress of a rendering.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SoFar {
    /// Completed passes.
    pub passes: usize,
    /// Expected total number of passes, extrapolated from the noise.
    pub of: usize,
    /// Root mean square of the pixels' standard errors, relative to the mean luminance; NaN (null in JSON) after one
    /// pass.
    #[serde(deserialize_with = "null_is_nan")]
    pub noise: f64,
    /// Expected time of the remaining passes in s.
    pub seconds_left: f64,
}

fn null_is_nan<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    Option::deserialize(from).map(|number| number.unwrap_or(f64::NAN))
}

impl Summary for Report {
    fn summary(&self) -> String {
        let [width, height] = self.size;
        let mut text =
            format!("picture   {width} × {height} pixels, {} samples each, on {}", self.samples, self.device);
        for (name, notes) in &self.materials {
            let _ = write!(text, "\nmaterial  {name}: {}", notes.method);
        }
        for e in &self.environments {
            let _ = write!(text, "\nmethod    {}: {} ({})", e.shape, e.method, e.why);
            if e.method == "two-pass" {
                let rank: Vec<String> = e.rank.iter().map(ToString::to_string).collect();
                let [width, height] = e.environment;
                let _ = write!(
                    text,
                    "\n          rank {} ({:.2} % left out of the table), {} environments of {width} × {height}, views up to {:.0}°; error {:.2e} of the mean (measured)",
                    rank.join(" + "),
                    100.0 * e.table_error,
                    e.poles,
                    e.up_to_deg,
                    e.measured_error
                );
            }
        }
        for hint in &self.hints {
            let _ = write!(text, "\ndefault   {hint}");
        }
        let p = &self.predicted;
        let _ = write!(text, "\nquality   noise {:.2e} of the mean ({:.2e} expected)", self.noise, p.noise);
        let measured = self.measured_model_error.map_or("not measured".into(), |e| format!("{e:.2e} measured"));
        let _ = write!(text, "; sums off by {:.2e} predicted ({measured})", self.predicted_model_error);
        if let Some(s) = &self.spectral {
            let [from, to] = s.range_nm;
            let (bands, seconds) = (s.bands, s.seconds);
            let noise = s.noise.map_or("unknown noise".into(), |noise| format!("noise {noise:.2e} at most"));
            let _ = write!(text, "\nspectra   {bands} bands from {from} to {to} nm, {noise}, {seconds:.2} s");
        }
        let _ = write!(
            text,
            "\n{}time      {:.2} s ({:.2} expected of the passes, {:.2} taken)",
            lines(&[], &self.warnings),
            self.seconds,
            p.seconds,
            self.seconds_of_passes
        );
        for file in &self.files {
            let _ = write!(text, "\nwrote     {}", file.display());
        }
        text
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }
}
