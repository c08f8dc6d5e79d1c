//! Likelihood of points under a curve, with the distribution of orientations fitted too (nonparametric maximum
//! likelihood).
//!
//! Every point comes from a position on the curve, displaced by two-dimensional noise. Its likelihood is the integral
//! of the noise density over the curve, weighted by the distribution of orientations. The weights of many support
//! points maximise the likelihood of all points (Kiefer and Wolfowitz 1956), found by expectation maximisation. Curves
//! through the same support points are therefore equally likely, regardless of their direction there, and only the
//! points distinguish curves. For comparisons of curves, each half of the points is evaluated under the weights of the
//! other half.

use crate::film::cloud::CloudPoint;
use crate::film::curve::Curve;
use crate::film::discrete_orientations::DiscreteOrientations;
use crate::film::mixing_weights::MixingWeights;
use crate::film::projection::CurveSamples;
use crate::film::score::{Score, SupportScore};
use crate::film::support_points::{LikelihoodRows, SupportPoints};
use nacre_base::statistics::median;
use rayon::prelude::*;

/// Points per task.
const CHUNK: usize = 1024;

/// Model of the points as samples from a curve.
struct Mixture<'a> {
    curve: &'a Curve,
    curve_samples: CurveSamples,
    support: SupportPoints,
}

impl<'a> Mixture<'a> {
    /// Support points with the spacing required by the noise of these points; `None` without points.
    fn of(points: &[CloudPoint], curve: &'a Curve) -> Option<Self> {
        let noise = points.iter().map(|p| (0.5 * (p.covariance[0] + p.covariance[2])).sqrt());
        let noise = median(&mut noise.collect::<Vec<f64>>())?;
        Some(Self { curve, curve_samples: CurveSamples::new(*curve), support: SupportPoints::new(curve, noise) })
    }

    /// Likelihood rows of the points, in chunks of fixed size.
    fn rows(&self, points: &[CloudPoint]) -> Vec<LikelihoodRows> {
        let of_chunk =
            |points: &[CloudPoint]| LikelihoodRows::of(points, self.curve, &self.curve_samples, &self.support);
        points.par_chunks(CHUNK).map(of_chunk).collect()
    }

    /// The discrete orientations at which the weights concentrate, if they do.
    fn discrete(&self, weights: &MixingWeights, points: &[CloudPoint]) -> Option<DiscreteOrientations<'a>> {
        let others = [weights.outlier, weights.mirror];
        Some(DiscreteOrientations::from_weights(self.curve, &self.support, &weights.support, others)?.fit(points))
    }
}

/// −2 ln likelihood of each point under a curve, with the distribution of orientations of the other half of the points.
/// Held-out points prevent an advantage from weights fitted to noise, of which a longer curve has more.
pub(crate) fn terms(points: &[CloudPoint], curve: &Curve) -> Vec<f64> {
    let Some(mixture) = Mixture::of(points, curve) else { return vec![] };
    let half = |first: usize| points.iter().skip(first).step_by(2).copied().collect::<Vec<CloudPoint>>();
    let halves = [0, 1].map(half).map(|half| {
        let rows = mixture.rows(&half);
        (half, rows)
    });
    let mut terms = vec![0.0; points.len()];
    for (first, other) in [(0, 1), (1, 0)] {
        let weights = MixingWeights::held_out(
            &halves[other].1,
            &halves[first].1,
            mixture.support.at.len(),
            curve.mirror.is_some(),
        );
        let of_rows = |rows: &LikelihoodRows| {
            let mut terms = Vec::with_capacity(rows.points.len());
            rows.for_each_point(&weights, |row, likelihood, _, _| terms.push(-2.0 * (likelihood.ln() + row.unit)));
            terms
        };
        let mut of_half: Vec<f64> = halves[first].1.par_iter().flat_map_iter(of_rows).collect();
        if let Some(discrete) = mixture.discrete(&weights, &halves[other].0) {
            let by_discrete = discrete.terms(&halves[first].0);
            if by_discrete.iter().sum::<f64>() < of_half.iter().sum() {
                of_half = by_discrete;
            }
        }
        terms.iter_mut().skip(first).step_by(2).zip(of_half).for_each(|(term, of_half)| *term = of_half);
    }
    terms
}

