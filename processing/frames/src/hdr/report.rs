//! `report.json` of a merge.

use nacre_base::operation::{Summary, lines};
use nacre_image::registration::Alignment;
use schemars::JsonSchema;
use serde::Serialize;
use std::fmt::Write;

/// Result of merging a bracket, in words and numbers.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[schemars(rename = "HdrReport")]
pub struct Report {
    /// Always `hdr`.
    pub method: &'static str,
    /// What the reader must know before trusting the result. Empty when there is nothing.
    pub warnings: Vec<String>,
    /// Pixels of a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Names of the merged channels.
    pub channels: Vec<&'static str>,
    /// The exposures.
    pub frames: Vec<FrameReport>,
    /// How values became light: `linear`, `srgb`, `gamma 2.2`, `recovered`, or the file.
    pub response: String,
    /// Largest relative standard deviation of the recovered response between codes 16 and 240.
    pub response_sigma: Option<f64>,
    /// Ratio of the brightest (99.9 % of the samples are darker) to the darkest light (0.1 %) that was measured.
    pub dynamic_range: Option<f64>,
    /// Samples (pixels and channels) counted.
    pub samples: Samples,
    /// Median relative standard deviation of measured light, noise alone.
    pub error_estimate: Option<f64>,
    /// How much larger the scatter of the exposures about the merged light is than the noise of the given or assumed camera
    /// explains (variances); 1 where they agree.
    pub chi2: Option<f64>,
    /// `given`, or `estimated` from the scatter of the exposures, or `assumed`: a small sensor.
    pub noise: &'static str,
    /// What the shot and read noise (variances) of the assumed camera were multiplied by, so that they and rounding explain how the
    /// exposures scatter; none where noise is given or nothing tells it.
    pub noise_factor: Option<f64>,
    /// How the exposures lie over each other; none when nobody looked.
    pub registration: Option<Alignment>,
    /// Seconds spent.
    pub seconds: Seconds,
}

/// One exposure.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct FrameReport {
    /// Its file.
    pub file: String,
    /// Exposure time · gain, in s.
    pub exposure: f64,
    /// How much brighter it is than the other exposures say, and the standard deviation of that; 1 is right.
    pub gain: Option<[f64; 2]>,
}

/// How many samples there are.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct Samples {
    /// All.
    pub all: usize,
    /// Saturated in every exposure: unknown, NaN.
    pub saturated: usize,
    /// Less than three standard deviations above black in all exposures together.
    pub dark: usize,
}

/// What took how long.
#[derive(Clone, Copy, Debug, Default, Serialize, JsonSchema)]
#[schemars(rename = "HdrSeconds")]
pub struct Seconds {
    /// Looking at the exposures: response, registration.
    pub look: f64,
    /// Reading and merging.
    pub merge: f64,
    /// Writing.
    pub write: f64,
    /// Everything.
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
