//! `report.json` of a merge.

use nacre_image::registration::Alignment;
use serde::Serialize;

/// Result of merging a bracket, in words and numbers.
#[derive(Clone, Debug, Serialize)]
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
#[derive(Clone, Debug, Serialize)]
pub struct FrameReport {
    /// Its file.
    pub file: String,
    /// Exposure time · gain, in s.
    pub exposure: f64,
    /// How much brighter it is than the other exposures say, and the standard deviation of that; 1 is right.
    pub gain: Option<[f64; 2]>,
}

/// How many samples there are.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Samples {
    /// All.
    pub all: usize,
    /// Saturated in every exposure: unknown, NaN.
    pub saturated: usize,
    /// Less than three standard deviations above black in all exposures together.
    pub dark: usize,
}

/// What took how long.
#[derive(Clone, Copy, Debug, Default, Serialize)]
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
