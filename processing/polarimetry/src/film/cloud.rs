//! The points (S1/S0, S2/S0) of a sample of the pixels with their noise, for fits and comparison of models.

use crate::fit::noise::Covariance;
use crate::{Design, FrameNoise, StokesMaps};
use rayon::prelude::*;

/// A pixel's polarization with its covariance.
#[derive(Clone, Copy, Debug)]
pub struct CloudPoint {
    /// Pixel index in the maps.
    pub pixel: usize,
    /// S1/S0 and S2/S0.
    pub at: [f64; 2],
    /// Variance of the first, covariance, variance of the second.
    pub covariance: [f64; 3],
    /// Distance from the origin over its standard deviation: the signal-to-noise ratio of the modulation.
    pub snr: f64,
}

/// Sample size where a precision of a few per cent suffices. A scatter variance has a relative error of √(2/4000), 2 %.
/// Fitted parameters have about three times the σ of a fit to all 30,000 points of a large map, sufficient for a start.
pub const SAMPLE: usize = 4000;

/// Pixels below this fraction of the 99th percentile, or below this brightness in standard deviations, are ignored.
const DARK: f32 = 0.01;
const BRIGHT_SNR: f64 = 10.0;

/// Second difference in standard deviations that counts as an edge; noise alone exceeds it in 0.4 % of the pixels.
const JUMP: f64 = 3.5;

/// Edge pixels are excluded if at least this many points remain.
const INSIDE: usize = 1000;

/// Their neighbours are also excluded if at least this many points remain.
const FLAT: usize = 6000;

/// At most `count` pixels, evenly distributed over the image, that are bright enough for a polarization.
pub fn cloud(maps: &StokesMaps, design: &Design, noise: &[FrameNoise], count: usize) -> Vec<CloudPoint> {
    let covariance = Covariance::new(design, noise, &maps.covariance);
    let stride = stride(maps.s0.len(), count);
    let mut bright: Vec<f32> = maps.s0.iter().step_by(stride).copied().filter(|v| v.is_finite()).collect();
    if bright.is_empty() {
        return vec![];
    }
    let at = bright.len() * 99 / 100;
    let limit = DARK * *bright.select_nth_unstable_by(at, f32::total_cmp).1;
    let usable = |i: &usize| maps.s0[*i] > limit.max(0.0);
    let pixels: Vec<usize> = (0..maps.s0.len()).step_by(stride).filter(usable).collect();
    let points: Vec<CloudPoint> = pixels.par_iter().filter_map(|i| point(maps, &covariance, *i)).collect();
    let inside: Vec<CloudPoint> = points.par_iter().filter(|p| !is_edge(maps, p.pixel, p)).copied().collect();
    // If nearly all pixels are edges, they are kept.
    if inside.len() < INSIDE {
        return points;
    }
    // Halfway up the ramp of a blurred edge the second difference vanishes, but not beside it.
    let flat = inside.par_iter().filter(|p| !beside_edge(maps, &covariance, p.pixel)).copied();
    let flat: Vec<CloudPoint> = flat.collect();
    if flat.len() < FLAT { inside } else { flat }
}

/// A subsample of at most `count` points, equally spaced.
pub fn thinned(points: &[CloudPoint], count: usize) -> Vec<CloudPoint> {
    points.iter().step_by(points.len().div_ceil(count).max(1)).copied().collect()
}

/// Whether a pixel next to this one is an edge.
fn beside_edge(maps: &StokesMaps, covariance: &Covariance, i: usize) -> bool {
    let width = maps.width;
    let edge = |i: usize| i < maps.s0.len() && point(maps, covariance, i).is_none_or(|p| is_edge(maps, i, &p));
    [i.wrapping_sub(1), i + 1, i.wrapping_sub(width), i + width].into_iter().any(edge)
}

/// Whether the polarization has an edge at this pixel, where the lens mixes two surfaces: its second difference along
/// the row or the column exceeds noise.
fn is_edge(maps: &StokesMaps, i: usize, here: &CloudPoint) -> bool {
    let (width, height) = (maps.width, maps.height);
    let (x, y) = (i % width, i / width);
    let [wa, wb, wc] = here.weights();
    let ratios = |i: usize| [maps.s1[i] / maps.s0[i], maps.s2[i] / maps.s0[i]].map(f64::from);
    let jumps = |before: usize, after: usize| {
        let (p, q) = (ratios(before), ratios(after));
        let [dx, dy] = [0, 1].map(|k| p[k] - 2.0 * here.at[k] + q[k]);
        // The variance of the second difference is six times that of a pixel.
        let square = (wa * dx * dx + 2.0 * wb * dx * dy + wc * dy * dy) / 6.0;
        // A dark or saturated neighbour has no polarization and also counts as an edge.
        square.is_nan() || square > JUMP * JUMP
    };
    let inner = x > 0 && x + 1 < width && y > 0 && y + 1 < height;
    inner && (jumps(i - 1, i + 1) || jumps(i - width, i + width))
}

/// Sampling step that visits all columns and rows even if it divides the image's width.
fn stride(pixels: usize, count: usize) -> usize {
    let step = pixels.div_ceil(count.max(1)).max(1);
    if step > 2 && step.is_multiple_of(2) { step + 1 } else { step }
}

fn point(maps: &StokesMaps, covariance: &Covariance, i: usize) -> Option<CloudPoint> {
    let (a, c, s) = (0.5 * maps.s0[i], 0.5 * maps.s1[i], 0.5 * maps.s2[i]);
    let brightness = covariance.of_mean(i, [a, c, s]);
    let v = covariance.of_ratios(i, [a, c, s]).map(f64::from);
    let at = [f64::from(c / a), f64::from(s / a)];
    let (square, determinant) = (at[0] * at[0] + at[1] * at[1], v[0] * v[2] - v[1] * v[1]);
    let along = (at[0] * at[0] * v[0] + 2.0 * at[0] * at[1] * v[1] + at[1] * at[1] * v[2]) / square.max(1e-300);
    let good = f64::from(a) > BRIGHT_SNR * f64::from(brightness).sqrt() && determinant > 0.0 && at[0].is_finite();
    good.then(|| CloudPoint { pixel: i, at, covariance: v, snr: (square / along.max(1e-300)).sqrt() })
}

impl CloudPoint {
    /// The point with its variances multiplied by `factor`.
    pub fn with_noise(&self, factor: f64) -> Self {
        Self { covariance: self.covariance.map(|v| v * factor), ..*self }
    }

    /// The inverse of the covariance.
    #[inline(always)]
    pub fn weights(&self) -> [f64; 3] {
        let [a, b, c] = self.covariance;
        let one = 1.0 / (a * c - b * b);
        [c * one, -b * one, a * one]
    }
}
