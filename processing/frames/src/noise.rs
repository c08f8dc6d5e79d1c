//! Noise of a camera and of its frames.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Noise of a linear sensor at gain 1. A sensor value `v` (0 at black, 1 at white) has the variance
/// `v/F + (r/F)² + q²/12`, with F electrons at white, read noise r, and q the step between codes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NoiseModel {
    /// Electrons that make a pixel white at gain 1.
    pub full_scale_e: f64,
    /// Read noise in electrons, standard deviation.
    pub read_noise_e: f64,
}

/// Where a noise model comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum NoiseSource {
    /// `frames.json` states it.
    Given,
    /// From the differences of frames at angles 180° apart, or at the same one, which no model enters.
    Repeats,
    /// From the scatter of the frames about their fit.
    Estimated,
    /// Three frames leave no scatter to look at, so a modest camera is assumed.
    Assumed,
}

/// Stands in when nothing is known: a small sensor, so that σ errs to the large side.
pub const ASSUMED: NoiseModel = NoiseModel { full_scale_e: 5000.0, read_noise_e: 10.0 };

/// How one frame's linear values scatter: variance = `shot · I + floor` (I and the variance in linear units).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameNoise {
    /// Variance per unit of intensity.
    pub shot: f64,
    /// Variance at zero intensity.
    pub floor: f64,
}

impl FrameNoise {
    /// With variances multiplied.
    pub fn scaled(self, factor: f64) -> Self {
        Self { shot: self.shot * factor, floor: self.floor * factor }
    }
}

impl NoiseModel {
    /// Noise of a frame whose sensor values were multiplied by `scale = 1/(exposure · gain)`; `step` is the
    /// distance between two codes in sensor units (0 for floating point).
    pub fn frame(&self, gain: f64, scale: f64, step: f64) -> FrameNoise {
        let full = self.full_scale_e / gain;
        let floor = (self.read_noise_e / full).powi(2) + step * step / 12.0;
        FrameNoise { shot: scale / full, floor: scale * scale * floor }
    }
}

/// An exposure this many standard deviations below white counts as saturated where there is a shorter one: noise that
/// is clipped on one side only would draw the mean down.
pub const BELOW_WHITE_SIGMA: f64 = 5.0;
