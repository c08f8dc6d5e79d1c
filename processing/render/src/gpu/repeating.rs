//! Doubly periodic materials for the shader `field.wgsl`: height fields as terms of their expansion.

use super::alias::draws;
use super::texture::Texture;
use crate::light::viewer::RANGE;
use crate::material::diffraction::relief::Relief;
use nacre_base::progress::Progress;
use nacre_brdf::TermSet;
use num_complex::Complex32;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Rows of the terms' functions of X, the texture height supported by every card. Linear interpolation has an error of
/// 2e-5 at X = 25.
const ROWS: usize = 2048;

/// Maximum size of the terms' texture in bytes.
const MAX_BYTES: usize = 1 << 30;

/// Number of sampling tables for frequencies under an environment, from grazing to normal views: a surface seen at
/// grazing incidence is nearly a mirror. It must match `heights.wgsl`.
const COURSES: usize = 8;

/// Maximum number of cells of all these tables.
const MAX_CELLS: usize = 1 << 22;

/// Minimum share of draws per cell, relative to the mean: a frequency without power at one phase may have some at
/// another.
const MIN_DRAWS: f64 = 1e-3;

/// A height field for graphics cards.
pub(super) struct Field {
    /// Amplitudes of pairs of terms over frequencies, from the lowest, in tiles.
    pub terms: Texture,
    /// Functions of X of pairs of terms, row by row.
    pub phases: Texture,
    /// [`AlbedoNormalisation`](crate::material::diffraction::albedo_normalisation::AlbedoNormalisation), in tiles.
    pub norm: Texture,
    /// Number of frequencies on each side of zero.
    pub reach: [usize; 2],
    /// Number of pairs of terms.
    pub pairs: usize,
    /// Rows of `phases` per unit of X.
    pub per_x: f64,
    /// Half the height range in µm.
    pub half_um: f64,
    /// Tables for sampling frequencies under an environment.
    pub cells: Option<Cells>,
}

/// Alias tables of frequency cells: own share of draws, alternative cell, and probability of each.
pub(super) struct Cells {
    /// The tables in tiles.
    pub texture: Texture,
    /// Cells of a table along x and y.
    pub side: [usize; 2],
    /// Frequencies along a side of a cell.
    pub fine: usize,
}

impl Cells {
    /// Builds the tables from the terms of a height field.
    fn new(set: &TermSet) -> Self {
        let reach = set.about.reach;
        let frequencies = reach.map(|r| 2 * r + 1);
        let sides = |fine: usize| frequencies.map(|n| n.div_ceil(fine));
        let most = |fine: &usize| sides(*fine)[0] * sides(*fine)[1] * COURSES <= MAX_CELLS;
        let fine = (1..).find(most).unwrap_or(1);
        let (side, across) = (sides(fine), beside(COURSES));
        let width = side[0] * across;
        let mut values = vec![0.0_f32; 4 * width * side[1] * COURSES.div_ceil(across)];
        for course in 0..COURSES {
            // Phase in the mirror direction.
            let x = 2.0 * TAU * RANGE[1] * set.about.half_um * (course as f64 + 0.5) / COURSES as f64;
            let functions = set.functions(x.min(set.about.x_most));
            let power = |x: usize, y: usize| {
                let at = [x as isize - reach[0] as isize, y as isize - reach[1] as isize];
                let of = |(n, f): (usize, &f64)| set.amplitude(n, at) * *f as f32;
                f64::from(functions.iter().enumerate().map(of).sum::<Complex32>().norm_sqr())
            };
            let cell = |k: usize| {
                let [columns, rows] = [k % side[0], k / side[0]].map(|c| c * fine..(c + 1) * fine);
                let all = columns.flat_map(|x| rows.clone().map(move |y| (x, y)));
                all.filter(|(x, y)| *x < frequencies[0] && *y < frequencies[1]).map(|(x, y)| power(x, y)).sum::<f64>()
            };
            let count = side[0] * side[1];
            let mut shares: Vec<f64> = (0..count).into_par_iter().map(cell).collect();
            let mean = shares.iter().sum::<f64>() / count as f64;
            // Each cell has a minimum share; the mean share is one.
            shares.iter_mut().for_each(|s| *s = (*s / mean.max(f64::MIN_POSITIVE) + MIN_DRAWS) / (1.0 + MIN_DRAWS));
            let tile = [course % across * side[0], course / across * side[1]];
            for (k, (share, (own, other))) in shares.iter().zip(draws(shares.clone())).enumerate() {
                let at = 4 * ((tile[1] + k / side[0]) * width + tile[0] + k % side[0]);
                let texel =
                    [own as f32, (other % side[0]) as f32, (other / side[0]) as f32, (share / count as f64) as f32];
                values[at..at + 4].copy_from_slice(&texel);
            }
        }
        Self { texture: Texture::new("under_top", width, 4, values), side, fine }
    }
}

