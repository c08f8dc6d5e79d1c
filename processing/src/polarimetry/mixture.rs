//! How likely points are under a curve when the distribution of the orientations in view is fitted as well.
//!
//! Every point comes from some place of the curve, moved by its noise in both directions: its likelihood is the integral of the
//! noise over the curve, weighted by how many orientations are where. The weights of many places are those that make all points
//! likeliest (Kiefer and Wolfowitz 1956), found by expectation and maximization. So curves through the same places are alike,
//! whatever their direction there, and what differs is told by nothing but the points.

use super::cloud::CloudPoint;
use super::curve::Curve;
use super::foot::Path;
use super::places::{LANES, Places, Row, Rows, Run};
use super::repeats::median;
use super::spots::Spots;
use crate::vectors::vectorised;
use rayon::prelude::*;

/// Powers of the gain in a cycle of expectation and maximization: those of Chebyshev's iteration, which go as far as eight
/// rounds of power 1. Powers beyond 2 may lead astray, so that the larger one is halved when it does.
const POWERS: [f32; 2] = [6.83, 1.17];
const CYCLES: usize = 24;

/// A cycle that makes the points likelier by less than this (in ln) is the last.
const SETTLED: f64 = 0.3;

/// Cycles in a row that make points which are held out no likelier, and end a search.
const PATIENCE: usize = 2;

/// The most that a weight changes in a round, as ln.
const LEAP: f32 = 3.0;

/// Share of points on nothing, anywhere in the unit disc (edges, dust), that is begun with.
const STRAYING: f64 = 0.01;

/// Points per task.
const CHUNK: usize = 1024;

/// Least likelihood of a point in units of its own.
const IMPOSSIBLE: f64 = 1e-200;

impl Rows {
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

    /// Sum of ln likelihoods.
    fn likelihood(&self, weights: &Weights) -> f64 {
        let mut total = 0.0;
        vectorised(
            #[inline(always)]
            || self.each(weights, |_, likelihood, _, _| total += likelihood.ln()),
        );
        total
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
#[derive(Clone)]
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

/// A curve as points come from it.
struct Source<'a> {
    curve: &'a Curve,
    path: Path,
    places: Places,
}

impl<'a> Source<'a> {
    /// With places as fine as the noise of these points asks for; None without points.
    fn of(points: &[CloudPoint], curve: &'a Curve) -> Option<Self> {
        let noise = points.iter().map(|p| (0.5 * (p.covariance[0] + p.covariance[2])).sqrt());
        let noise = median(&mut noise.collect::<Vec<f64>>())?;
        Some(Self { curve, path: Path::new(*curve), places: Places::new(curve, noise) })
    }

    /// What points can come from, in chunks of fixed size.
    fn rows(&self, points: &[CloudPoint]) -> Vec<Rows> {
        let of_chunk = |points: &[CloudPoint]| Rows::of(points, self.curve, &self.path, &self.places);
        points.par_chunks(CHUNK).map(of_chunk).collect()
    }

    /// The spots that points lie at, where their weights say so.
    fn spots(&self, weights: &Weights, points: &[CloudPoint]) -> Option<Spots<'a>> {
        let others = [weights.straying, weights.mirror];
        Some(Spots::gathered(self.curve, &self.places, &weights.places, others)?.fitted(points))
    }

    /// How many points there are at each place: those that make the points likeliest.
    fn weights(&self, chunks: &[Rows]) -> Weights {
        let mut search = self.search(chunks);
        let mut before = f64::NEG_INFINITY;
        for _ in 0..CYCLES {
            let total = search.cycle();
            if (total - before).abs() < SETTLED {
                break;
            }
            before = total;
        }
        search.weights
    }

    /// The same, of the rounds of the search those that make other points likeliest: what is fitted to chance makes these less likely, the more the
    /// longer the search goes on, and would be told by nothing but its rounds.
    fn weights_judged(&self, chunks: &[Rows], others: &[Rows]) -> Weights {
        let mut search = self.search(chunks);
        // Places that are all alike may be what holds best, once what strays is known.
        (0..2).for_each(|_| _ = search.round(1.0, false));
        let judged = |weights: &Weights| others.par_iter().map(|rows| rows.likelihood(weights)).sum::<f64>();
        let (mut best, mut weights, mut worse) = (judged(&search.weights), search.weights.clone(), 0);
        for _ in 0..CYCLES {
            search.cycle();
            let now = judged(&search.weights);
            let settled = now < best + SETTLED;
            if now > best {
                (best, weights) = (now, search.weights.clone());
            }
            worse = if settled { worse + 1 } else { 0 };
            if worse == PATIENCE {
                break;
            }
        }
        weights
    }

    fn search<'b>(&self, chunks: &'b [Rows]) -> Search<'b> {
        let mirrors = if self.curve.mirror.is_some() { STRAYING } else { 0.0 };
        let weights = Weights::even(self.places.at.len(), mirrors);
        Search { chunks, weights, powers: POWERS, before: f64::NEG_INFINITY }
    }
}

