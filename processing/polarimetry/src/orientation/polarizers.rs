//! Errors of a polarization sensor's maps where light varies: its four polarizers view neighbouring points, an error
//! that σ of noise does not include.

use crate::fit::views::View;
use crate::{Demosaic, Design, OrientationMaps, StokesMaps};
use rayon::prelude::*;
use std::f32::consts::FRAC_PI_2;
use std::ops::Range;

/// Largest variance, relative to that of noise, that noise in the differences of neighbouring pixels may add. It is
/// subtracted, so that σ is unchanged for uniform light.
const NOISE: f32 = 0.5;

/// Upper bound of the error of edge-aware images relative to bilinear ones, for waves that the sensor resolves (chart
/// `demosaic`, 0.12 to 0.25 cycles per pixel).
const EDGE_AWARE: f64 = 0.3;

/// Errors `[S1, S2]` per difference of `[S0, S1, S2]`.
type Effect = [[f32; 3]; 2];

/// Errors of S1 and S2 due to the positions of the polarizers.
pub(crate) struct PolarizerPositions {
    /// Effect of the differences along x and along y, by the position of a map pixel in its block (row by row).
    effects: [[Effect; 2]; 4],
    /// Differences, of whose effects the largest counts.
    differences: Vec<Difference>,
}

/// A difference between pixels along an axis.
struct Difference {
    /// Offsets of the pixels and their factors.
    taps: Vec<(isize, f32)>,
    /// The only pixel to which it applies, counted from the first (0) or the last (-1); `None` for all.
    only: Option<isize>,
}

impl PolarizerPositions {
    /// For the views of a sensor; `None` if all views see the same points.
    pub fn of(views: &[View], design: &Design, demosaic: Demosaic) -> Option<Self> {
        let block = views.first().map(|v| v.block).filter(|b| *b > 1)?;
        let mean = |v: &View, axis: usize| v.pixels.iter().map(|p| p[axis] as f64).sum::<f64>() / v.pixels.len() as f64;
        let positions: Vec<[f64; 2]> = views.iter().map(|v| [mean(v, 0), mean(v, 1)]).collect();
        Some(if demosaic == Demosaic::None {
            Self::super_pixels(&positions, design, block)
        } else {
            Self::interpolated(&positions, design, demosaic)
        })
    }

    /// For one pixel per block of `block` pixels, with views at `positions` (x, y). Off-centre polarizers see light
    /// that differs by the gradient, to first order. A block may straddle an edge, so the steeper side counts.
    fn super_pixels(positions: &[[f64; 2]], design: &Design, block: usize) -> Self {
        let center = [0, 1].map(|axis| positions.iter().map(|p| p[axis]).sum::<f64>() / positions.len().max(1) as f64);
        let effects = [0, 1].map(|axis| effect(design, |k| (positions[k][axis] - center[axis]) / block as f64));
        let slope = |side: isize| Difference { taps: vec![(side, 1.0), (0, -1.0)], only: None };
        Self { effects: [effects; 4], differences: vec![slope(-1), slope(1)] }
    }

    /// For images behind each polarizer. The mean of two neighbours differs by half of the second derivative; for the
    /// outermost pixels both neighbours are the inner one.
    fn interpolated(positions: &[[f64; 2]], design: &Design, demosaic: Demosaic) -> Self {
        let share = if demosaic == Demosaic::EdgeAware { EDGE_AWARE } else { 1.0 };
        let elsewhere = |k: usize, place: usize, axis: usize| {
            let own = [place % 2, place / 2][axis];
            if positions[k][axis] as usize == own { 0.0 } else { share }
        };
        let effects = [0, 1, 2, 3].map(|place| [0, 1].map(|axis| effect(design, |k| elsewhere(k, place, axis))));
        // Second differences over two pixels, since adjacent pixels are interpolated between the same measured ones.
        // The largest of three counts, because a zero second difference does not exclude a third derivative.
        let bend = |at: isize| vec![(at - 2, 0.125), (at, -0.25), (at + 2, 0.125)];
        let bends = [-1, 0, 1].map(|at| Difference { taps: bend(at), only: None });
        // Extrapolated from inner pixels at the last two positions: at the end S0 has an error, too.
        let ends = [0, -1].map(|end| {
            let inwards = 1 + 2 * end;
            let slope = vec![(4 * inwards, 0.5), (2 * inwards, -0.5)];
            let next = Difference { taps: bend(2 * inwards), only: Some(end + inwards) };
            [Difference { taps: slope, only: Some(end) }, next]
        });
        Self { effects, differences: bends.into_iter().chain(ends.into_iter().flatten()).collect() }
    }

