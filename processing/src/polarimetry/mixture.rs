//! How likely points are under a curve when the distribution of the orientations in view is fitted as well.
//!
//! Every point comes from some place of the curve, moved by its noise in both directions: its likelihood is the integral of the
//! noise over the curve, weighted by how many orientations are where. The weights of many places are those that make all points
//! likeliest (Kiefer and Wolfowitz 1956), found by expectation and maximization. So curves through the same places are alike,
//! whatever their direction there, and what differs is told by nothing but the points.

use super::cloud::CloudPoint;
use super::curve::Curve;
use super::foot::{Foot, Path};
use crate::vectors::vectorised;
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
const POWERS: [f32; 2] = [6.83, 1.17];
const CYCLES: usize = 24;

/// A cycle that makes the points likelier by less than this (in ln) is the last.
const SETTLED: f64 = 0.3;

/// The most that a weight changes in a round, as ln.
const LEAP: f32 = 3.0;

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

/// ln of a normal density in two dimensions, as a function of how far off.
fn log_density([a, b, c]: [f64; 3]) -> impl Fn([f64; 2]) -> f64 {
    let determinant = a * c - b * b;
    let [xx, xy, yy] = [c, -2.0 * b, a].map(|v| -0.5 * v / determinant);
    let middle = -0.5 * determinant.ln() - TAU.ln();
    move |[x, y]| middle + xx * x * x + xy * x * y + yy * y * y
}

/// What a few points can come from: for each of them runs of places with how likely each place makes it, one after the other.
#[derive(Default)]
struct Rows {
    points: Vec<Row>,
    runs: Vec<Run>,
    /// In single precision: sums of positive numbers lose no more to it than their last digits.
    values: Vec<f32>,
}

/// A point. Likelihoods are in units of its own.
struct Row {
    /// ln of the unit.
    unit: f64,
    /// Those of a point on nothing, and of metal without a grating.
    straying: f64,
    mirror: f64,
    /// How many runs it has.
    runs: usize,
}

/// Places in a row, the number of which is a multiple of [`LANES`]: those beyond the end of the run are impossible. They go on after the last
/// place as after all places came once more.
struct Run {
    start: usize,
    length: usize,
}

/// Least likelihood of a point in units of its own.
const IMPOSSIBLE: f64 = 1e-200;

/// Numbers that are worked on side by side.
const LANES: usize = 8;

impl Rows {
    fn of(points: &[CloudPoint], curve: &Curve, path: &Path, places: &Places) -> Self {
        let mut rows = Self::default();
        let mut logs = vec![];
        points.iter().for_each(|point| rows.add(point, curve, path, places, &mut logs));
        rows
    }

    fn add(&mut self, point: &CloudPoint, curve: &Curve, path: &Path, places: &Places, logs: &mut Vec<f64>) {
        let (count, first_run) = (places.at.len(), self.runs.len());
        let density = log_density(point.covariance);
        let [a, b, c] = point.covariance;
        logs.clear();
        for Foot { theta, gradient: [x, y], .. } in path.feet_within(point, REACH) {
            let along = ((a * c - b * b) * (x * x + y * y)).sqrt();
            let reach = (REACH * along / places.step + 2.0).min(0.5 * count as f64);
            let first = (places.of(theta) - reach).floor().rem_euclid(count as f64) as usize % count;
            let (known, length) = (first_run..self.runs.len(), ((2.0 * reach) as usize + 1).min(count));
            let mut begun = None;
            for i in 0..=length {
                let k = (first + i) % count;
                let is_known = |run: &Run| (k + count - run.start) % count < run.length;
                if i == length || self.runs[known.clone()].iter().any(is_known) {
                    if let Some((start, from)) = begun.take() {
                        self.runs.push(Run { start, length: i - from });
                    }
                    continue;
                }
                begun.get_or_insert((k, i));
                logs.push(density([point.at[0] - places.at[k][0], point.at[1] - places.at[k][1]]));
            }
        }
        let of_mirror = curve.mirror.map(|m| density([point.at[0] - m[0], point.at[1] - m[1]]));
        let of_straying = -PI.ln();
        let unit = logs.iter().copied().fold(of_straying, f64::max).max(of_mirror.unwrap_or(f64::NEG_INFINITY));
        let mut logs = logs.iter();
        for run in &mut self.runs[first_run..] {
            self.values.extend(logs.by_ref().take(run.length).map(|l| (l - unit).exp() as f32));
            let padded = run.length.next_multiple_of(LANES);
            self.values.extend(std::iter::repeat_n(0.0, padded - run.length));
            run.length = padded;
        }
        self.points.push(Row {
            unit,
            straying: (of_straying - unit).exp(),
            mirror: of_mirror.map_or(0.0, |l| (l - unit).exp()),
            runs: self.runs.len() - first_run,
        });
    }

