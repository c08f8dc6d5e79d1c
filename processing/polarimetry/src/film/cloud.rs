//! The points (S1/S0, S2/S0) of a sample of the pixels, each with its noise: what models are fitted to and compared on.

use crate::fit::noise::Covariance;
use crate::{Design, FrameNoise, StokesMaps};
use rayon::prelude::*;

/// A pixel's polarization with its covariance.
#[derive(Clone, Copy, Debug)]
pub struct CloudPoint {
    /// Which pixel of the maps it is.
    pub pixel: usize,
    /// S1/S0 and S2/S0.
    pub at: [f64; 2],
    /// Variance of the first, covariance, variance of the second.
    pub covariance: [f64; 3],
    /// Distance from the origin over its standard deviation: the signal-to-noise ratio of the modulation.
    pub snr: f64,
}

/// Points that stand for all of them where a few per cent do: by so many the variance of a scatter is told to √(2/4000), which is 2 %, and what they
/// are fitted best by is a third as sure as by all 30,000 of a large map, near enough to go on from.
pub const SAMPLE: usize = 4000;

/// Pixels darker than this share of the 99th percentile, or less than so many standard deviations bright, say nothing.
const DARK: f32 = 0.01;
const BRIGHT_SNR: f64 = 10.0;

/// A second difference of so many standard deviations is an edge; chance alone makes 0.4 % of the pixels one.
const JUMP: f64 = 3.5;

/// Edges are left out if at least so many points remain.
const INSIDE: usize = 1000;

/// And their neighbours, if at least so many do.
const FLAT: usize = 6000;

/// At most `count` pixels, evenly over the image, that are bright enough to have a polarization.
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
    // Where nearly everything is an edge, edges are what there is to look at.
    if inside.len() < INSIDE {
        return points;
    }
    // Half-way up the ramp that the lens makes of an edge the second difference is nothing, but not beside it.
    let flat = inside.par_iter().filter(|p| !beside_edge(maps, &covariance, p.pixel)).copied();
    let flat: Vec<CloudPoint> = flat.collect();
    if flat.len() < FLAT { inside } else { flat }
}

/// Every n-th point, so that there are at most so many.
pub fn thinned(points: &[CloudPoint], count: usize) -> Vec<CloudPoint> {
    points.iter().step_by(points.len().div_ceil(count).max(1)).copied().collect()
}

/// Whether a pixel next to this one is an edge.
fn beside_edge(maps: &StokesMaps, covariance: &Covariance, i: usize) -> bool {
    let width = maps.width;
    let edge = |i: usize| i < maps.s0.len() && point(maps, covariance, i).is_none_or(|p| is_edge(maps, i, &p));
    [i.wrapping_sub(1), i + 1, i.wrapping_sub(width), i + width].into_iter().any(edge)
}

/// Whether the polarization jumps at this pixel, so that the lens mixes two surfaces in it: its second difference along the row
/// or the column is more than noise.
fn is_edge(maps: &StokesMaps, i: usize, here: &CloudPoint) -> bool {
    let (width, height) = (maps.width, maps.height);
    let (x, y) = (i % width, i / width);
    let [wa, wb, wc] = here.weights();
    let ratios = |i: usize| [maps.s1[i] / maps.s0[i], maps.s2[i] / maps.s0[i]].map(f64::from);
    let jumps = |before: usize, after: usize| {
        let (p, q) = (ratios(before), ratios(after));
        let [dx, dy] = [0, 1].map(|k| p[k] - 2.0 * here.at[k] + q[k]);
        // Of the second difference the variance is six times that of a pixel.
        let square = (wa * dx * dx + 2.0 * wb * dx * dy + wc * dy * dy) / 6.0;
        // A dark neighbour, or a saturated one, has no polarization and is an edge as well.
        square.is_nan() || square > JUMP * JUMP
    };
    let inner = x > 0 && x + 1 < width && y > 0 && y + 1 < height;
    inner && (jumps(i - 1, i + 1) || jumps(i - width, i + width))
}

/// Steps that meet all columns and rows even where the image's width divides them.
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
    /// The point with its variances multiplied.
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
