//! Conversion of a set's file values to light, and their variances.

use super::response::Response;
use crate::{ASSUMED, BELOW_WHITE_SIGMA, NoiseModel};
use crate::{Frame, LoadedFrames, Transfer};
use nacre_image::Depth;

/// Response curve.
#[derive(Clone, Debug)]
pub(super) enum Curve {
    /// As `frames.json` states.
    Stated(Transfer),
    /// Measured response.
    Measured(Response),
}

/// Coding of a set.
pub(super) struct Coding {
    pub curve: Curve,
    black: f64,
    white: f64,
    depth: Depth,
    noise: NoiseModel,
    /// Factor on the noise model's variances, which calibrates an assumed camera.
    pub noise_factor: f64,
    /// `1/(exposure · gain)` of the shortest exposure.
    shortest: f64,
}

/// Light of a value per exposure and gain, and its rounding variance, which is infinite for saturated values.
pub(super) type Entry = [f32; 2];

/// Entry of a saturated value.
pub(super) const SATURATED: Entry = [0.0, f32::INFINITY];

/// Noise of an exposure's light: variance = `shot · light + floor`, excluding rounding.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scatter {
    pub shot: f32,
    pub floor: f32,
}

impl Scatter {
    /// Noise with scaled variance.
    pub(super) fn times(self, factor: f32) -> Self {
        Self { shot: self.shot * factor, floor: (self.floor * factor).max(f32::MIN_POSITIVE) }
    }

    /// Variance added by subtraction of a dark photograph of the same exposure: its own variance, and shot noise of the
    /// dark light in the exposure itself.
    #[inline(always)]
    pub(super) fn of_dark(self, dark: f32) -> f32 {
        2.0 * self.shot * dark.max(0.0) + self.floor
    }

    /// Inverse variance of a value at the light estimated so far (Σ weight · light, Σ weight), or at the value itself
    /// if there is none. Equals [`Self::weight`] with one division instead of two.
    #[inline(always)]
    pub(super) fn weight_after(self, [product, weight]: [f32; 2], [light, rounding]: Entry) -> f32 {
        let (light, over) = if weight > 0.0 { (product, weight) } else { (light, 1.0) };
        // Not `max`, whose NaN handling takes more than one vector instruction.
        let light = if light > 0.0 { light } else { 0.0 };
        over / (self.shot * light + (self.floor + rounding) * over)
    }

    /// Inverse variance of a value at an expected light.
    #[inline(always)]
    pub(super) fn weight(self, light: f32, rounding: f32) -> f32 {
        1.0 / (self.shot * light.max(0.0) + self.floor + rounding)
    }
}

impl Coding {
    pub(super) fn new(frames: &LoadedFrames, curve: Curve) -> Self {
        let set = &frames.set;
        Self {
            curve,
            black: set.black.unwrap_or(0.0),
            white: set.white.unwrap_or(frames.info.depth.full_scale().into()),
            depth: frames.info.depth,
            noise: set.noise.unwrap_or(ASSUMED),
            noise_factor: 1.0,
            shortest: set.frames.iter().map(Frame::scale).fold(0.0, f64::max),
        }
    }

    /// Number of codes; `None` for floating-point files.
    pub(super) fn codes(&self) -> Option<usize> {
        match self.depth {
            Depth::U8 => Some(1 << 8),
            Depth::U16 => Some(1 << 16),
            Depth::F32 => None,
        }
    }

    /// File value of a saturated pixel.
    pub(super) fn white(&self) -> f64 {
        self.white
    }

    /// Position of a value between black (0) and white (1).
    pub(super) fn position(&self, value: f64) -> f64 {
        (value - self.black) / (self.white - self.black)
    }

    /// Light of a value, 0 (black) to 1 (white).
    pub(super) fn light(&self, channel: usize, value: f64) -> f64 {
        match &self.curve {
            Curve::Stated(transfer) => f64::from(transfer.decode(self.position(value) as f32)),
            Curve::Measured(response) => response.light(channel, self.position(value)),
        }
    }

    /// Quantisation step in light; 0 for floating-point files.
    fn step(&self, channel: usize, value: f64) -> f64 {
        if self.codes().is_none() {
            return 0.0;
        }
        0.5 * (self.light(channel, value + 1.0) - self.light(channel, value - 1.0))
    }

    /// True if a value of this exposure is too close to white. The shortest exposure is used up to white itself.
    fn saturated(&self, channel: usize, frame: &Frame, value: f64) -> bool {
        if value >= self.white {
            return true;
        }
        if frame.scale() >= self.shortest {
            return false;
        }
        let top = self.light(channel, self.white);
        let noise = self.noise.frame(frame.gain.unwrap_or(1.0), 1.0, 0.0);
        let rounding = self.step(channel, self.white - 1.0).powi(2) / 12.0;
        let variance = self.noise_factor * (noise.shot * top + noise.floor) + rounding;
        self.light(channel, value) > top - BELOW_WHITE_SIGMA * variance.sqrt()
    }

    /// Noise of this exposure's light.
    pub(super) fn scatter(&self, frame: &Frame) -> Scatter {
        let noise = self.noise.frame(frame.gain.unwrap_or(1.0), frame.scale(), 0.0);
        let [shot, floor] = [noise.shot, noise.floor].map(|v| (self.noise_factor * v) as f32);
        Scatter { shot, floor: floor.max(f32::MIN_POSITIVE) }
    }

    /// Light and rounding variance of a value of this exposure.
    pub(super) fn entry(&self, channel: usize, frame: &Frame, value: f64) -> Entry {
        let light = self.light(channel, value) * frame.scale();
        if !light.is_finite() || self.saturated(channel, frame, value) {
            return SATURATED;
        }
        let step = self.step(channel, value) * frame.scale();
        [light as f32, (step * step / 12.0) as f32]
    }

    /// [`Self::entry`] for all codes.
    pub(super) fn table(&self, channel: usize, frame: &Frame) -> Vec<Entry> {
        (0..self.codes().unwrap_or(0)).map(|code| self.entry(channel, frame, code as f64)).collect()
    }
}
