//! Camera noise in the fitted parameters, and its estimate from the residuals of the fit.

use crate::{Design, StokesMaps};
use nacre_base::statistics::median_chi_square;
use nacre_frames::FrameNoise;

/// Covariance of the fitted (A, C, S) per pixel.
pub(crate) enum Covariance<'a> {
    /// A linear function of the fitted values: `[const, A, C, S]` coefficients of AA, AC, AS, CC, CS and SS.
    Alike([[f32; 4]; 6]),
    /// A covariance per pixel.
    Each(&'a [[f32; 6]]),
}

impl<'a> Covariance<'a> {
    /// Covariance of maps: `own` is their per-pixel covariance, which may be empty.
    pub(crate) fn new(design: &Design, noise: &[FrameNoise], own: &'a [[f32; 6]]) -> Self {
        if !own.is_empty() {
            return Self::Each(own);
        }
        let mut coefficients = [[0.0_f64; 4]; 6];
        for (x, frame) in design.rows.iter().zip(noise) {
            let m = design.inverse * x;
            let products = [m[0] * m[0], m[0] * m[1], m[0] * m[2], m[1] * m[1], m[1] * m[2], m[2] * m[2]];
            for (row, product) in coefficients.iter_mut().zip(products) {
                row[0] += product * frame.floor;
                for j in 0..3 {
                    row[j + 1] += product * frame.shot * x[j];
                }
            }
        }
        Self::Alike(coefficients.map(|row| row.map(|v| v as f32)))
    }

    /// AA, AC, AS, CC, CS and SS at pixel `i`.
    #[inline]
    fn all(&self, i: usize, [a, c, s]: [f32; 3]) -> [f32; 6] {
        match self {
            Self::Alike(coefficients) => Self::linear(coefficients, [a, c, s]),
            Self::Each(own) => own[i],
        }
    }

    /// The covariance from the coefficients of [`Self::Alike`].
    #[inline(always)]
    pub(crate) fn linear(coefficients: &[[f32; 4]; 6], [a, c, s]: [f32; 3]) -> [f32; 6] {
        coefficients.map(|k| k[0] + k[1] * a + k[2] * c + k[3] * s)
    }

    /// `[var C, cov(C, S), var S]` at pixel `i`.
    #[inline]
    pub(crate) fn at(&self, i: usize, fitted: [f32; 3]) -> [f32; 3] {
        let [_, _, _, cc, cs, ss] = self.all(i, fitted);
        [cc, cs, ss]
    }

    /// var A at pixel `i`.
    #[inline]
    pub(crate) fn of_mean(&self, i: usize, fitted: [f32; 3]) -> f32 {
        self.all(i, fitted)[0]
    }

    /// `[var C/A, cov(C/A, S/A), var S/A]` at pixel `i`, to first order.
    #[inline]
    pub(crate) fn of_ratios(&self, i: usize, fitted: [f32; 3]) -> [f32; 3] {
        Self::ratios(self.all(i, fitted), fitted)
    }

    /// σ of the degree of linear polarization at pixel `i` due to noise, to first order. It is scaled up if
    /// `angle_sigma` (rad), the σ of the angle, exceeds that of noise: other errors of the points (S1/S0, S2/S0) have
    /// all directions.
    pub(crate) fn degree_sigma(&self, i: usize, fitted: [f32; 3], angle_sigma: f32) -> f32 {
        let all = self.all(i, fitted);
        let ([a, c, s], [_, _, _, vc, vcs, vs]) = (fitted, all);
        let modulation = c.hypot(s);
        let (u, v) = (c / modulation, s / modulation);
        let [xx, xy, yy] = Self::ratios(all, fitted);
        let along = (u * u * xx + 2.0 * u * v * xy + v * v * yy).max(0.0);
        let across = v * v * vc - 2.0 * u * v * vcs + u * u * vs;
        let wider = (2.0 * modulation * angle_sigma).powi(2) / across;
        if a > 0.0 { (along * wider.max(1.0)).sqrt() } else { f32::NAN }
    }

