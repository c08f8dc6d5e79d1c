//! Test of the `sinusoid` model. Under it the points (S1/S0, S2/S0) of all orientations lie on circles about the
//! origin. A birefringent film shifts the circle's centre and deforms it (2018 paper, Fig. 15), and the fitted phase
//! then differs from the orientation.

use crate::film::cloud::CloudPoint;
use crate::{OrientationMaps, StokesMaps};
use nacre_base::statistics::{median, quantile};
use nalgebra::{Matrix3, Vector3};
use schemars::JsonSchema;
use serde::Serialize;

/// Circle fitted to the points (S1/S0, S2/S0).
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct CircleCheck {
    /// Centre of the best circle; the origin if the model holds.
    pub center: [f64; 2],
    /// Radius of the circle.
    pub radius: f64,
    /// Scatter of the points about the circle, relative to the radius: the 80 % quantile of the distance over that of a
    /// normal distribution. It ignores edges and scratches, but not a fifth of the pixels with another period.
    pub spread: f64,
    /// Scatter expected from noise alone.
    pub spread_of_noise: f64,
    /// Widest gap between points along the circle, in degrees of orientation. Above 60° the circle is unreliable.
    pub gap_deg: f64,
    /// Mean orientation error caused by an off-centre circle, after the best common offset, in degrees. `None` if the
    /// points form no ring, so that the centre is undefined.
    pub bias_deg: Option<f64>,
}

/// Bias in degrees below which the centre is practically at the origin, and the sinusoid is accepted.
const NEGLIGIBLE_BIAS_DEG: f64 = 0.5;

impl CircleCheck {
    /// Warnings for the user; empty if the sinusoid is accepted.
    pub fn warnings(&self) -> Vec<String> {
        let Some(bias) = self.bias_deg else {
            return vec![
                "the points (S1/S0, S2/S0) form no ring, so the sinusoid model cannot be checked: the map is the angle of \
                 linear polarization, which is the orientation only of gratings of one period without a birefringent film"
                    .into(),
            ];
        };
        let mut warnings = vec![];
        if self.gap_deg > WIDEST_GAP_DEG {
            warnings.push(format!(
                "no orientations over a range of {:.0}° are in view, too few to check the sinusoid model: behind a birefringent \
                 film the map can be wrong by much more than σ says",
                self.gap_deg
            ));
        } else if bias > NEGLIGIBLE_BIAS_DEG {
            warnings.push(format!(
                "the sinusoid model does not hold if this is a grating: (S1/S0, S2/S0) circles ({:.3}, {:.3}) instead of the \
                 origin, as behind a birefringent film; orientations are off by about {bias:.1}° on average, which the σ \
                 of noise does not hold",
                self.center[0], self.center[1]
            ));
        }
        if self.mixed() {
            warnings.push(format!(
                "the strength of the modulation varies by {:.0} % where noise explains {:.0} %: a sample of several periods or \
                 depths has a different offset for each, which shifts orientations against each other by up to about 20°",
                100.0 * self.spread,
                100.0 * self.spread_of_noise
            ));
        }
        warnings
    }

    /// Whether `bias_deg` is the whole systematic error: there is a single ring without large gaps.
    pub fn bias_is_known(&self) -> bool {
        self.bias_deg.is_some() && self.gap_deg <= WIDEST_GAP_DEG && !self.mixed()
    }

    /// Whether the scatter exceeds that of noise.
    fn mixed(&self) -> bool {
        self.spread > MIXED_SPREAD.max(3.0 * self.spread_of_noise)
    }
}

/// Largest gap in the orientations for which the circle is reliable, in degrees.
pub(crate) const WIDEST_GAP_DEG: f64 = 60.0;

/// Relative scatter of the modulation above which the pixels do not share one grating profile.
const MIXED_SPREAD: f64 = 0.05;

/// Relative scatter from which the points form a blob instead of a ring (about 0.5 for a Gaussian).
const NO_RING_SPREAD: f64 = 0.3;

/// Fits the circle to at most 100,000 unmasked pixels; `None` for fewer than 100.
pub fn check_circle(maps: &StokesMaps, map: &OrientationMaps) -> Option<CircleCheck> {
    const PIXELS: usize = 100_000;
    let stride = (maps.s0.len() / PIXELS).max(1);
    let valid: Vec<usize> = (0..maps.s0.len()).step_by(stride).filter(|&i| map.orientation[i].is_finite()).collect();
    let points: Vec<[f64; 2]> =
        valid.iter().map(|&i| [f64::from(maps.s1[i] / maps.s0[i]), f64::from(maps.s2[i] / maps.s0[i])]).collect();
    if points.len() < 100 {
        return None;
    }
    let first = least_squares_circle(&points)?;
    // The second pass excludes outliers (mixed dots, scratches), which bias an algebraic fit.
    let limit = 2.0 * distance_of(0.5, &points, first);
    let near: Vec<_> = points.iter().copied().filter(|p| distance(p, first) <= limit).collect();
    let (center, radius) = least_squares_circle(&near)?;
    let spread = distance_of(0.8, &points, (center, radius)) / 1.2816 / radius;
    // σ(θ) is half the relative error across the modulation, which is about that along it.
    let mut sigma: Vec<f32> = valid.iter().map(|&i| map.sigma[i]).collect();
    let spread_of_noise = 2.0 * f64::from(median(&mut sigma)?);
    let gap_deg = gap(&points, center);
    let bias_deg = (spread < NO_RING_SPREAD).then(|| bias(&points, center));
    Some(CircleCheck { center, radius, spread, spread_of_noise, gap_deg, bias_deg })
}

