//! The streaming fit for variances that differ from pixel to pixel: least squares with inverse-variance weights.

use crate::{Design, StokesMaps};
use nacre_base::statistics::{median, median_chi_square};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

/// Sums per pixel from which the fit can be solved at any time: 10 floats and a flag, for any number of frames.
///
/// As in [`Fit`](crate::Fit), values are relative to the first frame.
pub(crate) struct WeightedFit {
    width: usize,
    frames: usize,
    pixels: Vec<Pixel>,
    bad: Vec<u8>,
}

#[derive(Clone, Copy, Default)]
struct Pixel {
    pivot: f32,
    /// Σ w · (1, cos 2ψ, sin 2ψ, cos 4ψ, sin 4ψ): the normal matrix.
    normal: [f32; 5],
    /// Σ w d · (1, cos 2ψ, sin 2ψ), with d the value relative to the pivot.
    moments: [f32; 3],
    /// Σ w d².
    square: f32,
}

/// Solution of a pixel.
struct Solved {
    /// A, C and S.
    beta: Vector3<f64>,
    /// Their covariance.
    covariance: Matrix3<f64>,
    chi_square: f64,
    correlation: f64,
}

impl WeightedFit {
    /// An empty fit for images of `width` × `height` pixels.
    pub(crate) fn new(width: usize, height: usize) -> Self {
        Self { width, frames: 0, pixels: vec![Pixel::default(); width * height], bad: vec![0; width * height] }
    }

    /// Width in pixels.
    pub(crate) fn width(&self) -> usize {
        self.width
    }

    /// Number of frames added.
    pub(crate) fn frames(&self) -> usize {
        self.frames
    }

    /// The fit of every `step`-th pixel of every `step`-th row.
    pub(crate) fn thinned(&self, step: usize) -> Self {
        let width = self.width.max(1);
        let thin = |plane: &[Pixel]| -> Vec<Pixel> {
            plane.chunks(width).step_by(step).flat_map(|row| row.iter().step_by(step).copied()).collect()
        };
        let bad = self.bad.chunks(width).step_by(step).flat_map(|row| row.iter().step_by(step).copied()).collect();
        Self { width: self.width.div_ceil(step), frames: self.frames, pixels: thin(&self.pixels), bad }
    }

    /// Adds one view at analyser angle `psi` (rad). `row(y, values, variances, bad)` fills in one row of linear values
    /// with their variances and may set `bad[x] = 1`; it is called from several threads.
    pub(crate) fn add(&mut self, psi: f64, row: impl Fn(usize, &mut [f32], &mut [f32], &mut [u8]) + Sync) {
        let (first, width) = (self.frames == 0, self.width.max(1));
        let (sin2, cos2) = (2.0 * psi).sin_cos();
        let (sin4, cos4) = (4.0 * psi).sin_cos();
        let x = [1.0, cos2, sin2, cos4, sin4].map(|v| v as f32);
        let rows = self.pixels.par_chunks_mut(width).zip(self.bad.par_chunks_mut(width)).enumerate();
        rows.for_each_init(
            || (vec![0.0_f32; width], vec![0.0_f32; width]),
            |(values, variances), (y, (pixels, bad))| {
                row(y, values, variances, bad);
                for ((pixel, value), variance) in pixels.iter_mut().zip(values).zip(variances) {
                    if first {
                        pixel.pivot = *value;
                    }
                    pixel.add(&x, *value, 1.0 / variance.max(f32::MIN_POSITIVE));
                }
            },
        );
        self.frames += 1;
    }

    /// Solves every pixel. The residual map contains χ², and the maps have a covariance per pixel.
    pub(crate) fn solve(self) -> StokesMaps {
        let (width, n) = (self.width, self.pixels.len());
        let plane = || vec![f32::NAN; n];
        let mut maps = StokesMaps {
            width,
            height: n / width.max(1),
            s0: plane(),
            s1: plane(),
            s2: plane(),
            residual: plane(),
            correlation: plane(),
            covariance: vec![[f32::NAN; 6]; n],
        };
        let stokes = maps.s0.par_iter_mut().zip(&mut maps.s1).zip(&mut maps.s2);
        let quality = maps.residual.par_iter_mut().zip(&mut maps.correlation).zip(&mut maps.covariance);
        let sums = self.pixels.par_iter().zip(&self.bad);
        sums.zip(stokes).zip(quality).with_min_len(4096).for_each(
            |(((pixel, bad), ((s0, s1), s2)), ((residual, correlation), covariance))| {
                let Some(solved) = pixel.solve().filter(|_| *bad == 0) else { return };
                let (b, v) = (solved.beta, solved.covariance);
                [*s0, *s1, *s2] = [0, 1, 2].map(|k| (2.0 * b[k]) as f32);
                (*residual, *correlation) = (solved.chi_square as f32, solved.correlation as f32);
                let entries = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
                *covariance = entries.map(|at| v[at] as f32);
            },
        );
        maps
    }
}

impl Pixel {
    #[inline]
    fn add(&mut self, x: &[f32; 5], value: f32, weight: f32) {
        let d = value - self.pivot;
        for (sum, x) in self.normal.iter_mut().zip(x) {
            *sum += weight * x;
        }
        for (sum, x) in self.moments.iter_mut().zip(x) {
            *sum += weight * x * d;
        }
        self.square += weight * d * d;
    }

    fn solve(&self) -> Option<Solved> {
        let [w, c, s, c4, s4] = self.normal.map(f64::from);
        let normal = Matrix3::new(w, c, s, c, 0.5 * (w + c4), 0.5 * s4, s, 0.5 * s4, 0.5 * (w - c4));
        let moments = Vector3::from(self.moments.map(f64::from));
        let covariance = normal.try_inverse()?;
        let mut beta = covariance * moments;
        let square = f64::from(self.square);
        let chi_square = (square - beta.dot(&moments)).max(0.0);
        let total = square - moments[0] * moments[0] / w;
        let correlation = if total > 0.0 { (1.0 - chi_square / total).clamp(0.0, 1.0).sqrt() } else { 0.0 };
        beta[0] += f64::from(self.pivot);
        Some(Solved { beta, covariance, chi_square, correlation })
    }
}

/// Factor for the variances that makes the median χ² over the pixels match its expectation; `None` without degrees of
/// freedom or for too few pixels.
pub(crate) fn variance_factor(maps: &StokesMaps, design: &Design) -> Option<f64> {
    let mut chi_square: Vec<f32> =
        maps.residual.iter().zip(&maps.s0).filter(|(r, a)| r.is_finite() && **a > 0.0).map(|(r, _)| *r).collect();
    if design.freedom() == 0 || chi_square.len() < 64 {
        return None;
    }
    Some((f64::from(median(&mut chi_square)?) / median_chi_square(design.freedom())).max(f64::from(f32::MIN_POSITIVE)))
}

/// Multiplies the variances of weighted maps.
pub(crate) fn scale_variances(maps: &mut StokesMaps, factor: f64) {
    let factor = factor as f32;
    maps.covariance.iter_mut().flatten().for_each(|v| *v *= factor);
    maps.residual.iter_mut().for_each(|r| *r /= factor);
}
