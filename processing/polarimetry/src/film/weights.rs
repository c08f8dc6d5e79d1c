//! How many points come from each place of a curve: the weights that make points likeliest, the points themselves or others of the same
//! distribution, by expectation and maximization.

use crate::film::places::{LANES, Row, Rows, Run};
use nacre_base::parallel::sum_in_order;
use nacre_base::vectors::vectorised;
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

/// Least likelihood of a point in units of its own.
const IMPOSSIBLE: f64 = 1e-200;

impl Rows {
    /// Does something with each point and its likelihood, its runs and their values.
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

    /// Sums over points of what each place adds to their likelihood, over it; the same of straying and of mirrors; and the sum of ln likelihoods.
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
                    },
                );
            },
        );
        (sums, others, total + product.ln())
    }
}

/// How many points there are at each place.
#[derive(Clone)]
pub(crate) struct Weights {
    pub places: Vec<f64>,
    pub straying: f64,
    pub mirror: f64,
    /// Those of places twice over, and some more, so that no run ends before its last place.
    twice: Vec<f32>,
}

impl Weights {
    /// Those of so many places, and of mirrors where there are any, that make points likeliest.
    pub fn likeliest(chunks: &[Rows], places: usize, mirrors: bool) -> Self {
        let mut search = Search::new(chunks, places, mirrors);
        for _ in 0..CYCLES {
            if search.cycle().abs() < SETTLED {
                break;
            }
        }
        search.weights
    }

    /// The same, of those that the search passes the ones that make other points likeliest. What is fitted to chance makes these less likely, the
    /// more the longer a search goes on, and curves are not to be told apart by how long it did.
    pub fn holding(chunks: &[Rows], others: &[Rows], places: usize, mirrors: bool) -> Self {
        let mut search = Search::new(chunks, places, mirrors);
        // Places that are all alike may be what holds best, once what strays is known.
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

/// Expectation and maximization.
struct Search<'a> {
    chunks: &'a [Rows],
    weights: Weights,
    powers: [f32; 2],
    /// ln likelihood of the points that the last cycle reached.
    before: f64,
}

impl<'a> Search<'a> {
    fn new(chunks: &'a [Rows], places: usize, mirrors: bool) -> Self {
        let weights = Weights::even(places, if mirrors { STRAYING } else { 0.0 });
        Self { chunks, weights, powers: POWERS, before: f64::NEG_INFINITY }
    }

    /// The next rounds; by how much they made the points likelier (ln), as seen after the larger power, which the smaller one evens out.
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