/// Ratio of the root mean square distance of points from their mean to the mean's distance from the origin, below which
/// the points count as concentrated.
const TOGETHER: f64 = 0.1;

/// Whether points are concentrated away from the origin instead of on a ring: light of nearly uniform polarization,
/// which any circle fits.
pub(crate) fn lie_together(points: &[CloudPoint]) -> bool {
    let points: Vec<[f64; 2]> = points.iter().map(|p| p.at).collect();
    let n = points.len().max(1) as f64;
    let mean = [0, 1].map(|k| points.iter().map(|p| p[k]).sum::<f64>() / n);
    let square = points.iter().map(|p| (p[0] - mean[0]).powi(2) + (p[1] - mean[1]).powi(2)).sum::<f64>() / n;
    let ring = || {
        least_squares_circle(&points).is_some_and(|circle| {
            let spread = distance_of(0.8, &points, circle) / 1.2816 / circle.1;
            spread < NO_RING_SPREAD && gap(&points, circle.0) <= WIDEST_GAP_DEG
        })
    };
    square.sqrt() < TOGETHER * mean[0].hypot(mean[1]) && !ring()
}

/// Centre of the least-squares circle through points, as a start for other fits.
pub(crate) fn circle_center(points: &[CloudPoint]) -> Option<[f64; 2]> {
    let points: Vec<[f64; 2]> = points.iter().map(|p| p.at).collect();
    Some(least_squares_circle(&points)?.0)
}

type Circle = ([f64; 2], f64);

/// Algebraic circle fit: `x² + y² = 2 x cx + 2 y cy + d`.
fn least_squares_circle(points: &[[f64; 2]]) -> Option<Circle> {
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for [x, y] in points {
        let row = Vector3::new(2.0 * x, 2.0 * y, 1.0);
        normal += row * row.transpose();
        right += row * (x * x + y * y);
    }
    let solved = normal.try_inverse()? * right;
    let radius = (solved[2] + solved[0] * solved[0] + solved[1] * solved[1]).sqrt();
    (radius.is_finite() && radius > 0.0).then_some(([solved[0], solved[1]], radius))
}

fn distance(p: &[f64; 2], (c, r): Circle) -> f64 {
    ((p[0] - c[0]).hypot(p[1] - c[1]) - r).abs()
}

/// Quantile of the points' distance from the circle; never 0, so that a perfect circle keeps its points.
fn distance_of(share: f64, points: &[[f64; 2]], circle: Circle) -> f64 {
    let mut distances: Vec<f64> = points.iter().map(|p| distance(p, circle)).collect();
    quantile(&mut distances, share).unwrap_or(0.0) + 1e-9 * circle.1
}

/// Widest run of 10° sectors about the centre that hold less than 0.1 % of the points, in degrees of orientation.
pub(crate) fn gap(points: &[[f64; 2]], center: [f64; 2]) -> f64 {
    const SECTORS: usize = 36;
    let mut count = [0usize; SECTORS];
    for p in points {
        let turn = (p[1] - center[1]).atan2(p[0] - center[0]) / std::f64::consts::TAU;
        count[(turn.rem_euclid(1.0) * SECTORS as f64) as usize % SECTORS] += 1;
    }
    let (mut longest, mut run) = (0, 0);
    // Two turns, so that a run across the end is counted fully.
    for k in 0..2 * SECTORS {
        run = if count[k % SECTORS] * 1000 < points.len() { run + 1 } else { 0 };
        longest = longest.max(run);
    }
    longest.min(SECTORS) as f64 * 180.0 / SECTORS as f64
}

