//! Mixing weights of the support points of a curve, fitted by expectation maximisation to the points themselves or to
//! held-out points of the same distribution.

use crate::film::support_points::{LANES, LikelihoodRow, LikelihoodRows, Run};
use nacre_base::parallel::sum_in_order;
use nacre_base::vectors::vectorised;
use rayon::prelude::*;

/// Exponents of the gain in a cycle of expectation maximisation, from Chebyshev's iteration; a cycle is equivalent to
/// eight iterations with exponent 1. Exponents above 2 may diverge, in which case the larger one is halved.
const EXPONENTS: [f32; 2] = [6.83, 1.17];
const CYCLES: usize = 24;

/// Gain in ln likelihood below which the cycles end.
const CONVERGED: f64 = 0.3;

/// Consecutive cycles without gain on held-out points after which a search ends.
const PATIENCE: usize = 2;

/// Largest change of a weight in an iteration, as ln.
const MAX_LN_STEP: f32 = 3.0;

/// Initial share of outliers (edges, dust), uniform in the unit disc.
const OUTLIER_SHARE: f64 = 0.01;

/// Smallest likelihood of a point in its own unit.
const MIN_LIKELIHOOD: f64 = 1e-200;

impl LikelihoodRows {
    /// Calls `work` with each point and its likelihood, its runs and their values.
    #[inline(always)]
    pub fn for_each_point(&self, weights: &MixingWeights, mut work: impl FnMut(&LikelihoodRow, f64, &[Run], &[f32])) {
        let (mut runs, mut values) = (self.runs.as_slice(), self.values.as_slice());
        for row in &self.points {
            let (own, rest) = runs.split_at(row.runs);
            let (of_runs, others) = values.split_at(own.iter().map(|run| run.length).sum());
            (runs, values) = (rest, others);
            let mut sums = [0.0_f32; LANES];
            let mut unread = of_runs;
            for run in own {
                let (of_run, rest) = unread.split_at(run.length);
                unread = rest;
                let weights = &weights.padded[run.start..][..run.length];
                let pairs = of_run.as_chunks::<LANES>().0.iter().zip(weights.as_chunks::<LANES>().0);
                pairs.for_each(|(v, w)| (0..LANES).for_each(|i| sums[i] += v[i] * w[i]));
            }
            let support = f64::from(sums.iter().sum::<f32>());
            let likelihood = support + row.outlier * weights.outlier + row.mirror * weights.mirror;
            work(row, likelihood.max(MIN_LIKELIHOOD), own, of_runs);
        }
    }

    /// Sum of ln likelihoods.
    fn likelihood(&self, weights: &MixingWeights) -> f64 {
        let mut total = 0.0;
        vectorised(
            #[inline(always)]
            || self.for_each_point(weights, |_, likelihood, _, _| total += likelihood.ln()),
        );
        total
    }