/// Expectation and maximization.
struct Search<'a> {
    chunks: &'a [Rows],
    weights: Weights,
    powers: [f32; 2],
    /// What the last cycle reached.
    before: f64,
}

impl Search<'_> {
    /// The next rounds; the ln likelihood of the points after the larger power, which the smaller one evens out.
    fn cycle(&mut self) -> f64 {
        self.round(self.powers[0], true);
        let total = self.round(self.powers[1], true);
        if total < self.before {
            self.powers[0] = (0.5 * self.powers[0]).max(1.0);
        }
        self.before = total;
        total
    }

    /// A round, of places only where these are meant, too; the ln likelihood of the points before it.
    fn round(&mut self, power: f32, places: bool) -> f64 {
        let count = self.weights.places.len();
        let points = self.chunks.iter().map(|rows| rows.points.len()).sum::<usize>() as f64;
        // Added in order: the result does not depend on timing.
        let sums: Vec<_> = self.chunks.par_iter().map(|rows| rows.gains(&self.weights)).collect();
        let mut gains = vec![0.0; count];
        for (places, ..) in &sums {
            let rounds = places.chunks(count);
            rounds.for_each(|sums| gains.iter_mut().zip(sums).for_each(|(gain, sum)| *gain += f64::from(*sum)));
        }
        gains.iter_mut().for_each(|gain| *gain = if places { *gain / points } else { 1.0 });
        let others = [0, 1].map(|k| sums.iter().map(|s| s.1[k]).sum::<f64>() / points);
        self.weights.grow(&gains, others, power);
        sums.iter().map(|s| s.2).sum()
    }
}

/// -2 ln likelihood of each point under a curve, where orientations are as many as in the other half of the points: places that are fitted to
/// chance do not help, and a curve that winds more often has more of these.
pub(super) fn terms(points: &[CloudPoint], curve: &Curve) -> Vec<f64> {
    let Some(source) = Source::of(points, curve) else { return vec![] };
    let half = |first: usize| points.iter().skip(first).step_by(2).copied().collect::<Vec<CloudPoint>>();
    let halves = [0, 1].map(half).map(|half| {
        let rows = source.rows(&half);
        (half, rows)
    });
    let mut terms = vec![0.0; points.len()];
    for (first, other) in [(0, 1), (1, 0)] {
        let weights = source.weights_judged(&halves[other].1, &halves[first].1);
        let of_rows = |rows: &Rows| {
            let mut terms = Vec::with_capacity(rows.points.len());
            rows.each(&weights, |row, likelihood, _, _| terms.push(-2.0 * (likelihood.ln() + row.unit)));
            terms
        };
        let mut of_half: Vec<f64> = halves[first].1.par_iter().flat_map_iter(of_rows).collect();
        if let Some(spots) = source.spots(&weights, &halves[other].0) {
            let by_spots = spots.terms(&halves[first].0);
            if by_spots.iter().sum::<f64>() < of_half.iter().sum() {
                of_half = by_spots;
            }
        }
        terms.iter_mut().skip(first).step_by(2).zip(of_half).for_each(|(term, of_half)| *term = of_half);
    }
    terms
}

/// How points pull at a curve.
pub(super) struct Pulls {
    /// -2 ln likelihood of all points.
    pub misfit: f64,
    /// At its places.
    pub places: Vec<Place>,
    /// At metal without a grating.
    pub mirror: [f64; 2],
}

/// A place of a curve, and the slope of the ln likelihood of the points as it moves.
#[derive(Clone, Copy)]
pub(super) struct Place {
    pub theta: f64,
    pub pull: [f64; 2],
}

/// How points pull at a curve: by how likely each of them is from which place, and how far off it is in the metric of its noise.
pub(super) fn pulls(points: &[CloudPoint], curve: &Curve) -> Pulls {
    let none = Pulls { misfit: 0.0, places: vec![], mirror: [0.0; 2] };
    let Some(source) = Source::of(points, curve) else { return none };
    let chunks = source.rows(points);
    let (weights, places, count) = (source.weights(&chunks), &source.places, source.places.at.len());
    let of_chunk = |(rows, points): (&Rows, &[CloudPoint])| {
        let (mut sums, mut mirror, mut misfit) = (vec![[0.0; 2]; count], [0.0; 2], 0.0);
        let mut points = points.iter();
        rows.each(&weights, |row, likelihood, runs, values| {
            misfit -= 2.0 * (likelihood.ln() + row.unit);
            let Some(point) = points.next() else { return };
            let [a, b, c] = point.weights();
            let pull = |at: [f64; 2], share: f64| {
                let [x, y] = [0, 1].map(|k| share * (point.at[k] - at[k]));
                [a * x + b * y, b * x + c * y]
            };
            let add = |sum: &mut [f64; 2], by: [f64; 2]| (0..2).for_each(|k| sum[k] += by[k]);
            let mut left = values;
            for run in runs {
                let (of_run, rest) = left.split_at(run.length);
                left = rest;
                for (i, value) in of_run.iter().enumerate().filter(|(_, v)| **v > 0.0) {
                    let k = (run.start + i) % count;
                    let share = f64::from(*value) * weights.places[k] / likelihood;
                    add(&mut sums[k], pull(places.at[k], share));
                }
            }
            if let Some(at) = curve.mirror {
                add(&mut mirror, pull(at, row.mirror * weights.mirror / likelihood));
            }
        });
        (sums, mirror, misfit)
    };
    let parts: Vec<_> = chunks.par_iter().zip(points.par_chunks(CHUNK)).map(of_chunk).collect();
    let thetas = places.thetas.iter();
    let mut all = Pulls { places: thetas.map(|theta| Place { theta: *theta, pull: [0.0; 2] }).collect(), ..none };
    for (sums, mirror, misfit) in parts {
        all.misfit += misfit;
        (0..2).for_each(|k| all.mirror[k] += mirror[k]);
        all.places.iter_mut().zip(sums).for_each(|(place, sum)| (0..2).for_each(|k| place.pull[k] += sum[k]));
    }
    let of_spots = source.spots(&weights, points).map(|spots| spots.pulls(points));
    of_spots.filter(|pulls| pulls.misfit < all.misfit).unwrap_or(all)
}