    /// Increases σ by the effect of the positions on the differences of the maps.
    pub fn widen(&self, maps: &StokesMaps, map: &mut OrientationMaps) {
        let width = maps.width;
        map.sigma.par_chunks_mut(width).enumerate().for_each_init(
            || Scratch::new(width),
            |scratch, (y, sigma)| {
                scratch.square.fill(0.0);
                (0..2).for_each(|axis| self.add(maps, y, axis, scratch));
                for (sigma, square) in sigma.iter_mut().zip(&scratch.square) {
                    let noise = *sigma * *sigma;
                    *sigma = (noise + (square - NOISE * noise).max(0.0)).sqrt().min(FRAC_PI_2);
                }
            },
        );
    }

    /// Adds the squared errors of the angle in row `y` due to differences along an axis.
    fn add(&self, maps: &StokesMaps, y: usize, axis: usize, scratch: &mut Scratch) {
        let StokesMaps { width, height, s0, s1, s2, .. } = maps;
        let (count, stride) = if axis == 0 { (*width, 1) } else { (*height, *width) };
        scratch.weigh(maps, y, [0, 1].map(|x| &self.effects[x + 2 * (y % 2)][axis]));
        scratch.most.fill(0.0);
        for difference in &self.differences {
            let inside = difference.range(count);
            let pixels = match axis {
                0 => inside,
                _ if inside.contains(&y) => 0..*width,
                _ => continue,
            };
            scratch.error.fill(0.0);
            for (distance, factor) in &difference.taps {
                let first = (y * width + pixels.start).wrapping_add_signed(distance * stride as isize);
                for (weights, plane) in scratch.weights.iter().zip([s0, s1, s2]) {
                    let terms = weights[pixels.clone()].iter().zip(&plane[first..]);
                    for (sum, (weight, value)) in scratch.error[pixels.clone()].iter_mut().zip(terms) {
                        *sum += factor * weight * value;
                    }
                }
            }
            // Unusable neighbours are ignored: `max` skips NaN.
            for (most, error) in scratch.most.iter_mut().zip(&scratch.error) {
                *most = most.max(error * error);
            }
        }
        scratch.square.iter_mut().zip(&scratch.most).for_each(|(sum, most)| *sum += most);
    }
}

impl Difference {
    /// Pixels along an axis of `count` whose difference lies inside.
    fn range(&self, count: usize) -> Range<usize> {
        let reach = |sign: isize| self.taps.iter().map(|t| (sign * t.0).max(0) as usize).max().unwrap_or(0);
        let inside = reach(-1)..count.saturating_sub(reach(1));
        let Some(only) = self.only else { return inside.start..inside.end.max(inside.start) };
        let at = if only < 0 { count.wrapping_add_signed(only) } else { only as usize };
        if inside.contains(&at) { at..at + 1 } else { 0..0 }
    }
}

/// Rows of values.
struct Scratch {
    /// Error of the angle in rad per difference of S0, S1 and S2.
    weights: [Vec<f32>; 3],
    error: Vec<f32>,
    most: Vec<f32>,
    square: Vec<f32>,
}

impl Scratch {
    fn new(width: usize) -> Self {
        let row = || vec![0.0; width];
        Self { weights: [row(), row(), row()], error: row(), most: row(), square: row() }
    }

    /// Computes the weights of row `y`; the error of the angle is (S1 δS2 - S2 δS1) / (2 (S1² + S2²)). `effects` are
    /// those of even and odd columns.
    fn weigh(&mut self, maps: &StokesMaps, y: usize, effects: [&Effect; 2]) {
        let first = y * maps.width;
        for (c, weights) in self.weights.iter_mut().enumerate() {
            let stokes = maps.s1[first..].iter().zip(&maps.s2[first..]);
            for (x, (weight, (s1, s2))) in weights.iter_mut().zip(stokes).enumerate() {
                let [of_s1, of_s2] = [effects[x % 2][0][c], effects[x % 2][1][c]];
                *weight = 0.5 * (s1 * of_s2 - s2 * of_s1) / (s1 * s1 + s2 * s2);
            }
        }
    }
}

/// Effect of differences of the Stokes parameters on the fit, if view k sees `share(k)` of them.
fn effect(design: &Design, share: impl Fn(usize) -> f64) -> Effect {
    let mut effect = [[0.0_f64; 3]; 2];
    for (k, x) in design.rows.iter().enumerate() {
        let fitted = design.inverse * x;
        for (row, weight) in effect.iter_mut().zip([fitted[1], fitted[2]]) {
            for (sum, x) in row.iter_mut().zip(x.iter()) {
                *sum += weight * share(k) * x;
            }
        }
    }
    effect.map(|row| row.map(|v| v as f32))
}

