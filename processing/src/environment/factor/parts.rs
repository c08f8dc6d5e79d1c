//! A table as a sum of straightened parts, each a sum of products.

use super::super::Table;
use super::directions::Pattern;
use super::straight::Grid;
use super::svd::{Product, decompose, nonnegative};
use nalgebra::DMatrix;
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI};

/// Most terms of a part.
pub const MOST_RANK: usize = 96;

/// How sharply light between the directions of several parts is split among them.
const SPLIT: i32 = 16;

/// Which factorisation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Singular vectors: the least error at any rank; sums of few terms may be negative.
    #[default]
    Singular,
    /// No term is negative anywhere.
    Nonnegative,
    /// Singular vectors along the first direction alone, with all light across it moved onto it: a grating.
    Line,
}

/// A term of a channel: `along(β) · across(x)`.
#[derive(Clone, Debug, PartialEq)]
pub struct Term {
    /// Singular value, or norm.
    pub sigma: f64,
    /// One per column of the grid.
    pub across: Vec<f32>,
    /// One per row of the grid.
    pub along: Vec<f32>,
}

/// A straightened part of a table.
#[derive(Clone, Debug)]
pub struct Part {
    /// Where its curves are sampled.
    pub grid: Grid,
    /// Terms of each channel, the most important first.
    pub channels: [Vec<Term>; 3],
    /// Norm of each channel before the factorisation.
    pub norm: [f64; 3],
    /// Sum of each channel over the solid angle.
    pub albedo: [f64; 3],
}

impl Part {
    /// Factorises the part of a table that `weight` (of the half vector) picks.
    pub(super) fn new(
        table: &Table,
        directions: [f64; 2],
        kind: Kind,
        rank: usize,
        weight: impl Fn([f64; 2]) -> f64,
    ) -> Self {
        let grid = Grid::new(table, directions);
        let [columns, rows] = grid.size;
        let [dx, dy] = grid.cell();
        let kernel = grid.kernel(table, weight);
        let matrices = kernel.map(|k| DMatrix::from_vec(rows, columns, k));
        let norm = [0, 1, 2].map(|c| matrices[c].norm());
        let albedo = [0, 1, 2].map(|c| matrices[c].sum() * dx * dy);
        let rank = rank.clamp(1, MOST_RANK);
        let factorised: Vec<Vec<Product>> = matrices
            .par_iter()
            .map(|m| match kind {
                Kind::Singular => decompose(m, rank),
                Kind::Nonnegative => nonnegative(m, rank),
                Kind::Line => vec![line(m)],
            })
            .collect();
        let mut channels = factorised.into_iter().map(|products| products.into_iter().map(term).collect());
        Self { grid, channels: std::array::from_fn(|_| channels.next().unwrap_or_default()), norm, albedo }
    }

    /// Norm of what the first `rank` terms of a channel leave out; singular values tell it exactly.
    pub fn left_out(&self, channel: usize, rank: usize) -> f64 {
        let kept: f64 = self.channels[channel].iter().take(rank).map(|t| t.sigma * t.sigma).sum();
        (self.norm[channel] * self.norm[channel] - kept).max(0.0).sqrt()
    }

    /// The same part with fewer terms.
    pub fn truncated(&self, rank: usize) -> Self {
        let mut part = self.clone();
        part.channels.iter_mut().for_each(|terms| terms.truncate(rank));
        part
    }

    /// What the passes of the paper make of it (2017 CVMP, Eq. 10 and 11): both sum over the terms, so that all products of different
    /// terms come in, and what is left is one product.
    pub fn as_printed(&self) -> Self {
        let sum = |curves: Vec<&Vec<f32>>| {
            let n = curves.first().map_or(0, |c| c.len());
            (0..n).map(|i| curves.iter().map(|c| c[i]).sum()).collect()
        };
        let collapse = |terms: &Vec<Term>| {
            let across = sum(terms.iter().map(|t| &t.across).collect());
            vec![Term {
                sigma: terms.first().map_or(0.0, |t| t.sigma),
                across,
                along: sum(terms.iter().map(|t| &t.along).collect()),
            }]
        };
        let mut part = self.clone();
        part.channels = [0, 1, 2].map(|c| collapse(&self.channels[c]));
        part
    }

    /// Value of a channel in a cell.
    pub(super) fn at(&self, channel: usize, column: usize, row: usize) -> f64 {
        self.channels[channel].iter().map(|t| f64::from(t.across[column]) * f64::from(t.along[row])).sum()
    }
}

fn term(product: Product) -> Term {
    let single = |v: Vec<f64>| v.into_iter().map(|v| v as f32).collect();
    Term { sigma: product.sigma, across: single(product.right), along: single(product.left) }
}

/// All light moved onto β = 0, between the two rows there.
fn line(matrix: &DMatrix<f64>) -> Product {
    let (rows, columns) = matrix.shape();
    let right: Vec<f64> = (0..columns).map(|i| matrix.column(i).sum()).collect();
    let mut left = vec![0.0; rows];
    let middle = [(rows - 1) / 2, rows / 2];
    middle.iter().for_each(|j| left[*j] += 0.5);
    let sigma = right.iter().map(|v| v * v).sum::<f64>().sqrt() * left.iter().map(|v| v * v).sum::<f64>().sqrt();
    Product { sigma, left, right }
}

/// Several parts, one per main direction, that add up to the table.
pub(super) fn split(table: &Table, pattern: &Pattern, most: usize, kind: Kind, rank: usize) -> Vec<Part> {
    let directions: Vec<f64> = pattern.main.iter().copied().take(most).collect();
    let near = |h: [f64; 2], k: usize| (h[1].atan2(h[0]) - directions[k]).cos().powi(2).powi(SPLIT);
    let share = |h: [f64; 2], k: usize| {
        let all: f64 = (0..directions.len()).map(|k| near(h, k)).sum();
        near(h, k) / all.max(f64::MIN_POSITIVE)
    };
    (0..directions.len())
        .map(|k| Part::new(table, [directions[k], (directions[k] + FRAC_PI_2) % PI], kind, rank, |h| share(h, k)))
        .collect()
}
