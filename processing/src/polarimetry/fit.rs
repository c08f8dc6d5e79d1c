//! The streaming fit: every frame is folded into a few sums per pixel and forgotten.

use super::Design;
use rayon::prelude::*;

/// Sums per pixel, enough to solve the fit at any time: 5 floats and a flag, whatever the number of frames.
///
/// Values are taken relative to the first frame (the pivot), so that f32 sums keep the modulation's precision when
/// it is small against the mean.
pub struct Fit {
    width: usize,
    frames: usize,
    pivot: Vec<f32>,
    sum: Vec<f32>,
    cos: Vec<f32>,
    sin: Vec<f32>,
    square: Vec<f32>,
    bad: Vec<u8>,
}

/// Solution per pixel. Pixels that were bad (saturated) in any frame are NaN in all maps.
pub struct StokesMaps {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// S0, in linear input units.
    pub s0: Vec<f32>,
    /// S1.
    pub s1: Vec<f32>,
    /// S2.
    pub s2: Vec<f32>,
    /// Residual sum of squares of the fit; where `covariance` is there, each square over its variance (χ²).
    pub residual: Vec<f32>,
    /// Normalised correlation between fit and measured intensities (2018 paper, section 7.3), 0 to 1.
    pub correlation: Vec<f32>,
    /// Covariances AA, AC, AS, CC, CS and SS of (A, C, S) = (S0, S1, S2)/2 where variances differ from pixel to pixel, since
    /// exposures were merged; empty where the noise of the frames tells them.
    pub covariance: Vec<[f32; 6]>,
}

impl Fit {
    /// An empty fit for images of `width` × `height` pixels.
    pub fn new(width: usize, height: usize) -> Self {
        let plane = || vec![0.0; width * height];
        Self {
            width,
            frames: 0,
            pivot: plane(),
            sum: plane(),
            cos: plane(),
            sin: plane(),
            square: plane(),
            bad: vec![0; width * height],
        }
    }

    /// Pixels per row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// The fit of every `step`-th pixel of every `step`-th row.
    pub fn thinned(&self, step: usize) -> Self {
        fn thin<T: Copy>(plane: &[T], width: usize, step: usize) -> Vec<T> {
            plane.chunks(width.max(1)).step_by(step).flat_map(|row| row.iter().step_by(step).copied()).collect()
        }
        let plane = |plane: &[f32]| thin(plane, self.width, step);
        Self {
            width: self.width.div_ceil(step),
            frames: self.frames,
            pivot: plane(&self.pivot),
            sum: plane(&self.sum),
            cos: plane(&self.cos),
            sin: plane(&self.sin),
            square: plane(&self.square),
            bad: thin(&self.bad, self.width, step),
        }
    }

    /// Number of frames added.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Folds in one frame taken at analyser angle `psi` (rad). `row(y, values, bad)` fills in one row of linear
    /// values and may set `bad[x] = 1` where the value cannot be used; it is called from several threads.
    pub fn add(&mut self, psi: f64, row: impl Fn(usize, &mut [f32], &mut [u8]) + Sync) {
        let (sin2, cos2) = (2.0 * psi).sin_cos();
        let (sin2, cos2, first, width) = (sin2 as f32, cos2 as f32, self.frames == 0, self.width.max(1));
        let sums = self.sum.par_chunks_mut(width).zip(self.cos.par_chunks_mut(width));
        let sums = sums.zip(self.sin.par_chunks_mut(width)).zip(self.square.par_chunks_mut(width));
        self.pivot.par_chunks_mut(width).zip(self.bad.par_chunks_mut(width)).zip(sums).enumerate().for_each_init(
            || vec![0.0_f32; width],
            |values, (y, ((pivot, bad), (((sum, cos), sin), square)))| {
                if first {
                    row(y, pivot, bad);
                } else {
                    row(y, values, bad);
                    accumulate(values, pivot, [cos2, sin2], [sum, cos, sin, square]);
                }
            },
        );
        self.frames += 1;
    }

    /// Solves every pixel. `design` must hold the angles in the order of [`Fit::add`]; the sums are consumed, so that
    /// the result needs no memory of its own but one map.
    pub fn solve(mut self, design: &Design) -> StokesMaps {
        debug_assert_eq!(design.frames(), self.frames);
        let height = self.pivot.len() / self.width.max(1);
        let mut correlation = vec![0.0_f32; self.pivot.len()];
        let inverse: [[f32; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| design.inverse[(i, j)] as f32));
        let frames = self.frames as f32;
        let width = self.width.max(1);
        let sums = self.sum.par_chunks_mut(width).zip(self.cos.par_chunks_mut(width));
        let sums = sums.zip(self.sin.par_chunks_mut(width)).zip(self.square.par_chunks_mut(width));
        let rest = self.bad.par_chunks(width).zip(correlation.par_chunks_mut(width));
        self.pivot.par_chunks_mut(width).zip(sums).zip(rest).for_each(
            |((s0, (((sum, s1), s2), residual)), (bad, corr))| {
                for x in 0..s0.len() {
                    let t = [sum[x], s1[x], s2[x]];
                    let beta = inverse.map(|m| m[0] * t[0] + m[1] * t[1] + m[2] * t[2]);
                    let explained = beta[0] * t[0] + beta[1] * t[1] + beta[2] * t[2];
                    let total = residual[x] - t[0] * t[0] / frames;
                    let left = (residual[x] - explained).max(0.0);
                    let nan = if bad[x] == 0 { 0.0 } else { f32::NAN };
                    s0[x] = 2.0 * (s0[x] + beta[0]) + nan;
                    s1[x] = 2.0 * beta[1] + nan;
                    s2[x] = 2.0 * beta[2] + nan;
                    residual[x] = left + nan;
                    corr[x] = if total > 0.0 { (1.0 - left / total).clamp(0.0, 1.0).sqrt() } else { 0.0 } + nan;
                }
            },
        );
        let Self { pivot: s0, cos: s1, sin: s2, square: residual, .. } = self;
        StokesMaps { width: self.width, height, s0, s1, s2, residual, correlation, covariance: vec![] }
    }
}

/// The inner loop: 5 floats read, 4 written per pixel and frame.
#[inline]
fn accumulate(values: &[f32], pivot: &[f32], [cos2, sin2]: [f32; 2], [sum, cos, sin, square]: [&mut [f32]; 4]) {
    let n = values.len();
    let (pivot, sum, cos, sin, square) = (&pivot[..n], &mut sum[..n], &mut cos[..n], &mut sin[..n], &mut square[..n]);
    for x in 0..n {
        let d = values[x] - pivot[x];
        sum[x] += d;
        cos[x] += cos2 * d;
        sin[x] += sin2 * d;
        square[x] += d * d;
    }
}