    /// Sums over points of the relative contribution of each support point to their likelihood, the same for outliers
    /// and bare metal, and the sum of ln likelihoods.
    fn gains(&self, weights: &MixingWeights) -> (Vec<f32>, [f64; 2], f64) {
        let mut sums = vec![0.0_f32; weights.padded.len()];
        let (mut others, mut total, mut product) = ([0.0; 2], 0.0, 1.0);
        vectorised(
            #[inline(always)]
            || {
                self.for_each_point(
                    weights,
                    #[inline(always)]
                    |row, likelihood, runs, values| {
                        // Limits the contribution of points far from all support points.
                        let scale = 1.0 / likelihood.max(1e-30);
                        let mut unread = values;
                        for run in runs {
                            let (of_run, rest) = unread.split_at(run.length);
                            unread = rest;
                            let sums = &mut sums[run.start..][..run.length];
                            let pairs = of_run.as_chunks::<LANES>().0.iter().zip(sums.as_chunks_mut::<LANES>().0);
                            pairs.for_each(|(v, s)| (0..LANES).for_each(|i| s[i] += v[i] * scale as f32));
                        }
                        others[0] += row.outlier * scale;
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
pub(crate) struct MixingWeights {
    pub support: Vec<f64>,
    pub outlier: f64,
    pub mirror: f64,
    /// Weights of the support points, stored twice and padded, so that no run exceeds the end.
    padded: Vec<f32>,
}

impl MixingWeights {
    /// Maximum-likelihood weights of `support` support points, and of bare metal if `mirrors`.
    pub fn max_likelihood(chunks: &[LikelihoodRows], support: usize, mirrors: bool) -> Self {
        let mut search = ExpectationMaximisation::new(chunks, support, mirrors);
        for _ in 0..CYCLES {
            if search.cycle().abs() < CONVERGED {
                break;
            }
        }
        search.weights
    }

    /// Of the weights along the search, those that maximise the likelihood of held-out points. Weights fitted to noise
    /// reduce it increasingly with the duration of a search, and a comparison of curves must not depend on that
    /// duration.
    pub fn held_out(chunks: &[LikelihoodRows], others: &[LikelihoodRows], support: usize, mirrors: bool) -> Self {
        let mut search = ExpectationMaximisation::new(chunks, support, mirrors);
        // Uniform weights may be the best for held-out points, once the share of outliers is known.
        (0..2).for_each(|_| _ = search.iterate(1.0, false));
        let held_out_likelihood = |weights: &Self| sum_in_order(others.par_iter().map(|rows| rows.likelihood(weights)));
        let (mut best, mut weights, mut worse) = (held_out_likelihood(&search.weights), search.weights.clone(), 0);
        for _ in 0..CYCLES {
            search.cycle();
            let now = held_out_likelihood(&search.weights);
            worse = if now < best + CONVERGED { worse + 1 } else { 0 };
            if now > best {
                (best, weights) = (now, search.weights.clone());
            }
            if worse == PATIENCE {
                break;
            }
        }
        weights
    }

    fn uniform(count: usize, mirrors: f64) -> Self {
        let for_each_point = (1.0 - OUTLIER_SHARE - mirrors) / count as f64;
        let mut weights = Self {
            support: vec![for_each_point; count],
            outlier: OUTLIER_SHARE,
            mirror: mirrors,
            padded: vec![0.0; 2 * count + LANES],
        };
        weights.update_padded();
        weights
    }

    fn update_padded(&mut self) {
        // Subnormal numbers are slow, and their support points are irrelevant.
        let single = |w: &f64| if *w > 1e-30 { *w as f32 } else { 0.0 };
        self.padded.iter_mut().zip(self.support.iter().cycle()).for_each(|(to, w)| *to = single(w));
    }

    /// Multiplies the weights by a power of their gains, and normalises them.
    fn multiply(&mut self, gains: &[f64], [outlier, mirror]: [f64; 2], exponent: f32) {
        // There may be thousands of support points, and powers are faster in single precision.
        let by = |gain: f64| f64::from((gain as f32).powf(exponent).clamp((-MAX_LN_STEP).exp(), MAX_LN_STEP.exp()));
        self.support.iter_mut().zip(gains).for_each(|(w, gain)| *w *= by(*gain));
        self.outlier *= by(outlier);
        self.mirror *= by(mirror);
        let sum = self.support.iter().sum::<f64>() + self.outlier + self.mirror;
        self.support.iter_mut().chain([&mut self.outlier, &mut self.mirror]).for_each(|w| *w /= sum);
        self.update_padded();
    }
}

/// Expectation maximisation.
struct ExpectationMaximisation<'a> {
    chunks: &'a [LikelihoodRows],
    weights: MixingWeights,
    exponents: [f32; 2],
    /// ln likelihood of the points after the last cycle.
    before: f64,
}

impl<'a> ExpectationMaximisation<'a> {
    fn new(chunks: &'a [LikelihoodRows], support: usize, mirrors: bool) -> Self {
        let weights = MixingWeights::uniform(support, if mirrors { OUTLIER_SHARE } else { 0.0 });
        Self { chunks, weights, exponents: EXPONENTS, before: f64::NEG_INFINITY }
    }

    /// A cycle; returns its gain in ln likelihood, measured after the larger exponent, whose overshoot the smaller one
    /// removes.
    fn cycle(&mut self) -> f64 {
        self.iterate(self.exponents[0], true);
        let total = self.iterate(self.exponents[1], true);
        let gained = total - self.before;
        if gained < 0.0 {
            self.exponents[0] = (0.5 * self.exponents[0]).max(1.0);
        }
        self.before = total;
        gained
    }

    /// An iteration, of the support points only if `support`; returns the ln likelihood of the points before it.
    fn iterate(&mut self, exponent: f32, support: bool) -> f64 {
        let count = self.weights.support.len();
        let points = self.chunks.iter().map(|rows| rows.points.len()).sum::<usize>() as f64;
        // Added in order: the result does not depend on timing.
        let sums: Vec<_> = self.chunks.par_iter().map(|rows| rows.gains(&self.weights)).collect();
        let mut gains = vec![0.0; count];
        for (support, ..) in &sums {
            let rounds = support.chunks(count);
            rounds.for_each(|sums| gains.iter_mut().zip(sums).for_each(|(gain, sum)| *gain += f64::from(*sum)));
        }
        gains.iter_mut().for_each(|gain| *gain = if support { *gain / points } else { 1.0 });
        let others = [0, 1].map(|k| sums.iter().map(|s| s.1[k]).sum::<f64>() / points);
        self.weights.multiply(&gains, others, exponent);
        sums.iter().map(|s| s.2).sum()
    }
}
