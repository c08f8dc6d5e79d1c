//! The truth that the methods are measured by: `exp(-iqh)` of every pixel, and direct sums, in double precision.

use super::geometry::Window;
use super::height::HeightField;
use num_complex::Complex64;
use std::f64::consts::TAU;

/// Part of the window that is left out.
const OUTSIDE: f64 = 1e-9;

/// A patch for direct sums.
pub(super) struct Reference<'a> {
    field: &'a HeightField,
}

impl<'a> Reference<'a> {
    pub(super) fn new(field: &'a HeightField) -> Self {
        Self { field }
    }

    /// Power density in µm² at a spatial frequency in 1/µm, for `q = k (cos θi + cos θr)` in 1/µm: all of the patch's frequencies under the
    /// window, of which none is beyond half a cycle per pixel.
    pub(super) fn density(&self, place: [f64; 2], q: f64, window: Window) -> f64 {
        let [width, height] = self.field.size_um();
        let radius = window.radius(OUTSIDE);
        let range = |f: f64, um: f64, n: usize| {
            let most = (n as i64 - 1) / 2;
            (((f - radius) * um).ceil() as i64).max(-most)..=(((f + radius) * um).floor() as i64).min(most)
        };
        let columns: Vec<i64> = range(place[0], width, self.field.width).collect();
        let rows: Vec<i64> = range(place[1], height, self.field.height).collect();
        let amplitudes = self.amplitudes(q, &columns, &rows);
        let weight = |ix: i64, iy: i64| {
            let square = (ix as f64 / width - place[0]).powi(2) + (iy as f64 / height - place[1]).powi(2);
            window.peak() * (-0.5 * square / (window.sigma * window.sigma)).exp()
        };
        let all = rows.iter().flat_map(|iy| columns.iter().map(|ix| weight(*ix, *iy)));
        all.zip(amplitudes).map(|(w, c)| w * c.norm_sqr()).sum()
    }

    /// `1/N Σ exp(-iqh) exp(-2πi (fx x + fy y))` for the frequencies `fx = ix/width` and `fy = iy/height`, y up, row by row.
    pub(super) fn amplitudes(&self, q: f64, columns: &[i64], rows: &[i64]) -> Vec<Complex64> {
        let (w, h) = (self.field.width, self.field.height);
        let turn = |k: i64, at: usize, n: usize| {
            Complex64::from_polar(1.0, -TAU * (k * at as i64).rem_euclid(n as i64) as f64 / n as f64)
        };
        let across: Vec<Vec<Complex64>> = columns.iter().map(|ix| (0..w).map(|x| turn(*ix, x, w)).collect()).collect();
        let mut out = vec![Complex64::new(0.0, 0.0); columns.len() * rows.len()];
        let mut line = vec![Complex64::new(0.0, 0.0); w];
        for (y, heights) in self.field.um.chunks_exact(w).enumerate() {
            line.iter_mut().zip(heights).for_each(|(p, h)| *p = Complex64::from_polar(1.0, -q * h));
            for (k, wave) in across.iter().enumerate() {
                let sum: Complex64 = line.iter().zip(wave).map(|(p, e)| p * e).sum();
                for (j, iy) in rows.iter().enumerate() {
                    // Rows count downwards, frequencies up.
                    out[j * columns.len() + k] += sum * turn(-iy, y, h);
                }
            }
        }
        let count = (w * h) as f64;
        out.iter_mut().for_each(|c| *c /= count);
        out
    }
}
