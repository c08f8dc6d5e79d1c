//! A lookup table as a sum of straightened parts, each a sum of separable terms.

use super::super::Table;
use super::straight::Grid;
use super::svd::{Product, decompose, nonnegative};
use nalgebra::DMatrix;
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, PI};

/// Maximum number of terms of a part.
pub const MAX_RANK: usize = 96;

/// Sharpness exponent of the split of light between the directions of several parts.
const SPLIT: i32 = 16;

/// Kind of factorisation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(rename = "FactorKind")]
pub enum Kind {
    /// Singular vectors: least error at any rank; partial sums may be negative.
    #[default]
    Singular,
    /// Non-negative terms.
    Nonnegative,
    /// Singular vectors along the first direction only, with all light projected onto it: a grating.
    Line,
}

/// A separable term of a channel: `along(β) · across(x)`.
#[derive(Clone, Debug, PartialEq)]
pub struct Term {
    /// Singular value, or norm.
    pub sigma: f64,
    /// One value per column of the grid.
    pub across: Vec<f32>,
    /// One value per row of the grid.
    pub along: Vec<f32>,
}

/// A straightened part of a table.
#[derive(Clone, Debug)]
pub struct Part {
    /// Sampling grid of its curves.
    pub grid: Grid,
    /// Terms of each channel, by decreasing singular value or norm.
    pub channels: [Vec<Term>; 3],
    /// Norm of each channel before the factorisation.
    pub norm: [f64; 3],
    /// Integral of each channel over the solid angle.
    pub albedo: [f64; 3],
    /// Residual norm after the first 0, 1, … terms of each channel.
    left_out: [Vec<f64>; 3],
}

impl Part {
    /// Factorises the part of a table selected by `weight` (of the half vector).
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
        let rank = rank.clamp(1, MAX_RANK);
        let factorised: Vec<Vec<Product>> = matrices
            .par_iter()
            .map(|m| match kind {
                Kind::Singular => decompose(m, rank),
                Kind::Nonnegative => nonnegative(m, rank),
                Kind::Line => vec![line(m)],
            })
            .collect();
        let mut channels = factorised.into_iter().map(|products| products.into_iter().map(term).collect());
        let channels: [Vec<Term>; 3] = std::array::from_fn(|_| channels.next().unwrap_or_default());
        let left_out = [0, 1, 2].map(|c| left_out(&matrices[c], &channels[c]));
        Self { grid, channels, norm, albedo, left_out }
    }

    /// A part from given curves, measured against the part of a table selected by `weight`.
    pub(super) fn of_curves(
        table: &Table,
        grid: Grid,
        channels: [Vec<Term>; 3],
        weight: impl Fn([f64; 2]) -> f64,
    ) -> Self {
        let [columns, rows] = grid.size;
        let [dx, dy] = grid.cell();
        let matrices = grid.kernel(table, weight).map(|k| DMatrix::from_vec(rows, columns, k));
        let norm = [0, 1, 2].map(|c| matrices[c].norm());
        let albedo = [0, 1, 2].map(|c| matrices[c].sum() * dx * dy);
        let left_out = [0, 1, 2].map(|c| left_out(&matrices[c], &channels[c]));
        Self { grid, channels, norm, albedo, left_out }
    }

    /// Singular vectors of a kernel on a grid: at most `most` terms, and no more than a residual of `max_error` of each
    /// channel's norm requires.
    pub(super) fn of_kernel(grid: Grid, kernel: [Vec<f64>; 3], most: usize, max_error: f64) -> Self {
        let [columns, rows] = grid.size;
        let [dx, dy] = grid.cell();
        let matrices = kernel.map(|k| DMatrix::from_vec(rows, columns, k));
        let norm = [0, 1, 2].map(|c| matrices[c].norm());
        let albedo = [0, 1, 2].map(|c| matrices[c].sum() * dx * dy);
        let channels: [Vec<Term>; 3] =
            std::array::from_fn(|c| decompose(&matrices[c], most).into_iter().map(term).collect());
        let left_out = [0, 1, 2].map(|c| left_out(&matrices[c], &channels[c]));
        let part = Self { grid, channels, norm, albedo, left_out };
        let enough = |r: &usize| (0..3).all(|c| part.left_out(c, *r) <= max_error * norm[c]);
        let rank = (1..most).find(enough).unwrap_or(most);
        part.truncated(rank)
    }

    /// Value at a half vector of the table, interpolated between cells; zero outside the grid.
    pub(crate) fn value(&self, h: [f64; 2]) -> [f64; 3] {
        let gain = (1.0 + (1.0 - h[0] * h[0] - h[1] * h[1]).max(0.0).sqrt()).powi(2);
        [0, 1, 2].map(|c| self.between(c, h) / gain)
    }

    /// The part for a reversed bitangent: its mirror image across the meridian.
    pub fn mirrored(&self) -> Self {
        let mut part = self.clone();
        part.grid.shear = -part.grid.shear;
        part.channels.iter_mut().flatten().for_each(|term| term.across.reverse());
        part
    }

    /// Largest number of terms over the channels.
    pub fn terms(&self) -> usize {
        self.channels.iter().map(Vec::len).max().unwrap_or(0)
    }

    /// Residual norm of a channel after its first `rank` terms, as the curves are written.
    pub fn left_out(&self, channel: usize, rank: usize) -> f64 {
        let left = &self.left_out[channel];
        left.get(rank).or(left.last()).copied().unwrap_or(self.norm[channel])
    }

    /// The same part with fewer terms.
    pub fn truncated(&self, rank: usize) -> Self {
        let mut part = self.clone();
        part.channels.iter_mut().for_each(|terms| terms.truncate(rank));
        part
    }

    /// Result of the passes as printed in the paper (2017 CVMP, Eq. 10 and 11). Both passes sum over the terms, so
    /// products of different terms contribute, and the result has rank one.
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

    /// Value of a channel at a half vector of the table, times (1 + ωi·ωo)², interpolated between cell centres; zero
    /// outside the grid.
    pub(super) fn between(&self, channel: usize, h: [f64; 2]) -> f64 {
        let Some((place, _)) = self.grid.position(h) else { return 0.0 };
        let [(i, u), (j, v)] = [0, 1].map(|k| {
            let at = (place[k] - 0.5).clamp(0.0, (self.grid.size[k] - 1) as f64);
            let first = (at as usize).min(self.grid.size[k].saturating_sub(2));
            (first, at - first as f64)
        });
        let mixed = |curve: &[f32], at: usize, share: f64| {
            let [a, b] = [at, (at + 1).min(curve.len() - 1)].map(|k| f64::from(curve[k]));
            a + share * (b - a)
        };
        self.channels[channel].iter().map(|t| mixed(&t.across, i, u) * mixed(&t.along, j, v)).sum()
    }

    /// Value of a channel in a cell.
    pub(super) fn at(&self, channel: usize, column: usize, row: usize) -> f64 {
        self.channels[channel].iter().map(|t| f64::from(t.across[column]) * f64::from(t.along[row])).sum()
    }
}