    /// `[var C/A, cov(C/A, S/A), var S/A]` from AA, AC, AS, CC, CS and SS.
    #[inline(always)]
    pub(crate) fn ratios([aa, ac, as_, cc, cs, ss]: [f32; 6], [a, c, s]: [f32; 3]) -> [f32; 3] {
        let (x, y, per) = (c / a, s / a, 1.0 / (a * a));
        [
            (cc - 2.0 * x * ac + x * x * aa) * per,
            (cs - x * as_ - y * ac + x * y * aa) * per,
            (ss - 2.0 * y * as_ + y * y * aa) * per,
        ]
    }
}

/// Estimates `shot` and `floor` (both in linear units, the same for all frames) robustly from the residuals. Pixels are
/// grouped by intensity, the median residual of each group gives its variance, and a line with non-negative
/// coefficients is fitted. `None` without degrees of freedom, or for too few pixels.
///
/// The estimate includes all other deviations of the frames from a sinusoid (angle errors, movement).
pub fn estimate_noise(maps: &StokesMaps, design: &Design) -> Option<FrameNoise> {
    const PIXELS: usize = 200_000;
    const GROUPS: usize = 32;
    let freedom = design.freedom();
    let stride = (maps.s0.len() / PIXELS).max(1);
    let mut pixels: Vec<(f32, f32)> = (0..maps.s0.len())
        .step_by(stride)
        .map(|i| (0.5 * maps.s0[i], maps.residual[i]))
        .filter(|(a, r)| a.is_finite() && r.is_finite() && *a > 0.0)
        .collect();
    if freedom == 0 || pixels.len() < 64 {
        return None;
    }
    pixels.sort_by(|a, b| a.0.total_cmp(&b.0));
    let size = pixels.len().div_ceil(GROUPS).max(32);
    let points: Vec<(f64, f64)> = pixels
        .chunks_mut(size)
        .map(|group| {
            let a = f64::from(group[group.len() / 2].0);
            let middle = group.len() / 2;
            let (_, median, _) = group.select_nth_unstable_by(middle, |a, b| a.1.total_cmp(&b.1));
            (a, f64::from(median.1) / median_chi_square(freedom))
        })
        .collect();
    Some(line_through(&points))
}

/// As [`line_through`], with a lower bound of the floor.
pub fn line_above(points: &[(f64, f64)], least: f64) -> FrameNoise {
    let free = line_through(points);
    if free.floor >= least {
        return free;
    }
    let tiny = points.iter().map(|p| p.1).fold(0.0, f64::max) * 1e-6 + f64::MIN_POSITIVE;
    let (mut square, mut product) = (f64::MIN_POSITIVE, 0.0);
    for (a, v) in points {
        let w = (v + tiny).powi(-2);
        square += w * a * a;
        product += w * a * (v - least);
    }
    FrameNoise { shot: (product / square).max(0.0), floor: least }
}

/// Weighted least squares of `variance = shot · a + floor`, with equal relative errors, both kept ≥ 0.
fn line_through(points: &[(f64, f64)]) -> FrameNoise {
    let tiny = points.iter().map(|p| p.1).fold(0.0, f64::max) * 1e-6 + f64::MIN_POSITIVE;
    let (mut w0, mut w1, mut w2, mut wy, mut wxy) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for &(a, v) in points {
        let w = (v + tiny).powi(-2);
        w0 += w;
        w1 += w * a;
        w2 += w * a * a;
        wy += w * v;
        wxy += w * a * v;
    }
    let det = w0 * w2 - w1 * w1;
    let shot = if det > 1e-12 * w0 * w2 { (w0 * wxy - w1 * wy) / det } else { 0.0 };
    let floor = (wy - shot * w1) / w0;
    if shot <= 0.0 {
        FrameNoise { shot: 0.0, floor: (wy / w0).max(tiny) }
    } else if floor <= 0.0 {
        FrameNoise { shot: wxy / w2, floor: 0.0 }
    } else {
        FrameNoise { shot, floor }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_recovered_and_stays_non_negative() {
        let on = |shot: f64, floor: f64| {
            let points: Vec<_> = (1..30).map(|i| (f64::from(i), shot * f64::from(i) + floor)).collect();
            line_through(&points)
        };
        let n = on(2e-3, 5e-3);
        assert!((n.shot - 2e-3).abs() < 1e-12 && (n.floor - 5e-3).abs() < 1e-12);
        assert_eq!(on(-1e-4, 1.0).shot, 0.0);
        assert_eq!(on(1.0, -0.5).floor, 0.0);
    }
}
