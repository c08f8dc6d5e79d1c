//! How likely points are under a curve when the distribution of the orientations in view is fitted as well.
//!
//! Every point comes from some place of the curve, moved by its noise in both directions: its likelihood is the integral of the
//! noise over the curve, weighted by how many orientations are where. The weights of many places are those that make all points
//! likeliest (Kiefer and Wolfowitz 1956), found by expectation and maximization. So curves through the same places are alike,
//! whatever their direction there, and what differs is told by nothing but the points.

use super::cloud::CloudPoint;
use super::curve::Curve;
use super::foot::{Foot, Path};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Stretches of the curve whose lengths are added up.
const STRETCHES: usize = 1024;

/// Distance of places in standard deviations of a typical point, and how many places there are at least and at most.
const SPACING: f64 = 0.5;
const FEWEST: usize = 64;
const MOST: usize = 8192;

/// Places farther from a point than so many standard deviations do not count.
const REACH: f64 = 6.0;

/// Powers of the gain in a cycle of expectation and maximization: those of Chebyshev's iteration, which go as far as eight
/// rounds of power 1. More at once leads astray where orientations are spread evenly.
const POWERS: [f64; 2] = [6.83, 1.17];
const CYCLES: usize = 24;

/// A cycle that makes the points likelier by less than this (in ln) is the last.
const SETTLED: f64 = 0.3;

/// The most that a weight changes in a round, as ln.
const LEAP: f64 = 3.0;

/// Share of points on nothing, anywhere in the unit disc (edges, dust), that is begun with.
const STRAYING: f64 = 0.01;

/// Points per task.
const CHUNK: usize = 1024;

/// Places along a curve at equal distances.
struct Places {
    at: Vec<[f64; 2]>,
    /// Length of the curve up to the beginning of each stretch, in places.
    index: Vec<f64>,
    /// Distance of places.
    step: f64,
}

impl Places {
    fn new(curve: &Curve, noise: f64) -> Self {
        let turn = PI / STRETCHES as f64;
        let mut length = vec![0.0; STRETCHES + 1];
        for k in 0..STRETCHES {
            let (_, t) = curve.with_tangent((k as f64 + 0.5) * turn);
            length[k + 1] = length[k] + t[0].hypot(t[1]) * turn;
        }
        let total = length[STRETCHES].max(f64::MIN_POSITIVE);
        let count = ((total / (SPACING * noise)) as usize).clamp(FEWEST, MOST);
        let step = total / count as f64;
        let (mut at, mut k) = (Vec::with_capacity(count), 0);
        for i in 0..count {
            let wanted = (i as f64 + 0.5) * step;
            while k + 1 < STRETCHES && length[k + 1] < wanted {
                k += 1;
            }
            let part = (wanted - length[k]) / (length[k + 1] - length[k]).max(f64::MIN_POSITIVE);
            at.push(curve.at((k as f64 + part.clamp(0.0, 1.0)) * turn));
        }
        Self { at, index: length.iter().map(|l| l / step).collect(), step }
    }

    /// Place of an orientation in rad, in places.
    fn of(&self, theta: f64) -> f64 {
        let turn = theta.rem_euclid(PI) / PI * STRETCHES as f64;
        let k = (turn as usize).min(STRETCHES - 1);
        self.index[k] + (self.index[k + 1] - self.index[k]) * (turn - k as f64)
    }
}

/// What a point can come from: places in a row, with how likely each makes it.
struct Row {
    /// ln of what all are in units of.
    unit: f64,
    /// Runs of places, the first and how many, and where their numbers begin.
    runs: Vec<(usize, usize)>,
    values: Vec<f32>,
    /// The same of a point on nothing, and of metal without a grating.
    straying: f64,
    mirror: f64,
}

/// ln of a normal density.
fn log_density([x, y]: [f64; 2], [va, vb, vc]: [f64; 3]) -> f64 {
    let determinant = va * vc - vb * vb;
    let square = (vc * x * x - 2.0 * vb * x * y + va * y * y) / determinant;
    -0.5 * (square + determinant.ln()) - TAU.ln()
}