/// Residual norms of a matrix after the first 0, 1, … terms. They cannot be computed from the norms of the terms:
/// non-negative terms are not orthogonal, and a line is no orthogonal projection.
fn left_out(matrix: &DMatrix<f64>, terms: &[Term]) -> Vec<f64> {
    let curves =
        |n: usize, of: fn(&Term) -> &[f32]| DMatrix::from_fn(n, terms.len(), |i, k| f64::from(of(&terms[k])[i]));
    let (along, across) = (curves(matrix.nrows(), |t| &t.along), curves(matrix.ncols(), |t| &t.across));
    let projected = matrix * &across;
    let products = along.tr_mul(&along).component_mul(&across.tr_mul(&across));
    let mut square = matrix.norm_squared();
    let add = |k: usize| {
        let before: f64 = (0..k).map(|j| products[(j, k)]).sum();
        square += products[(k, k)] + 2.0 * before - 2.0 * projected.column(k).dot(&along.column(k));
        square
    };
    let squares: Vec<f64> = std::iter::once(matrix.norm_squared()).chain((0..terms.len()).map(add)).collect();
    squares.into_iter().map(|s| s.max(0.0).sqrt()).collect()
}

fn term(product: Product) -> Term {
    let single = |v: Vec<f64>| v.into_iter().map(|v| v as f32).collect();
    Term { sigma: product.sigma, across: single(product.right), along: single(product.left) }
}

/// All light projected onto β = 0, between the two central rows.
fn line(matrix: &DMatrix<f64>) -> Product {
    let (rows, columns) = matrix.shape();
    let right: Vec<f64> = (0..columns).map(|i| matrix.column(i).sum()).collect();
    let mut left = vec![0.0; rows];
    let middle = [(rows - 1) / 2, rows / 2];
    middle.iter().for_each(|j| left[*j] += 0.5);
    let sigma = right.iter().map(|v| v * v).sum::<f64>().sqrt() * left.iter().map(|v| v * v).sum::<f64>().sqrt();
    Product { sigma, left, right }
}

/// Share of the light at a half vector that belongs to the `k`-th direction; the shares add up to 1.
pub(super) fn share(directions: &[f64], k: usize, h: [f64; 2]) -> f64 {
    let near = |direction: f64| (h[1].atan2(h[0]) - direction).cos().powi(2).powi(SPLIT);
    let all: f64 = directions.iter().map(|d| near(*d)).sum();
    near(directions[k]) / all.max(f64::MIN_POSITIVE)
}

/// Splits a table into parts, one per main direction, whose sum is the table.
pub(super) fn split(table: &Table, directions: &[f64], kind: Kind, rank: usize) -> Vec<Part> {
    (0..directions.len())
        .map(|k| {
            let along = [directions[k], (directions[k] + FRAC_PI_2) % PI];
            Part::new(table, along, kind, rank, |h| share(directions, k, h))
        })
        .collect()
}