/// Mean absolute half angle between a point's directions from the origin and from the circle's centre, after removal of
/// the mean.
fn bias(points: &[[f64; 2]], center: [f64; 2]) -> f64 {
    let errors: Vec<f64> = points
        .iter()
        .map(|p| {
            let (seen, turned) = (p[1].atan2(p[0]), (p[1] - center[1]).atan2(p[0] - center[0]));
            0.5 * (seen - turned)
        })
        .collect();
    let n = errors.len() as f64;
    let (sin, cos) = errors.iter().fold((0.0, 0.0), |(s, c), e| (s + (2.0 * e).sin(), c + (2.0 * e).cos()));
    let mean = 0.5 * f64::atan2(sin, cos);
    (errors.iter().map(|e| crate::angle_difference(*e, mean).abs()).sum::<f64>() / n).to_degrees()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(center: [f64; 2], radius: f64, share: f64) -> CircleCheck {
        let n = 4000;
        let points: Vec<[f64; 2]> = (0..n)
            .map(|i| {
                let turn = std::f64::consts::TAU * share * f64::from(i) / f64::from(n);
                [center[0] + radius * turn.cos(), center[1] + radius * turn.sin()]
            })
            .collect();
        check_points(&points)
    }

    fn check_points(points: &[[f64; 2]]) -> CircleCheck {
        let n = points.len();
        let s0 = vec![1.0_f32; n];
        let (s1, s2) = (points.iter().map(|p| p[0] as f32).collect(), points.iter().map(|p| p[1] as f32).collect());
        let maps = StokesMaps {
            width: n,
            height: 1,
            residual: s0.clone(),
            correlation: s0.clone(),
            covariance: vec![],
            s0,
            s1,
            s2,
        };
        let map = OrientationMaps { width: n, height: 1, orientation: maps.s0.clone(), sigma: vec![0.001; n] };
        check_circle(&maps, &map).unwrap()
    }

    #[test]
    fn a_centred_circle_raises_no_warning() {
        let c = check([0.0, 0.0], 0.3, 1.0);
        assert!(c.bias_deg.unwrap() < 1e-4 && c.spread < 1e-5 && c.warnings().is_empty(), "{c:?}");
    }

    /// A centre off by ε of the radius changes the phase by ε sin, so the mean orientation error is ε/2 · 2/π.
    #[test]
    fn an_off_centre_circle_states_its_bias() {
        let c = check([0.03, 0.0], 0.3, 1.0);
        let wanted = (0.1_f64 / std::f64::consts::PI).to_degrees();
        assert!((c.bias_deg.unwrap() / wanted - 1.0).abs() < 0.02, "{c:?} {wanted}");
        assert!(c.warnings()[0].contains("film"));
    }

    #[test]
    fn points_without_a_ring_are_not_judged() {
        // A filled disc away from the origin: uniform polarization with noise.
        let points: Vec<[f64; 2]> = (0..4000)
            .map(|i| {
                let (r, turn) = (0.02 * (f64::from(i) / 4000.0).sqrt(), 2.4 * f64::from(i));
                [0.5 + r * turn.cos(), r * turn.sin()]
            })
            .collect();
        let c = check_points(&points);
        assert!(c.bias_deg.is_none() && c.warnings()[0].contains("no ring"), "{c:?}");
    }

    /// Two rings, as of two periods, have no bias but cause a warning.
    #[test]
    fn several_periods_are_warned_of() {
        let points: Vec<[f64; 2]> = (0..4000)
            .map(|i| {
                let (r, turn) = (if i % 2 == 0 { 0.30 } else { 0.24 }, 0.01 * f64::from(i));
                [r * turn.cos(), r * turn.sin()]
            })
            .collect();
        let c = check_points(&points);
        assert!(!c.bias_is_known() && c.warnings().iter().any(|w| w.contains("several periods")), "{c:?}");
    }

    /// A spot and a streak are concentrated; a small ring and a long arc are not.
    #[test]
    fn clustered_points_are_distinguished_from_curves() {
        let cloud = |of: &dyn Fn(f64) -> [f64; 2]| -> Vec<CloudPoint> {
            let at = |i: usize| of(i as f64 / 1000.0);
            (0..1000)
                .map(|pixel| CloudPoint { pixel, at: at(pixel), covariance: [1e-6, 0.0, 1e-6], snr: 100.0 })
                .collect()
        };
        let turn = |t: f64| std::f64::consts::TAU * t;
        let spot = |t: f64| [0.4 + 0.02 * t.sqrt() * (997.0 * t).cos(), 0.3 + 0.02 * t.sqrt() * (997.0 * t).sin()];
        let streak = |t: f64| [0.4 + 0.04 * t, 0.3 + 0.03 * t + 1e-3 * (997.0 * t).sin()];
        let ring = |t: f64| [0.5 + 0.03 * turn(t).cos(), 0.03 * turn(t).sin()];
        let arc = |t: f64| [0.5 * (0.2 * turn(t)).cos(), 0.5 * (0.2 * turn(t)).sin()];
        assert!(lie_together(&cloud(&spot)) && lie_together(&cloud(&streak)));
        assert!(!lie_together(&cloud(&ring)) && !lie_together(&cloud(&arc)));
    }

    #[test]
    fn a_short_arc_cannot_be_checked() {
        assert!(check([0.0, 0.0], 0.3, 0.3).warnings()[0].contains("too few"));
    }
}
