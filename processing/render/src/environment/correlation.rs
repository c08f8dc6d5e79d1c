//! Exact reflection of an environment by a flat sample, for all directions of view at once.
//!
//! `L(ωo) cos θo = ∬ S_d(ωi + ωo) (1 + ωi·ωo)² Li(ωi) dωi`. For unit vectors whose half vector has the tangential
//! length h, `1 + ωi·ωo = (h² + (zi + zo)²) / 2`. Its square is a polynomial in the cosine of view zo. Each coefficient
//! is a product of a power of h, a function of the table position, and of a power of zi. The integral is therefore a
//! sum of correlations over direction cosines, evaluated by Fourier transforms. All terms are non-negative, so grazing
//! light causes no cancellation.

use super::cosines::slices;
use nacre_base::Result;
use nacre_base::progress::Progress;
use nacre_fourier::Fourier;
use nacre_image::catmull_rom;
use num_complex::Complex64;
use rayon::prelude::*;

/// Incident light per cell of the disc of direction cosines, y upwards: sums of radiance times solid angle times powers
/// of z.
pub(crate) type Moments = Vec<[f64; 5]>;

/// A table entry times 1, h² and h⁴, by power and channel.
pub(crate) type Entry = [[f64; 3]; 3];

/// Powers of the cosine of incidence.
#[inline]
pub(crate) fn moments(z: f64) -> [f64; 5] {
    [1.0, z, z * z, z * z * z, z * z * z * z]
}

/// Integrates a radiance over the cells of the disc of direction cosines; the sampling points of a cell are at most
/// `apart` (rad) from each other.
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

/// The table entry at a half vector, with its powers of h².
#[inline]
pub(crate) fn entry(rgb: [f64; 3], [x, y]: [f64; 2]) -> Entry {
    let square = x * x + y * y;
    [1.0, square, square * square].map(|h| rgb.map(|v| v * h))
}

/// Terms of `4 (1 + ωi·ωo)²`: exponents of h², zi and zo, and the coefficient.
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

/// Radiance reflected by a flat sample, times the cosine of view.
///
/// It is stored as a polynomial in that cosine, with coefficients that are smooth up to the horizon.
#[derive(Default)]
pub(crate) struct Reflected {
    /// Cells along a side of the square of direction cosines from -1 to 1.
    size: usize,
    /// Polynomial coefficients per cell (row by row, upwards) and channel.
    cells: Vec<[[f32; 5]; 3]>,
}

/// Direction cosine at the centre of a cell.
pub(crate) fn cosine(size: usize, k: usize) -> f64 {
    (2.0 * k as f64 + 1.0) / size as f64 - 1.0
}

/// Correlates a table over half vectors with the light of `size · size` cells, channel by channel.
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
        // The coefficients are real, so two share an inverse transform as its real and imaginary parts.
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

/// Evaluates a polynomial.
#[inline]
fn polynomial(coefficients: [f32; 5], z: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * z + f64::from(*c))
}

impl Reflected {
    /// Cells along a side.
    pub(crate) fn size(&self) -> usize {
        self.size
    }

    /// Value at the centre of a cell (rows upwards), with cosine of view `z`.
    pub(crate) fn cell(&self, i: usize, z: f64) -> [f64; 3] {
        self.cells[i].map(|c| polynomial(c, z))
    }

    /// Value in a direction of view, by cubic interpolation between cells.
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