impl Row {
    fn new(point: &CloudPoint, curve: &Curve, path: &Path, places: &Places) -> Self {
        let count = places.at.len();
        let mut runs: Vec<(usize, usize)> = vec![];
        let mut logs: Vec<f64> = vec![];
        for Foot { theta, gradient: [x, y], .. } in path.feet_within(point, REACH) {
            let [a, b, c] = point.covariance;
            let along = ((a * c - b * b) * (x * x + y * y)).sqrt();
            let reach = (REACH * along / places.step + 2.0).min(0.5 * count as f64);
            let middle = places.of(theta);
            let first = (middle - reach).floor().rem_euclid(count as f64) as usize % count;
            let (mut begun, length) = (None, ((2.0 * reach) as usize + 1).min(count));
            let known = runs.clone();
            let is_known = |k: usize| known.iter().any(|(start, len)| (k + count - start) % count < *len);
            for i in 0..=length {
                let k = (first + i) % count;
                if i == length || is_known(k) {
                    if let Some(start) = begun.take() {
                        runs.push((start, (k + count - start - 1) % count + 1));
                    }
                    continue;
                }
                begun.get_or_insert(k);
                let off = [point.at[0] - places.at[k][0], point.at[1] - places.at[k][1]];
                logs.push(log_density(off, point.covariance));
            }
        }
        let of_mirror = curve.mirror.map(|m| log_density([point.at[0] - m[0], point.at[1] - m[1]], point.covariance));
        let of_straying = -PI.ln();
        let unit = logs.iter().copied().fold(of_straying, f64::max).max(of_mirror.unwrap_or(f64::NEG_INFINITY));
        Self {
            unit,
            runs,
            values: logs.into_iter().map(|l| (l - unit).exp() as f32).collect(),
            straying: (of_straying - unit).exp(),
            mirror: of_mirror.map_or(0.0, |l| (l - unit).exp()),
        }
    }

    /// Does something with each place and its number.
    #[inline]
    fn each(&self, count: usize, mut work: impl FnMut(usize, f64)) {
        let mut values = self.values.iter();
        for (start, length) in &self.runs {
            let (first, second) = (*start..(start + length).min(count), 0..(start + length).saturating_sub(count));
            for (k, value) in first.chain(second).zip(values.by_ref().take(*length)) {
                work(k, f64::from(*value));
            }
        }
    }

    /// Likelihood in units of its own.
    fn likelihood(&self, weights: &[f64]) -> f64 {
        let count = weights.len() - 2;
        let mut sum = self.straying * weights[count] + self.mirror * weights[count + 1];
        self.each(count, |k, value| sum += value * weights[k]);
        sum.max(f64::MIN_POSITIVE)
    }
}

/// -2 ln likelihood of each point under a curve.
pub(super) fn terms(points: &[CloudPoint], curve: &Curve) -> Vec<f64> {
    let mut noise: Vec<f64> = points.iter().map(|p| (0.5 * (p.covariance[0] + p.covariance[2])).sqrt()).collect();
    let middle = noise.len() / 2;
    if noise.is_empty() {
        return vec![];
    }
    let noise = *noise.select_nth_unstable_by(middle, f64::total_cmp).1;
    let (path, places) = (Path::new(*curve), Places::new(curve, noise));
    let count = places.at.len();
    let rows: Vec<Row> = points.par_iter().with_min_len(256).map(|p| Row::new(p, curve, &path, &places)).collect();
    let mirrors = if curve.mirror.is_some() { STRAYING } else { 0.0 };
    let mut weights = vec![(1.0 - STRAYING - mirrors) / count as f64; count];
    weights.extend([STRAYING, mirrors]);
    let gains = |weights: &[f64]| -> (Vec<f64>, f64) {
        let of_chunk = |rows: &[Row]| {
            let (mut sums, mut total) = (vec![0.0; count + 2], 0.0);
            for row in rows {
                let likelihood = row.likelihood(weights);
                let scale = 1.0 / likelihood;
                total += likelihood.ln();
                row.each(count, |k, value| sums[k] += value * scale);
                sums[count] += row.straying * scale;
                sums[count + 1] += row.mirror * scale;
            }
            (sums, total)
        };
        // Chunks of fixed size, added in order: the result does not depend on timing.
        let sums: Vec<(Vec<f64>, f64)> = rows.par_chunks(CHUNK).map(of_chunk).collect();
        let gain = |k: usize| sums.iter().map(|s| s.0[k]).sum::<f64>() / rows.len() as f64;
        ((0..count + 2).map(gain).collect(), sums.iter().map(|s| s.1).sum())
    };
    let mut before = f64::NEG_INFINITY;
    for _ in 0..CYCLES {
        let mut total = 0.0;
        for power in POWERS {
            let gain;
            (gain, total) = gains(&weights);
            for (weight, gain) in weights.iter_mut().zip(&gain) {
                *weight *= (power * gain.max(f64::MIN_POSITIVE).ln()).clamp(-LEAP, LEAP).exp();
            }
            let sum: f64 = weights.iter().sum();
            weights.iter_mut().for_each(|w| *w /= sum);
        }
        // That after the larger power, which the smaller one evens out.
        if (total - before).abs() < SETTLED {
            break;
        }
        before = total;
    }
    rows.par_iter().map(|row| -2.0 * (row.likelihood(&weights).ln() + row.unit)).collect()
}