/// Number of tiles per row, for a nearly square picture.
fn beside(tiles: usize) -> usize {
    (tiles as f64).sqrt().ceil() as usize
}

impl Field {
    /// Converts a relief, optionally for use under an environment, or returns the reason why cards do not support it.
    pub(super) fn new(relief: &Relief, error: f64, under: bool, progress: &dyn Progress) -> Result<Self, String> {
        let set = relief.terms(error, progress).map_err(|e| e.to_string())?;
        let reach = set.about.reach;
        let side = reach.map(|r| 2 * r + 1);
        let pairs = set.about.terms.div_ceil(2);
        let across = beside(pairs);
        let (width, height) = (side[0] * across, side[1] * pairs.div_ceil(across));
        if width * height * 16 > MAX_BYTES {
            let [w, h] = side;
            return Err(format!("its height field takes {pairs} pairs of terms at {w} × {h} frequencies, too much"));
        }
        let mut values = vec![0.0_f32; width * height * 4];
        for n in 0..set.about.terms {
            let tile = [n / 2 % across * side[0], n / 2 / across * side[1]];
            for y in 0..side[1] {
                for x in 0..side[0] {
                    let at = [x as isize - reach[0] as isize, y as isize - reach[1] as isize];
                    let c = set.amplitude(n, at);
                    let k = 4 * ((tile[1] + y) * width + tile[0] + x) + 2 * (n % 2);
                    values[k..k + 2].copy_from_slice(&[c.re, c.im]);
                }
            }
        }
        // Largest X: light and view along the normal, at the shortest wavelength.
        let half_um = set.about.half_um;
        let most = (2.0 * TAU * RANGE[1] * half_um).min(set.about.x_most);
        let per_x = (ROWS - 2) as f64 / most;
        // The linear-interpolation error of functions that oscillate with their phase is an eighth of the squared step.
        if 0.125 / (per_x * per_x) > 0.1 * error {
            return Err(format!("its height field is too deep for cards at this error: {most:.0} rad of phase"));
        }
        let row = |k: usize| set.functions((k as f64 / per_x).min(set.about.x_most));
        let texel = |pair: &[f64]| [pair[0] as f32, pair.get(1).map_or(0.0, |v| *v as f32), 0.0, 0.0];
        let phases = (0..ROWS).flat_map(|k| row(k).chunks(2).flat_map(texel).collect::<Vec<f32>>()).collect();
        let [views, numbers] = relief.norm().size();
        let across = beside(numbers);
        let mut norm = vec![0.0_f32; views * across * views * numbers.div_ceil(across)];
        for (k, line) in relief.norm().values().chunks_exact(views).enumerate() {
            let (n, y) = (k / views, k % views);
            let at = (n / across * views + y) * views * across + n % across * views;
            norm[at..at + views].copy_from_slice(line);
        }
        Ok(Self {
            terms: Texture::new("terms", width, 4, values),
            phases: Texture::new("phases", pairs, 4, phases),
            norm: Texture::new("norm", views * across, 1, norm),
            reach,
            pairs,
            per_x,
            half_um,
            cells: under.then(|| Cells::new(&set)),
        })
    }
}
