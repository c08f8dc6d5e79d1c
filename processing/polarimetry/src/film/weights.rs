//! Mixing weights of the support points of a curve, fitted by expectation maximisation to the points themselves or to
//! held-out points of the same distribution.

use crate::film::places::{LANES, Row, Rows, Run};
use nacre_base::parallel::sum_in_order;
use nacre_base::vectors::vectorised;
use rayon::prelude::*;

/// Exponents of the gain in a cycle of expectation maximisation, from Chebyshev's iteration; a cycle is equivalent to
/// eight iterations with exponent 1. Exponents above 2 may diverge, in which case the larger one is halved.
const POWERS: [f32; 2] = [6.83, 1.17];
const CYCLES: usize = 24;

/// Gain in ln likelihood below which the cycles end.
const SETTLED: f64 = 0.3;

/// Consecutive cycles without gain on held-out points after which a search ends.
const PATIENCE: usize = 2;

/// Largest change of a weight in an iteration, as ln.
const LEAP: f32 = 3.0;

/// Initial share of outliers (edges, dust), uniform in the unit disc.
const STRAYING: f64 = 0.01;

/// Smallest likelihood of a point in its own unit.
const IMPOSSIBLE: f64 = 1e-200;

impl Rows {
    /// Calls `work` with each point and its likelihood, its runs and their values.
    #[inline(always)]
    pub fn each(&self, weights: &Weights, mut work: impl FnMut(&Row, f64, &[Run], &[f32])) {
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

    /// Sums over points of the relative contribution of each support point to their likelihood, the same for outliers
    /// and bare metal, and the sum of ln likelihoods.
    fn gains(&self, weights: &Weights) -> (Vec<f32>, [f64; 2], f64) {
        let mut sums = vec![0.0_f32; weights.twice.len()];
        let (mut others, mut total, mut product) = ([0.0; 2], 0.0, 1.0);
        vectorised(
            #[inline(always)]
            || {
                self.each(
                    weights,
                    #[inline(always)]
                    |row, likelihood, runs, values| {
                        // Limits the contribution of points far from all support points.
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
                    },
                );
            },
        );
        (sums, others, total + product.ln())
    }
}

/// Mixing weights of the support points.
#[derive(Clone)]
pub(crate) struct Weights {
    pub places: Vec<f64>,
    pub straying: f64,
    pub mirror: f64,
    /// Weights of the support points, stored twice and padded, so that no run exceeds the end.
    twice: Vec<f32>,
}

impl Weights {
    /// Maximum-likelihood weights of `places` support points, and of bare metal if `mirrors`.
    pub fn likeliest(chunks: &[Rows], places: usize, mirrors: bool) -> Self {
        let mut search = Search::new(chunks, places, mirrors);
        for _ in 0..CYCLES {
            if search.cycle().abs() < SETTLED {
                break;
            }
        }
        search.weights
    }

    /// Of the weights along the search, those that maximise the likelihood of held-out points. Weights fitted to noise
    /// reduce it increasingly with the duration of a search, and a comparison of curves must not depend on that
    /// duration.
    pub fn holding(chunks: &[Rows], others: &[Rows], places: usize, mirrors: bool) -> Self {
        let mut search = Search::new(chunks, places, mirrors);
        // Uniform weights may be the best for held-out points, once the share of outliers is known.
        (0..2).for_each(|_| _ = search.round(1.0, false));
        let judged = |weights: &Self| sum_in_order(others.par_iter().map(|rows| rows.likelihood(weights)));
        let (mut best, mut weights, mut worse) = (judged(&search.weights), search.weights.clone(), 0);
        for _ in 0..CYCLES {
            search.cycle();
            let now = judged(&search.weights);
            worse = if now < best + SETTLED { worse + 1 } else { 0 };
            if now > best {
                (best, weights) = (now, search.weights.clone());
            }
            if worse == PATIENCE {
                break;
            }
        }
        weights
    }

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
        // Subnormal numbers are slow, and their support points are irrelevant.
        let single = |w: &f64| if *w > 1e-30 { *w as f32 } else { 0.0 };
        self.twice.iter_mut().zip(self.places.iter().cycle()).for_each(|(to, w)| *to = single(w));
    }

    /// Multiplies the weights by a power of their gains, and normalises them.
    fn grow(&mut self, gains: &[f64], [straying, mirror]: [f64; 2], power: f32) {
        // There may be thousands of support points, and powers are faster in single precision.
        let by = |gain: f64| f64::from((gain as f32).powf(power).clamp((-LEAP).exp(), LEAP.exp()));
        self.places.iter_mut().zip(gains).for_each(|(w, gain)| *w *= by(*gain));
        self.straying *= by(straying);
        self.mirror *= by(mirror);
        let sum = self.places.iter().sum::<f64>() + self.straying + self.mirror;
        self.places.iter_mut().chain([&mut self.straying, &mut self.mirror]).for_each(|w| *w /= sum);
        self.doubled();
    }
}

/// Expectation maximisation.
struct Search<'a> {
    chunks: &'a [Rows],
    weights: Weights,
    powers: [f32; 2],
    /// ln likelihood of the points after the last cycle.
    before: f64,
}

impl<'a> Search<'a> {
    fn new(chunks: &'a [Rows], places: usize, mirrors: bool) -> Self {
        let weights = Weights::even(places, if mirrors { STRAYING } else { 0.0 });
        Self { chunks, weights, powers: POWERS, before: f64::NEG_INFINITY }
    }

    /// A cycle; returns its gain in ln likelihood, measured after the larger exponent, whose overshoot the smaller one
    /// removes.
    fn cycle(&mut self) -> f64 {
        self.round(self.powers[0], true);
        let total = self.round(self.powers[1], true);
        let gained = total - self.before;
        if gained < 0.0 {
            self.powers[0] = (0.5 * self.powers[0]).max(1.0);
        }
        self.before = total;
        gained
    }

    /// An iteration, of the support points only if `places`; returns the ln likelihood of the points before it.
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
