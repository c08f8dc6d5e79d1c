//! What a flat sample reflects of light from everywhere, for all directions of view at once.
//!
//! `L(ωo) cos θo = ∬ S_d(ωi + ωo) (1 + ωi·ωo)² Li(ωi) dωi`. Between unit vectors whose half vector has the length h along the surface,
//! `1 + ωi·ωo = (h² + (zi + zo)²) / 2`, so that the square is a polynomial in the cosine of view zo whose coefficients are products of a power of h, which
//! is a function of the table's place, and one of zi: correlations over direction cosines, by Fourier transforms. None of them is negative, so that
//! nothing cancels where light grazes.

use super::cosines::slices;
use nacre_base::Result;
use nacre_base::progress::Progress;
use nacre_fourier::Fourier;
use nacre_image::catmull_rom;
use num_complex::Complex64;
use rayon::prelude::*;

/// Light of the cells of the disc of direction cosines, y upwards: sums over a cell of radiance times solid angle times powers of z.
pub(crate) type Moments = Vec<[f64; 5]>;

/// A table's entry times 1, h² and h⁴, by power and channel.
pub(crate) type Entry = [[f64; 3]; 3];

/// Powers of the cosine of light.
#[inline]
pub(crate) fn moments(z: f64) -> [f64; 5] {
    [1.0, z, z * z, z * z * z, z * z * z * z]
}

/// Light over the disc of direction cosines, from a radiance by direction: places of each cell are no farther `apart` than that (rad).
pub(crate) fn light(size: usize, apart: f64, radiance: impl Fn([f64; 3]) -> f64 + Sync) -> Moments {
    let cell = 2.0 / size as f64;
    let across = (cell / apart).ceil().max(1.0) as usize;
    let sum = |i: usize| {
        let mut sum = [0.0; 5];
        for slice in slices([cosine(size, i % size), cosine(size, i / size)], [cell; 2], across) {
            let [from, to] = slice.angles;
            let count = ((to - from) / apart).ceil().max(1.0);
            let step = (to - from) / count;
            for k in 0..count as usize {
                let towards = slice.direction(from + (k as f64 + 0.5) * step);
                let power = radiance(towards) * step * slice.width;
                sum.iter_mut().zip(moments(towards[2])).for_each(|(s, m)| *s += m * power);
            }
        }
        sum
    };
    (0..size * size).into_par_iter().map(sum).collect()
}

/// An entry of a table at a half vector.
#[inline]
pub(crate) fn entry(rgb: [f64; 3], [x, y]: [f64; 2]) -> Entry {
    let square = x * x + y * y;
    [1.0, square, square * square].map(|h| rgb.map(|v| v * h))
}

/// `4 (1 + ωi·ωo)²`: how often the product of a power of h², of zi and of zo is in it.
const TERMS: [(usize, usize, usize, f64); 9] = [
    (2, 0, 0, 1.0),
    (1, 2, 0, 2.0),
    (0, 4, 0, 1.0),
    (1, 1, 1, 4.0),
    (0, 3, 1, 4.0),
    (1, 0, 2, 2.0),
    (0, 2, 2, 6.0),
    (0, 1, 3, 4.0),
    (0, 0, 4, 1.0),
];

/// Radiance that a flat sample reflects, times the cosine of view.
///
/// Kept as a polynomial of that cosine whose coefficients are smooth up to the horizon.
#[derive(Default)]
pub(crate) struct Reflected {
    /// Cells along a side of the square of direction cosines from -1 to 1.
    size: usize,
    /// Per cell, row by row upwards, and channel: the coefficients.
    cells: Vec<[[f32; 5]; 3]>,
}

/// Centre of a cell.
pub(crate) fn cosine(size: usize, k: usize) -> f64 {
    (2.0 * k as f64 + 1.0) / size as f64 - 1.0
}

