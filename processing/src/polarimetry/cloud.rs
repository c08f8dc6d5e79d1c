//! The points (S1/S0, S2/S0) of a sample of the pixels, each with its noise: what models are fitted to and compared on.

use super::noise::Covariance;
use super::{Design, FrameNoise, StokesMaps};

/// A pixel's polarization with its covariance.
#[derive(Clone, Copy, Debug)]
pub struct CloudPoint {
    /// S1/S0 and S2/S0.
    pub at: [f64; 2],
    /// Variance of the first, covariance, variance of the second.
    pub covariance: [f64; 3],
    /// Distance from the origin over its standard deviation: the signal-to-noise ratio of the modulation.
    pub snr: f64,
}

/// Pixels darker than this share of the 99th percentile, or less than so many standard deviations bright, say nothing.
const DARK: f32 = 0.01;
const BRIGHT_SNR: f64 = 10.0;

/// At most `count` pixels, evenly over the image, that are bright enough to have a polarization.
pub fn cloud(maps: &StokesMaps, design: &Design, noise: &[FrameNoise], count: usize) -> Vec<CloudPoint> {
    let covariance = Covariance::new(design, noise);
    let stride = stride(maps.s0.len(), count);
    let mut bright: Vec<f32> = maps.s0.iter().step_by(stride).copied().filter(|v| v.is_finite()).collect();
    if bright.is_empty() {
        return vec![];
    }
    let at = bright.len() * 99 / 100;
    let limit = DARK * *bright.select_nth_unstable_by(at, f32::total_cmp).1;
    let usable = |i: &usize| maps.s0[*i] > limit.max(0.0);
    (0..maps.s0.len()).step_by(stride).filter(usable).filter_map(|i| point(maps, &covariance, i)).collect()
}

/// Steps that meet all columns and rows even where the image's width divides them.
fn stride(pixels: usize, count: usize) -> usize {
    let step = pixels.div_ceil(count.max(1)).max(1);
    if step > 2 && step.is_multiple_of(2) { step + 1 } else { step }
}

fn point(maps: &StokesMaps, covariance: &Covariance, i: usize) -> Option<CloudPoint> {
    let (a, c, s) = (0.5 * maps.s0[i], 0.5 * maps.s1[i], 0.5 * maps.s2[i]);
    let [_, _, brightness] = covariance.of_mean(a, c, s);
    let v = covariance.of_ratios(a, c, s).map(f64::from);
    let at = [f64::from(c / a), f64::from(s / a)];
    let (square, determinant) = (at[0] * at[0] + at[1] * at[1], v[0] * v[2] - v[1] * v[1]);
    let along = (at[0] * at[0] * v[0] + 2.0 * at[0] * at[1] * v[1] + at[1] * at[1] * v[2]) / square.max(1e-300);
    let good = f64::from(a) > BRIGHT_SNR * f64::from(brightness).sqrt() && determinant > 0.0 && at[0].is_finite();
    good.then(|| CloudPoint { at, covariance: v, snr: (square / along.max(1e-300)).sqrt() })
}

impl CloudPoint {
    /// The point with its variances multiplied.
    pub fn with_noise(&self, factor: f64) -> Self {
        Self { covariance: self.covariance.map(|v| v * factor), ..*self }
    }

    /// The inverse of the covariance.
    #[inline]
    pub fn weights(&self) -> [f64; 3] {
        let [a, b, c] = self.covariance;
        let determinant = a * c - b * b;
        [c / determinant, -b / determinant, a / determinant]
    }
}