    /// Does something with each point and its likelihood, its runs and their values.
    #[inline(always)]
    fn each(&self, weights: &Weights, mut work: impl FnMut(&Row, f64, &[Run], &[f32])) {
        let (mut runs, mut values) = (self.runs.as_slice(), self.values.as_slice());
        for row in &self.points {
            let (own, rest) = runs.split_at(row.runs);
            let (of_runs, others) = values.split_at(own.iter().map(|run| run.length).sum());
            (runs, values) = (rest, others);
            let mut sums = [0.0_f32; LANES];
            let mut left = of_runs;
            for run in own {
                let (of_run, rest) = left.split_at(run.length);
                left = rest;
                let weights = &weights.twice[run.start..][..run.length];
                let pairs = of_run.as_chunks::<LANES>().0.iter().zip(weights.as_chunks::<LANES>().0);
                pairs.for_each(|(v, w)| (0..LANES).for_each(|i| sums[i] += v[i] * w[i]));
            }
            let places = f64::from(sums.iter().sum::<f32>());
            let likelihood = places + row.straying * weights.straying + row.mirror * weights.mirror;
            work(row, likelihood.max(IMPOSSIBLE), own, of_runs);
        }
    }

    /// Sums over points of what each place adds to their likelihood, over it; the same of straying and of mirrors; and the sum of ln likelihoods.
    fn gains(&self, weights: &Weights) -> (Vec<f32>, [f64; 2], f64) {
        let mut sums = vec![0.0_f32; weights.twice.len()];
        let (mut others, mut total, mut product) = ([0.0; 2], 0.0, 1.0);
        vectorised(
            #[inline(always)]
            || {
                self.each(weights, |row, likelihood, runs, values| {
                    // What is farther from all that is likely counts as much as this.
                    let scale = 1.0 / likelihood.max(1e-30);
                    let mut left = values;
                    for run in runs {
                        let (of_run, rest) = left.split_at(run.length);
                        left = rest;
                        let sums = &mut sums[run.start..][..run.length];
                        let pairs = of_run.as_chunks::<LANES>().0.iter().zip(sums.as_chunks_mut::<LANES>().0);
                        pairs.for_each(|(v, s)| (0..LANES).for_each(|i| s[i] += v[i] * scale as f32));
                    }
                    others[0] += row.straying * scale;
                    others[1] += row.mirror * scale;
                    // The logarithm of a product takes as long as that of one number.
                    product *= likelihood;
                    if !(1e-100..1e100).contains(&product) {
                        total += product.ln();
                        product = 1.0;
                    }
                });
            },
        );
        (sums, others, total + product.ln())
    }
}

/// How many points there are at each place.
struct Weights {
    places: Vec<f64>,
    straying: f64,
    mirror: f64,
    /// Those of places twice over, and some more, so that no run ends before its last place.
    twice: Vec<f32>,
}

impl Weights {
    fn even(count: usize, mirrors: f64) -> Self {
        let each = (1.0 - STRAYING - mirrors) / count as f64;
        let mut weights = Self {
            places: vec![each; count],
            straying: STRAYING,
            mirror: mirrors,
            twice: vec![0.0; 2 * count + LANES],
        };
        weights.doubled();
        weights
    }

    fn doubled(&mut self) {
        // Numbers below are slow, and their places do not matter.
        let single = |w: &f64| if *w > 1e-30 { *w as f32 } else { 0.0 };
        self.twice.iter_mut().zip(self.places.iter().cycle()).for_each(|(to, w)| *to = single(w));
    }