/// Of a table over half vectors and the light of `size · size` cells, channel by channel.
///
/// # Errors
/// `Cancelled`.
pub(crate) fn correlate(
    size: usize,
    table: impl Fn([f64; 2]) -> Entry + Sync,
    light: impl Fn(usize) -> Moments,
    progress: &dyn Progress,
) -> Result<Reflected> {
    let side = 2 * size;
    let fourier = Fourier::new([side; 2]);
    let mut cells = vec![[[0.0_f32; 5]; 3]; size * size];
    // ωi + ωo of cells a and b is 2(a + b + 1)/size - 2.
    let half_vector = |i: usize| [i % side, i / side].map(|k| 2.0 * (k as f64 + 1.0) / size as f64 - 2.0);
    let entries: Vec<Entry> = (0..side * side).into_par_iter().map(|i| table(half_vector(i))).collect();
    for channel in 0..3 {
        let light = light(channel);
        progress.check()?;
        let tables = [0, 1, 2]
            .map(|power| fourier.forward(entries.iter().map(|e| Complex64::new(e[power][channel], 0.0)).collect()));
        // Coefficients are real, so that two share a transform back: the second is its imaginary part.
        let mut sums = [const { vec![] }; 3].map(|mut plane: Vec<Complex64>| {
            plane.resize(side * side, Complex64::default());
            plane
        });
        for moment in 0..5 {
            progress.check()?;
            let mut plane = vec![Complex64::default(); side * side];
            for (row, light) in plane.chunks_exact_mut(side).zip(light.chunks_exact(size)) {
                row.iter_mut().zip(light).for_each(|(to, m)| to.re = m[moment]);
            }
            let plane = fourier.forward(plane);
            for (power, _, coefficient, times) in TERMS.into_iter().filter(|term| term.1 == moment) {
                let unit = if coefficient % 2 == 0 { Complex64::new(1.0, 0.0) } else { Complex64::i() };
                let unit = unit * (0.25 * times);
                let all = sums[coefficient / 2].par_iter_mut().zip(&tables[power]).zip(&plane);
                all.for_each(|((sum, table), light)| *sum += unit * table * light.conj());
            }
        }
        for (pair, spectrum) in sums.into_iter().enumerate() {
            let plane = fourier.inverse(spectrum);
            for (i, cell) in cells.iter_mut().enumerate() {
                let found = plane[i / size * side + i % size] / (side * side) as f64;
                cell[channel][2 * pair] = found.re as f32;
                if pair < 2 {
                    cell[channel][2 * pair + 1] = found.im as f32;
                }
            }
        }
    }
    Ok(Reflected { size, cells })
}

/// A polynomial's value.
#[inline]
fn polynomial(coefficients: [f32; 5], z: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * z + f64::from(*c))
}

impl Reflected {
    /// Cells along a side.
    pub(crate) fn size(&self) -> usize {
        self.size
    }

    /// In the centre of a cell, rows upwards, whose cosine of view is `z`.
    pub(crate) fn cell(&self, i: usize, z: f64) -> [f64; 3] {
        self.cells[i].map(|c| polynomial(c, z))
    }

    /// In a direction of view, cubic between cells.
    pub(crate) fn at(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let n = self.size;
        let place = |v: f64| ((v + 1.0) * 0.5 * n as f64 - 0.5).clamp(0.0, (n - 1) as f64);
        let (x, y) = (place(x), place(y));
        let (i, j) = ((x as usize).min(n - 2), (y as usize).min(n - 2));
        let (u, v) = (catmull_rom((x - i as f64) as f32), catmull_rom((y - j as f64) as f32));
        let near = |i: usize| [0, 1, 2, 3].map(|o| (i + o).saturating_sub(1).min(n - 1));
        let mut sum = [[0.0_f32; 5]; 3];
        for (row, v) in near(j).into_iter().zip(v) {
            for (column, u) in near(i).into_iter().zip(u) {
                let cell = &self.cells[row * n + column];
                sum.as_flattened_mut().iter_mut().zip(cell.as_flattened()).for_each(|(s, c)| *s += u * v * c);
            }
        }
        sum.map(|c| polynomial(c, z))
    }
}