#[cfg(test)]
mod tests {
    use super::super::synthetic::normal;
    use super::*;
    use std::f64::consts::TAU;

    /// Orientations spread evenly over a circle: what the other half of the points tells of them costs no more than twice its some 30 places that
    /// noise tells apart, by a sum of the density in double precision; another circle, a fifth of the noise larger, is less likely.
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
        let of = |curve: &Curve| terms(&points, curve).iter().sum::<f64>();
        let circle = |radius: f64| Curve::circle([0.0; 2], radius);
        let (found, other) = (of(&circle(radius)), of(&circle(radius + 0.2 * sigma)));
        assert!((truth - 1.0..truth + 60.0).contains(&found), "{found} {truth}");
        assert!(other > found + 80.0, "{other} {found}");
    }

    /// Orientations spread evenly over a circle of 80 standard deviations, by the density across it: what the thousand places that noise tells apart
    /// take from chance does not count (it did: 1200 for as many, and by a hundred more or less as the search went).
    #[test]
    fn chance_does_not_count() {
        let (radius, sigma, n) = (0.25, 0.003, 20_000);
        let point = |i: u64| {
            let (sin, cos) = (TAU * (i as f64 * 0.618_034).fract()).sin_cos();
            let at = [radius * cos + sigma * normal(1, i), radius * sin + sigma * normal(2, i)];
            CloudPoint { pixel: 0, at, covariance: [sigma * sigma, 0.0, sigma * sigma], snr: 80.0 }
        };
        let points: Vec<CloudPoint> = (0..n).map(point).collect();
        let across = |p: &CloudPoint| ((p.at[0].hypot(p.at[1]) - radius) / sigma).powi(2) + (TAU * sigma * sigma).ln();
        let truth: f64 = points.iter().map(|p| across(p) + 2.0 * (TAU * radius).ln()).sum();
        let of = |radius: f64| terms(&points, &Curve::circle([0.0; 2], radius)).iter().sum::<f64>() - truth;
        let (found, others) = (of(radius), [0.99, 1.01].map(|by| of(by * radius)));
        assert!(found.abs() < 5.0, "{found}");
        // Farther off by 0.0025 each: 20,000 (0.0025 / 0.003)².
        assert!(others.iter().all(|other| (other / 13_889.0 - 1.0).abs() < 0.02), "{others:?}");
    }

    /// What pulls at places is the slope of the likelihood: of a circle that is too large, as it grows, to 5 % (weights end 0.3 from their best,
    /// of the 90 that the likelihood changes by).
    #[test]
    fn pulls_are_the_slope_of_the_likelihood() {
        let (radius, sigma, n) = (0.25, 0.05, 4000);
        let point = |i: u64| {
            let (sin, cos) = (TAU * (i as f64 * 0.618_034).fract()).sin_cos();
            let at = [radius * cos + sigma * normal(1, i), radius * sin + sigma * normal(2, i)];
            CloudPoint { pixel: 0, at, covariance: [sigma * sigma, 0.0, sigma * sigma], snr: 5.0 }
        };
        let points: Vec<CloudPoint> = (0..n).map(point).collect();
        let of = |radius: f64| pulls(&points, &Curve::circle([0.0; 2], radius));
        let (at, by) = (radius + 0.3 * sigma, 0.02 * sigma);
        let slope = (of(at + by).misfit - of(at - by).misfit) / (2.0 * by);
        let outward = |p: &Place| p.pull[0] * (2.0 * p.theta).cos() + p.pull[1] * (2.0 * p.theta).sin();
        let pulled = -2.0 * of(at).places.iter().map(outward).sum::<f64>();
        assert!(slope > 0.0 && (pulled / slope - 1.0).abs() < 0.05, "{pulled} {slope}");
    }
}
