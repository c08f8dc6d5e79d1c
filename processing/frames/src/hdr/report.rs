//! `report.json` of a merge.

use nacre_base::operation::{Summary, lines};
use nacre_image::registration::Alignment;
use schemars::JsonSchema;
use serde::Serialize;
use std::fmt::Write;

/// Result of merging a bracket.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[schemars(rename = "HdrReport")]
pub struct Report {
    /// Always `hdr`.
    pub method: &'static str,
    /// Limitations of the result; empty if none is known.
    pub warnings: Vec<String>,
    /// Pixels of a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Names of the merged channels.
    pub channels: Vec<&'static str>,
    /// The exposures.
    pub frames: Vec<FrameReport>,
    /// Response: `linear`, `srgb`, `gamma 2.2`, `recovered`, or the file.
    pub response: String,
    /// Largest relative standard deviation of the recovered response between codes 16 and 240.
    pub response_sigma: Option<f64>,
    /// Ratio of the 99.9 % quantile to the 0.1 % quantile of measured light.
    pub dynamic_range: Option<f64>,
    /// Number of samples (pixels times channels).
    pub samples: Samples,
    /// Median relative standard deviation of measured light, from noise alone.
    pub error_estimate: Option<f64>,
    /// Reduced χ² of the exposures about the merged light, for the noise of the given or assumed camera; 1 indicates
    /// agreement.
    pub chi2: Option<f64>,
    /// Source of the noise model: `given`, `estimated` from the scatter of the exposures, or `assumed` (small sensor).
    pub noise: &'static str,
    /// Factor on the assumed camera's shot and read noise (variances) that explains the scatter of the exposures, in
    /// addition to rounding. `None` if noise is given or undetermined.
    pub noise_factor: Option<f64>,
    /// Registration of the exposures; `None` if disabled.
    pub registration: Option<Alignment>,
    /// Computation times.
    pub seconds: Seconds,
}

/// One exposure.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct FrameReport {
    /// Its file.
    pub file: String,
    /// Exposure time · gain, in s.
    pub exposure: f64,
    /// Brightness relative to the other exposures, and its standard deviation; expected to be 1.
    pub gain: Option<[f64; 2]>,
}

/// Number of samples.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct Samples {
    /// All.
    pub all: usize,
    /// Saturated in all exposures: unknown, NaN.
    pub saturated: usize,
    /// Less than three standard deviations above black in the merged light.
    pub dark: usize,
}

/// Computation times in seconds.
#[derive(Clone, Copy, Debug, Default, Serialize, JsonSchema)]
#[schemars(rename = "HdrSeconds")]
pub struct Seconds {
    /// Analysis of the exposures: response, registration.
    pub look: f64,
    /// Reading and merging.
    pub merge: f64,
    /// Writing.
    pub write: f64,
    /// Total.
    pub total: f64,
}

impl Summary for Report {
    fn summary(&self) -> String {
        let mut text = format!(
            "frames    {} exposure{}, {} × {} pixels, {}\n",
            self.frames.len(),
            if self.frames.len() == 1 { "" } else { "s" },
            self.width,
            self.height,
            self.channels.join(" "),
        );
        let known = self.response_sigma.map_or(String::new(), |s| format!(", known to {:.2} %", 100.0 * s));
        let _ = writeln!(text, "response  {}{known}", self.response);
        let percent = |n: usize| 100.0 * n as f64 / self.samples.all.max(1) as f64;
        let _ = writeln!(
            text,
            "samples   {:.2} % saturated in every exposure, {:.2} % dark in every exposure",
            percent(self.samples.saturated),
            percent(self.samples.dark)
        );
        if let Some(range) = self.dynamic_range {
            let _ = writeln!(text, "range     {range:.0} : 1 ({:.1} EV) measured", range.log2());
        }
        if let Some(sigma) = self.error_estimate {
            let _ = writeln!(text, "quality   σ of a typical value {:.3} % (noise {})", 100.0 * sigma, self.noise);
        }
        if self.registration.as_ref().is_some_and(|r| r.corrected) {
            let _ = writeln!(text, "aligned   exposures that lay shifted were moved back (see report.json)");
        }
        text += &lines(&[], &self.warnings);
        let s = &self.seconds;
        let _ = write!(
            text,
            "time      {:.2} s: looking {:.2}, reading and merging {:.2}, writing {:.2}",
            s.total, s.look, s.merge, s.write
        );
        text
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }
}