/// Score of the points with respect to displacements of a curve: posterior probability of each support point times the
/// deviation in the metric of the noise.
pub(crate) fn score(points: &[CloudPoint], curve: &Curve) -> Score {
    let none = Score { misfit: 0.0, support: vec![], mirror: [0.0; 2] };
    let Some(mixture) = Mixture::of(points, curve) else { return none };
    let chunks = mixture.rows(points);
    let (support, count) = (&mixture.support, mixture.support.at.len());
    let weights = MixingWeights::max_likelihood(&chunks, count, curve.mirror.is_some());
    let of_chunk = |(rows, points): (&LikelihoodRows, &[CloudPoint])| {
        let (mut sums, mut mirror, mut misfit) = (vec![[0.0; 2]; count], [0.0; 2], 0.0);
        let mut points = points.iter();
        rows.for_each_point(&weights, |row, likelihood, runs, values| {
            misfit -= 2.0 * (likelihood.ln() + row.unit);
            let Some(point) = points.next() else { return };
            let [a, b, c] = point.weights();
            let score = |at: [f64; 2], share: f64| {
                let [x, y] = [0, 1].map(|k| share * (point.at[k] - at[k]));
                [a * x + b * y, b * x + c * y]
            };
            let add = |sum: &mut [f64; 2], by: [f64; 2]| (0..2).for_each(|k| sum[k] += by[k]);
            let mut unread = values;
            for run in runs {
                let (of_run, rest) = unread.split_at(run.length);
                unread = rest;
                for (i, value) in of_run.iter().enumerate().filter(|(_, v)| **v > 0.0) {
                    let k = (run.start + i) % count;
                    let share = f64::from(*value) * weights.support[k] / likelihood;
                    add(&mut sums[k], score(support.at[k], share));
                }
            }
            if let Some(at) = curve.mirror {
                add(&mut mirror, score(at, row.mirror * weights.mirror / likelihood));
            }
        });
        (sums, mirror, misfit)
    };
    let parts: Vec<_> = chunks.par_iter().zip(points.par_chunks(CHUNK)).map(of_chunk).collect();
    let thetas = support.thetas.iter();
    let mut all =
        Score { support: thetas.map(|theta| SupportScore { theta: *theta, score: [0.0; 2] }).collect(), ..none };
    for (sums, mirror, misfit) in parts {
        all.misfit += misfit;
        (0..2).for_each(|k| all.mirror[k] += mirror[k]);
        all.support.iter_mut().zip(sums).for_each(|(support, sum)| (0..2).for_each(|k| support.score[k] += sum[k]));
    }
    let of_discrete = mixture.discrete(&weights, points).map(|discrete| discrete.score(points));
    of_discrete.filter(|score| score.misfit < all.misfit).unwrap_or(all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::normal;
    use std::f64::consts::TAU;

    /// Points of uniformly distributed orientations on a circle about the origin.
    fn on_circle(radius: f64, sigma: f64, count: u64) -> Vec<CloudPoint> {
        let point = |i: u64| {
            let (sin, cos) = (TAU * (i as f64 * 0.618_034).fract()).sin_cos();
            let at = [radius * cos + sigma * normal(1, i), radius * sin + sigma * normal(2, i)];
            CloudPoint { pixel: 0, at, covariance: [sigma * sigma, 0.0, sigma * sigma], snr: radius / sigma }
        };
        (0..count).map(point).collect()
    }

    /// Uniformly distributed orientations on a circle, against a direct sum of the density in double precision. Weights
    /// from the other half of the points cost 2 (weights fitted to the same half gain 11). Another circle, larger by a
    /// fifth of the noise, is less likely.
    #[test]
    fn likelihood_equals_a_direct_sum() {
        let (radius, sigma, n) = (0.25, 0.05, 4000);
        let points = on_circle(radius, sigma, n);
        let direct = |p: &CloudPoint| {
            let density = |k: u32| {
                let (sin, cos) = (TAU * f64::from(k) / 512.0).sin_cos();
                let square = (p.at[0] - radius * cos).powi(2) + (p.at[1] - radius * sin).powi(2);
                (-0.5 * square / (sigma * sigma)).exp() / (TAU * sigma * sigma)
            };
            -2.0 * (0..512).map(density).sum::<f64>().ln() + 2.0 * 512f64.ln()
        };
        let truth: f64 = points.iter().map(direct).sum();
        let of = |curve: &Curve| terms(&points, curve).iter().sum::<f64>();
        let circle = |radius: f64| Curve::circle([0.0; 2], radius);
        let (found, other) = (of(&circle(radius)), of(&circle(radius + 0.2 * sigma)));
        assert!((truth - 1.0..truth + 6.0).contains(&found), "{found} {truth}");
        assert!(other > found + 80.0, "{other} {found}");
    }

    /// Uniformly distributed orientations on a circle of 80 standard deviations, against the density across it: the fit
    /// of a thousand support points to noise must not count. In-sample weights gain 560, and 110 less for another curve
    /// whose search ended differently.
    #[test]
    fn noise_does_not_increase_the_likelihood() {
        let (radius, sigma, n) = (0.25, 0.003, 20_000);
        let points = on_circle(radius, sigma, n);
        let across = |p: &CloudPoint| ((p.at[0].hypot(p.at[1]) - radius) / sigma).powi(2) + (TAU * sigma * sigma).ln();
        let truth: f64 = points.iter().map(|p| across(p) + 2.0 * (TAU * radius).ln()).sum();
        let of = |radius: f64| terms(&points, &Curve::circle([0.0; 2], radius)).iter().sum::<f64>() - truth;
        let (found, others) = (of(radius), [0.99, 1.01].map(|by| of(by * radius)));
        assert!(found.abs() < 5.0, "{found}");
        // Deviations increase by 0.0025 each: 20,000 (0.0025 / 0.003)².
        assert!(others.iter().all(|other| (other / 13_889.0 - 1.0).abs() < 0.02), "{others:?}");
    }

    /// The score is the derivative of the likelihood. It is compared for a circle that is too large, with respect to
    /// its radius, to 5 % (the weights end 0.3 below their maximum; the likelihood changes by 90).
    #[test]
    fn score_is_the_derivative_of_the_likelihood() {
        let (radius, sigma, n) = (0.25, 0.05, 4000);
        let points = on_circle(radius, sigma, n);
        let of = |radius: f64| score(&points, &Curve::circle([0.0; 2], radius));
        let (at, by) = (radius + 0.3 * sigma, 0.02 * sigma);
        let slope = (of(at + by).misfit - of(at - by).misfit) / (2.0 * by);
        let outward = |p: &SupportScore| p.score[0] * (2.0 * p.theta).cos() + p.score[1] * (2.0 * p.theta).sin();
        let scored = -2.0 * of(at).support.iter().map(outward).sum::<f64>();
        assert!(slope > 0.0 && (scored / slope - 1.0).abs() < 0.05, "{scored} {slope}");
    }
}
