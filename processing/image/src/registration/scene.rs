//! Models of the changes in a scene between frames, besides shifts.

use super::sums::Sums;
use nacre_base::vectors::vectorised;
use nalgebra::{DMatrix, Matrix3, Matrix3xX};

/// Least-squares fit of `A + C cos 2ψ + S sin 2ψ` per pixel, with a prior on C and S that follows from their overall
/// size.
///
/// A shift of frame k by `a · cos 2ψ` changes a pixel by `a · ∇A · cos 2ψ`, as a modulation C would. To first order,
/// only ∇C and ∇S distinguish the two, so the prior matters. For C and S of variance τ² and noise σ², this is their
/// best linear prediction (Henderson 1975).
#[derive(Clone)]
pub(super) struct Scene {
    /// `[1, cos 2ψ, sin 2ψ]` per frame, or `[1, 0, 0]` for an unchanging scene.
    pub(super) rows: Vec<[f64; 3]>,
    /// Matrix from the frames' values to (A, C, S).
    solve: Matrix3xX<f64>,
    /// Matrix from the frames' values to the residuals.
    pub(super) left: DMatrix<f64>,
}

/// Initial ratio σ²/τ²: weak prior before the frames are aligned.
const FIRST_RATIO: f64 = 0.1;

impl Scene {
    /// Scene that does not change.
    pub(super) fn still(frames: usize) -> Self {
        Self::with(vec![[1.0, 0.0, 0.0]; frames], FIRST_RATIO)
    }

    /// Scene behind an analyser at these angles (rad).
    pub(super) fn polarized(angles: &[f64]) -> Self {
        Self::with(angles.iter().map(|psi| [1.0, (2.0 * psi).cos(), (2.0 * psi).sin()]).collect(), FIRST_RATIO)
    }

    fn with(rows: Vec<[f64; 3]>, ratio: f64) -> Self {
        let x = DMatrix::from_fn(rows.len(), 3, |i, j| rows[i][j]);
        let normal: Matrix3<f64> = rows.iter().map(|r| nalgebra::Vector3::from(*r)).map(|v| v * v.transpose()).sum();
        let normal = normal + Matrix3::from_diagonal(&[0.0, ratio, ratio].into());
        let inverse = normal.try_inverse().unwrap_or_default();
        let solve = Matrix3xX::from_fn(rows.len(), |i, k| (0..3).map(|j| inverse[(i, j)] * rows[k][j]).sum());
        let left = DMatrix::identity(rows.len(), rows.len()) - x * &solve;
        Self { rows, solve, left }
    }

    /// The same scene with the ratio σ²/τ² estimated from these sums.
    pub(super) fn adapted(&self, sums: &Sums) -> Self {
        let pixels = sums.pixels.max(1) as f64;
        let noise = sums.square / (pixels * self.freedom());
        let modulation = 0.5 * sums.modulation / pixels;
        let ratio = if modulation > 0.0 { noise / modulation } else { FIRST_RATIO };
        Self::with(self.rows.clone(), ratio.clamp(1e-6, 1e3))
    }

    /// Residual degrees of freedom: fraction of the noise variance in the residuals, summed over frames.
    pub(super) fn freedom(&self) -> f64 {
        self.left.norm_squared().max(1e-9)
    }

    /// Fits planes of (A, C, S), and replaces the frames by their residuals.
    pub(super) fn explain(&self, frames: &mut [Vec<f32>]) -> [Vec<f32>; 3] {
        let length = frames.first().map_or(0, Vec::len);
        let mut model = [0, 1, 2].map(|_| vec![0.0_f32; length]);
        vectorised(
            #[inline(always)]
            || {
                for (k, frame) in frames.iter().enumerate() {
                    for (i, plane) in model.iter_mut().enumerate() {
                        let weight = self.solve[(i, k)] as f32;
                        for (sum, v) in plane.iter_mut().zip(frame) {
                            *sum += weight * v;
                        }
                    }
                }
                let [a, c, s] = &model;
                for (frame, [_, cos, sin]) in frames.iter_mut().zip(&self.rows) {
                    let (cos, sin) = (*cos as f32, *sin as f32);
                    for ((v, a), (c, s)) in frame.iter_mut().zip(a).zip(c.iter().zip(s)) {
                        *v -= a + cos * c + sin * s;
                    }
                }
            },
        );
        model
    }

    /// Curvature of half the sum of squares with respect to the shifts; with `honest`, less the contribution of noise.
    pub(super) fn curvature(&self, sums: &Sums, honest: bool) -> DMatrix<f64> {
        let n = self.rows.len();
        let mut gradient = sums.gradient;
        if honest {
            let shared = &self.solve * self.solve.transpose() / self.freedom();
            let [xx, xy, yy] = sums.noise;
            for (i, j) in (0..3).flat_map(|i| (0..3).map(move |j| (i, j))) {
                for (p, q, power) in [(0, 0, xx), (0, 1, xy), (1, 0, xy), (1, 1, yy)] {
                    gradient[2 * i + p][2 * j + q] -= shared[(i, j)] * power;
                }
            }
        }
        let predicted = |k: usize, l: usize, p: usize, q: usize| -> f64 {
            let pairs = (0..3).flat_map(|i| (0..3).map(move |j| (i, j)));
            pairs.map(|(i, j)| self.rows[k][i] * self.rows[l][j] * gradient[2 * i + p][2 * j + q]).sum()
        };
        DMatrix::from_fn(2 * n, 2 * n, |i, j| {
            let (k, l) = (i / 2, j / 2);
            self.left[(k, l)] * predicted(k, l, i % 2, j % 2)
        })
    }
}
