//! Joint refinement of shared gratings over all positions that have them.

use super::super::solve::{Copy, ORDERS, Prior, Solution, solve};
use super::judge::{Best, best, near};
use super::vote::Level;
use nacre_base::statistics::median;
use rayon::prelude::*;

/// Number of rounds of assignment and fit.
const ROUNDS: usize = 7;

/// Minimum number of positions of a grating, and their minimum fraction of all positions.
const FEWEST: usize = 4;
const LEAST: f64 = 0.005;

/// Maximum number of copies in the fit of a grating.
const MAX_COPIES: usize = 6000;

/// Distance relative to the lobe's width below which gratings are merged.
const SAME: f64 = 0.5;

/// Range of a grating's first-order light relative to the typical one, since one process prints the whole sheet.
const ALIKE: [f64; 2] = [0.6, 1.6];

/// Range of relative light of a position in the first fits.
const LOOSE: std::ops::Range<f64> = 0.6..1.29;

/// Range of relative light of a position entirely covered by one polygon.
pub(super) const WHOLE: std::ops::Range<f64> = 0.82..1.2;

/// Gratings near the vectors found by vote.
pub(super) fn refined(
    places: &[Vec<Copy>],
    vectors: &[[f64; 2]],
    prior: &Prior,
    level: Level,
    width: f64,
) -> Vec<Solution> {
    let start = |v: &[f64; 2]| Solution {
        vector: *v,
        covariance: [0.0; 3],
        orders: std::array::from_fn(|n| if n == 0 { level.first } else { 0.0 }),
        first_sigma: 0.0,
        stray: level.stray,
        cost: 0.0,
    };
    let mut gratings: Vec<Solution> = vectors.iter().map(start).collect();
    for round in 0..ROUNDS {
        let judged: Vec<Option<Best>> = places.par_iter().map(|p| best(p, &gratings)).collect();
        let good = |b: &Best| match round {
            0 | 1 => LOOSE.contains(&b.amount),
            _ => WHOLE.contains(&b.amount) && b.mask_reason().is_none(),
        };
        let fitted = |k: usize| {
            let own = |(p, b): (&'_ Vec<Copy>, &Option<Best>)| {
                b.filter(|b| b.grating == k && good(b)).map(|_| near(p, &gratings[k]))
            };
            let all: Vec<Vec<Copy>> = places.iter().zip(&judged).filter_map(own).collect();
            if all.len() < FEWEST.max((LEAST * places.len() as f64) as usize) {
                return None;
            }
            solve(&thinned(all), gratings[k].vector, prior)
        };
        let mut next: Vec<Solution> = (0..gratings.len()).into_par_iter().filter_map(fitted).collect();
        let mut usual: Vec<f64> = next.iter().map(|g| g.orders[0]).collect();
        let usual = median(&mut usual).unwrap_or(level.first);
        next.retain(|g| (ALIKE[0] * usual..ALIKE[1] * usual).contains(&g.orders[0]) && inside(g, prior));
        gratings = apart(next, SAME * width);
    }
    gratings
}

/// True if a grating lies inside the range of lengths and has no higher order brighter than the first.
fn inside(grating: &Solution, prior: &Prior) -> bool {
    let length = grating.vector[0].hypot(grating.vector[1]);
    (prior.range[0] * 1.01..prior.range[1] * 0.99).contains(&length)
        && (1..ORDERS).all(|n| grating.orders[n] < 2.0 * grating.orders[0])
}

/// Subsamples copies to the number required for a fit.
pub(super) fn thinned(all: Vec<Vec<Copy>>) -> Vec<Copy> {
    let count: usize = all.iter().map(Vec::len).sum();
    all.into_iter().flatten().step_by(count / MAX_COPIES + 1).collect()
}

/// Of merged gratings, keeps the one that explains more copies.
fn apart(gratings: Vec<Solution>, least: f64) -> Vec<Solution> {
    let mut kept: Vec<Solution> = vec![];
    for g in gratings {
        let far = |o: &Solution| {
            let [a, b] = [g.vector, o.vector];
            let distance = |sign: f64| (a[0] - sign * b[0]).hypot(a[1] - sign * b[1]);
            distance(1.0).min(distance(-1.0)) > least
        };
        if kept.iter().all(far) {
            kept.push(g);
        }
    }
    kept
}
