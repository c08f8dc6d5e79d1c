//! Grating vectors common to many positions: each position votes for all vectors consistent with its light.
//!
//! A single copy near a lobe determines a ring of grating vectors around its half vector; the ring's radius follows
//! from the light relative to the lobe's peak. Rings of positions with the same grating intersect in one vector. The
//! vote is the nonparametric maximum-likelihood estimate of the distribution of vectors (Kiefer and Wolfowitz 1956) on
//! a grid. This estimate is discrete even if the true distribution is not; `evidence` tests that later.

use super::super::solve::{Copy, ORDERS, Prior};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Grid steps along and across grating vectors, relative to the lobe's width.
const STEPS: [f64; 2] = [0.4, 0.35];

/// Maximum number of grid vectors; with narrower lobes, nearly all positions are dark.
const MOST: usize = 30_000;

/// Relative uncertainty of light, because the peak is only roughly known.
const TOLERANCE: f64 = 0.2;

/// Maximum squared residual of a copy, and that of a lit copy without a grating.
const MAX_SQUARES: f64 = 16.0;
const NONE: f64 = 12.0;

/// Squared signal-to-noise ratio above which a copy is lit.
const LIT: f64 = 9.0;

/// Maximum light of higher orders relative to the first.
const HIGHER: f64 = 2.0;

/// Squared radius in standard deviations at which lobes are truncated (about a thousandth of the peak).
const FAR: f64 = 14.0;

/// Number of expectation-maximisation iterations.
const ROUNDS: usize = 80;

/// Distance relative to the lobe's width below which a vector is merged into a stronger one.
const SAME: f64 = 1.6;

/// Minimum number of positions of a vector, and their minimum fraction.
const FEWEST: f64 = 4.0;
const LEAST: f64 = 0.006;

/// Maximum number of vectors.
const MAX_VECTORS: usize = 64;

/// First-order light common to all gratings, and stray light, both relative to the unit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Level {
    pub first: f64,
    pub stray: f64,
}

/// Vectors with the most votes, strongest first; `None` if lobes are too narrow for a grid.
pub(super) fn vote(places: &[Vec<Copy>], prior: &Prior, width: f64, level: Level) -> Option<Vec<[f64; 2]>> {
    let grid = Grid::new(prior.range, width)?;
    let likelihoods: Vec<(Vec<f32>, f32)> = places.par_iter().map(|p| likelihood(p, &grid, level)).collect();
    let mut shares = vec![0.9 / grid.vectors.len() as f64; grid.vectors.len()];
    let mut none = 0.1;
    for _ in 0..ROUNDS {
        let mut next = vec![0.0; grid.vectors.len()];
        let mut next_none = 0.0;
        for (of, outside) in &likelihoods {
            let all: f64 = of.iter().zip(&shares).map(|(l, s)| f64::from(*l) * s).sum();
            let outside = f64::from(*outside) * none;
            let sum = (all + outside).max(f64::MIN_POSITIVE);
            next.iter_mut().zip(of).zip(&shares).for_each(|((n, l), s)| *n += f64::from(*l) * s / sum);
            next_none += outside / sum;
        }
        let count = likelihoods.len().max(1) as f64;
        shares = next.into_iter().map(|n| n / count).collect();
        none = next_none / count;
    }
    Some(peaks(&grid.vectors, shares, width, places.len()))
}

/// Vectors of the half plane, in rows of equal length.
struct Grid {
    rows: Vec<Row>,
    vectors: Vec<[f64; 2]>,
}

struct Row {
    length: f64,
    first: usize,
    count: usize,
}

impl Grid {
    /// Grid of vectors with lengths in a range; `None` if there would be too many.
    fn new([least, most]: [f64; 2], width: f64) -> Option<Self> {
        let rows = ((most - least) / (STEPS[0] * width)).ceil().max(1.0);
        let around = |length: f64| (PI * length / (STEPS[1] * width)).ceil();
        let count = rows * around(0.5 * (least + most));
        if count.is_nan() || count > MOST as f64 {
            return None;
        }
        let mut grid = Self { rows: vec![], vectors: vec![] };
        for k in 0..rows as usize {
            let length = least + (most - least) * (k as f64 + 0.5) / rows;
            let count = around(length) as usize;
            grid.rows.push(Row { length, first: grid.vectors.len(), count });
            grid.vectors.extend((0..count).map(|a| {
                let (sin, cos) = (PI * a as f64 / count as f64).sin_cos();
                [length * cos, length * sin]
            }));
        }
        Some(grid)
    }

