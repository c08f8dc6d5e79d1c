//! Reference for all methods: direct sums of `exp(-iqh)` over all pixels, in double precision.

use super::geometry::Window;
use super::height::HeightField;
use num_complex::Complex64;
use pulp::Arch;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Fraction of the window that is truncated.
const OUTSIDE: f64 = 1e-9;

/// Number of rows per partial sum.
const ROWS: usize = 64;

/// Number of values that are added at once.
const LANES: usize = 8;

/// Patch for direct sums.
pub(super) struct Reference<'a> {
    field: &'a HeightField,
}

impl<'a> Reference<'a> {
    pub(super) fn new(field: &'a HeightField) -> Self {
        Self { field }
    }

    /// Power density in µm² at a spatial frequency in 1/µm, for `q = k (cos θi + cos θr)` in 1/µm. It includes all of
    /// the patch's frequencies under the window, up to half a cycle per pixel.
    pub(super) fn density(&self, place: [f64; 2], q: f64, window: Window) -> f64 {
        self.densities(&[place], q, window)[0]
    }

    /// Power densities at several frequencies, whose waves share the phases of the heights.
    pub(super) fn densities(&self, places: &[[f64; 2]], q: f64, window: Window) -> Vec<f64> {
        let radius = window.radius(OUTSIDE);
        let [width, height] = self.field.size_um();
        let range = |f: f64, um: f64, n: usize| {
            let most = (n as i64 - 1) / 2;
            (((f - radius) * um).ceil() as i64).max(-most)..=(((f + radius) * um).floor() as i64).min(most)
        };
        let near: Vec<[Vec<i64>; 2]> = (places.iter())
            .map(|p| [range(p[0], width, self.field.width).collect(), range(p[1], height, self.field.height).collect()])
            .collect();
        let all = self.amplitudes(q, &near);
        let weight = |place: &[f64; 2], ix: i64, iy: i64| {
            let square = (ix as f64 / width - place[0]).powi(2) + (iy as f64 / height - place[1]).powi(2);
            window.peak() * (-0.5 * square / (window.sigma * window.sigma)).exp()
        };
        let density = |((place, [columns, rows]), found): ((_, &[Vec<i64>; 2]), &Vec<Complex64>)| {
            let weights = rows.iter().flat_map(|iy| columns.iter().map(|ix| weight(place, *ix, *iy)));
            weights.zip(found).map(|(w, c)| w * c.norm_sqr()).sum()
        };
        places.iter().zip(&near).zip(&all).map(density).collect()
    }

    /// Amplitudes `1/N Σ exp(-iqh) exp(-2πi (fx x + fy y))` of rectangles of frequencies, `fx = ix/width` for all
    /// columns and `fy = iy/height` for all rows, y up, row by row.
    pub(super) fn amplitudes(&self, q: f64, near: &[[Vec<i64>; 2]]) -> Vec<Vec<Complex64>> {
        let (w, h) = (self.field.width, self.field.height);
        let turn = |k: i64, at: usize, n: usize| {
            Complex64::from_polar(1.0, -TAU * (k * at as i64).rem_euclid(n as i64) as f64 / n as f64)
        };
        let across: Vec<Vec<Split>> = (near.iter())
            .map(|[columns, _]| columns.iter().map(|ix| Split::new((0..w).map(|x| turn(*ix, x, w)))).collect())
            .collect();
        let nothing = || -> Vec<Vec<Complex64>> {
            near.iter().map(|[columns, rows]| vec![Complex64::default(); columns.len() * rows.len()]).collect()
        };
        let add = |mut all: Vec<Vec<Complex64>>, (y, heights): (usize, &[f64])| {
            let line = Split::new(heights.iter().map(|h| Complex64::from_polar(1.0, -q * h)));
            for ((out, waves), [columns, rows]) in all.iter_mut().zip(&across).zip(near) {
                // Rows count downwards, frequencies upwards.
                let down: Vec<Complex64> = rows.iter().map(|iy| turn(-iy, y, h)).collect();
                for (k, wave) in waves.iter().enumerate() {
                    let sum = line.dot(wave);
                    down.iter().enumerate().for_each(|(j, turn)| out[j * columns.len() + k] += sum * turn);
                }
            }
            all
        };
        let join = |mut all: Vec<Vec<Complex64>>, more: Vec<Vec<Complex64>>| {
            all.iter_mut().flatten().zip(more.iter().flatten()).for_each(|(a, b)| *a += b);
            all
        };
        // Pieces of equal size, so that sums are the same on any number of cores.
        let pieces: Vec<Vec<Vec<Complex64>>> = (self.field.um.par_chunks(w * ROWS).enumerate())
            .map(|(k, piece)| {
                piece.chunks_exact(w).enumerate().map(|(y, row)| (k * ROWS + y, row)).fold(nothing(), add)
            })
            .collect();
        let mut all = pieces.into_iter().fold(nothing(), join);
        let count = (w * h) as f64;
        all.iter_mut().flatten().for_each(|c| *c /= count);
        all
    }
}

/// Complex numbers as two rows, for vectorised sums of products.
struct Split {
    re: Vec<f64>,
    im: Vec<f64>,
}

impl Split {
    fn new(values: impl Iterator<Item = Complex64>) -> Self {
        let (re, im) = values.map(|c| (c.re, c.im)).unzip();
        Self { re, im }
    }

    fn dot(&self, other: &Self) -> Complex64 {
        Arch::new().dispatch(|| {
            let (mut re, mut im) = ([0.0; LANES], [0.0; LANES]);
            let whole = self.re.len() / LANES * LANES;
            for k in (0..whole).step_by(LANES) {
                let [a, b] = [&self.re[k..k + LANES], &self.im[k..k + LANES]];
                let [c, d] = [&other.re[k..k + LANES], &other.im[k..k + LANES]];
                for j in 0..LANES {
                    re[j] += a[j] * c[j] - b[j] * d[j];
                    im[j] += a[j] * d[j] + b[j] * c[j];
                }
            }
            let mut sum = Complex64::new(re.iter().sum(), im.iter().sum());
            for k in whole..self.re.len() {
                sum += Complex64::new(self.re[k], self.im[k]) * Complex64::new(other.re[k], other.im[k]);
            }
            sum
        })
    }
}