/// Increases σ of the maps of a polarization sensor with 2×2 blocks by the errors due to the positions of its
/// polarizers. `design` holds the analyser angles of a block row by row, as [`demosaiced`](crate::demosaiced) orders
/// images.
pub fn widen_between_polarizers(map: &mut OrientationMaps, maps: &StokesMaps, design: &Design, demosaic: Demosaic) {
    let positions: Vec<[f64; 2]> = (0..design.frames()).map(|k| [(k % 2) as f64, (k / 2 % 2) as f64]).collect();
    let positions = match demosaic {
        Demosaic::None => PolarizerPositions::super_pixels(&positions, design, 2),
        _ => PolarizerPositions::interpolated(&positions, design, demosaic),
    };
    positions.widen(maps, map);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Fit, FrameNoise, angle_difference, demosaiced, orient};

    const SIDE: usize = 64;
    const ANGLES: [f64; 4] = [90.0, 45.0, 135.0, 0.0];

    /// Errors and σ (rad) of a noise-free map of light with a uniform degree of polarization of 0.3 at 0.7 rad.
    fn errors(demosaic: Demosaic, light: impl Fn(f64, f64) -> f64) -> Vec<[f64; 2]> {
        let angles = ANGLES.map(f64::to_radians);
        let pixel = |i: usize| {
            let (x, y) = (i % SIDE, i / SIDE);
            let psi = angles[x % 2 + 2 * (y % 2)];
            (0.5 * light(x as f64, y as f64) * (1.0 + 0.3 * (2.0 * (psi - 0.7)).cos())) as f32
        };
        let mosaic: Vec<f32> = (0..SIDE * SIDE).map(pixel).collect();
        let images = demosaiced(&mosaic, [SIDE; 2], demosaic);
        let width = if demosaic == Demosaic::None { SIDE / 2 } else { SIDE };
        let mut fit = Fit::new(width, width);
        fit.add_several(&angles, |k, y, row, _| row.copy_from_slice(&images[k][y * width..][..width]));
        let design = Design::new(&angles).unwrap();
        let mut maps = fit.solve(&design);
        let mut map = orient(&mut maps, &design, &[FrameNoise { shot: 0.0, floor: 1e-10 }; 4], 0.0);
        // Rounding to f32 in the residuals counts as noise.
        map.sigma.fill(1e-6);
        widen_between_polarizers(&mut map, &maps, &design, demosaic);
        let error = |theta: &f32| angle_difference(f64::from(*theta), 0.7).abs();
        map.orientation.iter().zip(&map.sigma).map(|(theta, sigma)| [error(theta), f64::from(*sigma)]).collect()
    }

    fn mean(values: &[[f64; 2]], which: usize) -> f64 {
        values.iter().map(|v| v[which]).sum::<f64>() / values.len() as f64
    }

    /// A gradient of the light causes false polarization, which differences of the maps predict exactly where it is
    /// small.
    #[test]
    fn sigma_includes_slopes() {
        for slope in [[2e-4, 0.0], [0.0, 2e-4]] {
            let ramp = errors(Demosaic::None, |x, y| 0.5 + slope[0] * x + slope[1] * y);
            assert!(ramp.iter().all(|[error, sigma]| (sigma / error - 1.0).abs() < 0.02), "{:?}", ramp[65]);
            assert!(mean(&ramp, 0) > 2e-4);
        }
        // Errors along both axes add up or cancel: σ is their root sum square, which the sum exceeds by up to √2.
        let both = errors(Demosaic::None, |x, y| 0.5 + 2e-4 * x - 1e-4 * y);
        assert!(both.iter().all(|[error, sigma]| *error < 1.42 * sigma), "{:?}", both[65]);
    }

    /// Interpolated images reproduce gradients; the error from their curvature is included in σ.
    #[test]
    fn sigma_includes_curvature() {
        let ramp = errors(Demosaic::Bilinear, |x, y| 0.5 + 2e-4 * x + 1e-4 * y);
        let inside = |i: usize| (1..SIDE - 1).contains(&(i % SIDE)) && (1..SIDE - 1).contains(&(i / SIDE));
        assert!((0..ramp.len()).filter(|i| inside(*i)).all(|i| ramp[i][0] < 1e-5), "{:?}", ramp[65]);
        let bowl = errors(Demosaic::Bilinear, |x, _| 0.4 + 1e-4 * (x - 32.0).powi(2));
        let inner: Vec<[f64; 2]> = (0..bowl.len()).filter(|i| (4..60).contains(&(i % SIDE))).map(|i| bowl[i]).collect();
        // The second difference of a paraboloid is exact, except for rounding to f32, 1e-5 rad here.
        assert!(inner.iter().all(|[error, sigma]| *error < 1.05 * sigma + 1e-5), "{:?}", inner[65]);
        let (error, sigma) = (mean(&inner, 0), mean(&inner, 1));
        assert!(error > 2e-5 && sigma < 1.1 * error, "{error} {sigma}");
        // The outermost pixels are interpolated from one side.
        let wrong: Vec<_> = bowl.iter().enumerate().filter(|(_, [error, sigma])| *error > 1.3 * sigma + 1e-5).collect();
        assert!(wrong.is_empty(), "{wrong:?}");
    }
}