    /// Multiplies them by a power of their gains, and makes them add up to 1.
    fn grow(&mut self, gains: &[f64], [straying, mirror]: [f64; 2], power: f32) {
        // There may be thousands of places, and single precision has the faster power.
        let by = |gain: f64| f64::from((gain as f32).powf(power).clamp((-LEAP).exp(), LEAP.exp()));
        self.places.iter_mut().zip(gains).for_each(|(w, gain)| *w *= by(*gain));
        self.straying *= by(straying);
        self.mirror *= by(mirror);
        let sum = self.places.iter().sum::<f64>() + self.straying + self.mirror;
        self.places.iter_mut().chain([&mut self.straying, &mut self.mirror]).for_each(|w| *w /= sum);
        self.doubled();
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
    // Of fixed size, added in order: the result does not depend on timing.
    let chunks: Vec<Rows> = points.par_chunks(CHUNK).map(|points| Rows::of(points, curve, &path, &places)).collect();
    let mut weights = Weights::even(count, if curve.mirror.is_some() { STRAYING } else { 0.0 });
    let mut before = f64::NEG_INFINITY;
    for _ in 0..CYCLES {
        let mut total = 0.0;
        for power in POWERS {
            let sums: Vec<_> = chunks.par_iter().map(|rows| rows.gains(&weights)).collect();
            let mean = |sum: f64| sum / points.len() as f64;
            let mut gains = vec![0.0; count];
            for (places, ..) in &sums {
                let rounds = places.chunks(count);
                rounds.for_each(|sums| gains.iter_mut().zip(sums).for_each(|(gain, sum)| *gain += f64::from(*sum)));
            }
            gains.iter_mut().for_each(|gain| *gain = mean(*gain));
            let others = [0, 1].map(|k| mean(sums.iter().map(|s| s.1[k]).sum()));
            weights.grow(&gains, others, power);
            total = sums.iter().map(|s| s.2).sum();
        }
        // That after the larger power, which the smaller one evens out.
        if (total - before).abs() < SETTLED {
            break;
        }
        before = total;
    }
    let of_rows = |rows: &Rows| {
        let mut terms = Vec::with_capacity(rows.points.len());
        rows.each(&weights, |row, likelihood, _, _| terms.push(-2.0 * (likelihood.ln() + row.unit)));
        terms
    };
    chunks.par_iter().flat_map_iter(of_rows).collect()
}

#[cfg(test)]
mod tests {
    use super::super::synthetic::normal;
    use super::*;

    /// Orientations spread evenly over a circle: what is fitted is at least as likely as the density summed up plainly in double precision, and
    /// not by more than its some 30 places that noise tells apart can gain by chance; another circle, a fifth of the noise larger, is not.
    #[test]
    fn points_are_as_likely_as_a_plain_sum_says() {
        let (radius, sigma, n) = (0.25, 0.05, 4000);
        let point = |i: u64| {
            let (sin, cos) = (TAU * (i as f64 * 0.618_034).fract()).sin_cos();
            let at = [radius * cos + sigma * normal(1, i), radius * sin + sigma * normal(2, i)];
            CloudPoint { pixel: 0, at, covariance: [sigma * sigma, 0.0, sigma * sigma], snr: 5.0 }
        };
        let points: Vec<CloudPoint> = (0..n).map(point).collect();
        let plainly = |p: &CloudPoint| {
            let density = |k: u32| {
                let (sin, cos) = (TAU * f64::from(k) / 512.0).sin_cos();
                let square = (p.at[0] - radius * cos).powi(2) + (p.at[1] - radius * sin).powi(2);
                (-0.5 * square / (sigma * sigma)).exp() / (TAU * sigma * sigma)
            };
            -2.0 * (0..512).map(density).sum::<f64>().ln() + 2.0 * 512f64.ln()
        };
        let truth: f64 = points.iter().map(plainly).sum();
        let of = |radius: f64| terms(&points, &Curve::circle([0.0; 2], radius)).iter().sum::<f64>();
        let (found, other) = (of(radius), of(radius + 0.2 * sigma));
        assert!((truth - 60.0..truth + 1.0).contains(&found), "{found} {truth}");
        assert!(other > found + 80.0, "{other} {found}");
    }
}
