//! Noise of a camera and of single frames.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Noise of a linear sensor at gain 1. A sensor value `v` (0 at black, 1 at white) has the variance `v/F + (r/F)² +
/// q²/12`, with F electrons at white, read noise r in electrons, and quantisation step q.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NoiseModel {
    /// Electrons per pixel at white and gain 1 (full-well capacity).
    pub full_scale_e: f64,
    /// Read noise in electrons (standard deviation).
    pub read_noise_e: f64,
}

/// Source of a noise model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum NoiseSource {
    /// Stated in `frames.json`.
    Given,
    /// Differences of frames at equal angles, or at angles 180° apart, which are independent of any model.
    Repeats,
    /// Scatter of the frames about their fit.
    Estimated,
    /// A typical small sensor: three frames leave no degrees of freedom for an estimate.
    Assumed,
}

/// Noise of a small sensor, used when none is known, so that σ is rather overestimated.
pub const ASSUMED: NoiseModel = NoiseModel { full_scale_e: 5000.0, read_noise_e: 10.0 };

/// Noise of a frame's linear values: variance = `shot · I + floor` (I and the variance in linear units).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameNoise {
    /// Variance per unit of intensity.
    pub shot: f64,
    /// Variance at zero intensity.
    pub floor: f64,
}

impl FrameNoise {
    /// Noise with scaled variances.
    pub fn scaled(self, factor: f64) -> Self {
        Self { shot: self.shot * factor, floor: self.floor * factor }
    }
}

impl NoiseModel {
    /// Noise of a frame whose sensor values were multiplied by `scale = 1/(exposure · gain)`; `step` is the
    /// quantisation step in sensor units (0 for floating point).
    pub fn frame(&self, gain: f64, scale: f64, step: f64) -> FrameNoise {
        let full = self.full_scale_e / gain;
        let floor = (self.read_noise_e / full).powi(2) + step * step / 12.0;
        FrameNoise { shot: scale / full, floor: scale * scale * floor }
    }
}

/// Margin below white, in standard deviations, within which an exposure counts as saturated if a shorter one exists.
/// Noise clipped on one side would bias the mean.
pub const BELOW_WHITE_SIGMA: f64 = 5.0;