    /// Superset of the vectors within a distance of another vector or of its opposite.
    fn near(&self, [x, y]: [f64; 2], distance: f64) -> impl Iterator<Item = usize> {
        let (length, angle) = (x.hypot(y), y.atan2(x).rem_euclid(PI));
        let rows = self.rows.iter().filter(move |r| (r.length - length).abs() < distance);
        rows.flat_map(move |row| {
            let step = PI / row.count as f64;
            let reach = (1.6 * distance / row.length / step).ceil().min(row.count as f64 / 2.0) as usize;
            let middle = (angle / step).round() as usize + row.count;
            let end = (middle + reach).min(middle - reach + row.count - 1);
            (middle - reach..=end).map(move |a| row.first + a % row.count)
        })
    }
}

/// Likelihood of a position's light for each vector and for no grating, relative to the most likely vector.
fn likelihood(copies: &[Copy], grid: &Grid, level: Level) -> (Vec<f32>, f32) {
    let dark = |c: &Copy| ((c.light - level.stray).powi(2) * c.weight).min(MAX_SQUARES);
    let mut all = vec![copies.iter().map(dark).sum::<f64>(); grid.vectors.len()];
    for copy in copies {
        let (before, reach) = (dark(copy), FAR.sqrt() * copy.shape.width());
        for n in 1..=ORDERS {
            let middle = copy.half.map(|v| v / n as f64);
            for k in grid.near(middle, reach / n as f64) {
                let lobes = lobes(copy, grid.vectors[k]);
                // Vectors near several orders are counted with the first of these.
                if lobes[n - 1] > 0.0 && lobes[..n - 1].iter().all(|l| *l == 0.0) {
                    all[k] += with(copy, lobes, level) - before;
                }
            }
        }
    }
    let least = all.iter().copied().fold(f64::MAX, f64::min);
    let of = |s: f64| (-0.5 * (s - least)).exp() as f32;
    // Without a grating, lit copies are unexplained; the others contribute their residuals.
    let none: f64 = copies.iter().map(dark).map(|s| if s < LIT { s } else { NONE }).sum();
    (all.iter().map(|s| of(*s)).collect(), of(none.max(least)))
}

/// Lobe values of a vector's orders at a copy, for unit energy; 0 far from them.
fn lobes(copy: &Copy, g: [f64; 2]) -> [f64; ORDERS] {
    let sign = (copy.half[0] * g[0] + copy.half[1] * g[1]).signum();
    std::array::from_fn(|n| {
        let k = sign * (n + 1) as f64;
        let square = copy.shape.square([copy.half[0] - k * g[0], copy.half[1] - k * g[1]]);
        if square < FAR { copy.shape.peak * (-0.5 * square).exp() } else { 0.0 }
    })
}

/// χ² of a copy for a vector with these lobes; higher orders may be brighter than the first by a limited factor.
fn with(copy: &Copy, lobes: [f64; ORDERS], level: Level) -> f64 {
    let low = level.stray + level.first * lobes[0];
    let high = low + HIGHER * level.first * lobes[1..].iter().sum::<f64>();
    let off = (low - copy.light).max(copy.light - high).max(0.0);
    let variance = 1.0 / copy.weight + (TOLERANCE * (low - level.stray)).powi(2);
    (off * off / variance).min(MAX_SQUARES)
}

/// Local maxima of the votes.
fn peaks(grid: &[[f64; 2]], mut shares: Vec<f64>, width: f64, places: usize) -> Vec<[f64; 2]> {
    let least = (FEWEST / places.max(1) as f64).max(LEAST);
    let mut found = vec![];
    while found.len() < MAX_VECTORS {
        let Some(top) = (0..grid.len()).max_by(|a, b| shares[*a].total_cmp(&shares[*b])) else { break };
        let center = grid[top];
        let (mut sum, mut at) = (0.0, [0.0; 2]);
        for (g, share) in grid.iter().zip(&mut shares) {
            let same = (g[0] * center[0] + g[1] * center[1]).signum();
            let g = g.map(|v| same * v);
            if (g[0] - center[0]).hypot(g[1] - center[1]) < SAME * width {
                sum += *share;
                at = [at[0] + *share * g[0], at[1] + *share * g[1]];
                *share = 0.0;
            }
        }
        if sum < 0.3 * least {
            break;
        }
        if sum >= least {
            found.push(at.map(|v| v / sum));
        }
    }
    found
}
