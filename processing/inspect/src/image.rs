//! Polarization images, the input of registration and comparison.

use nacre_image::catmull_rom;
use num_complex::Complex32;
use rayon::prelude::*;

/// A polarization image: per pixel the linear polarization as a complex number at twice the orientation, times the
/// brightness, and the brightness.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Real part, imaginary part and brightness, row by row, top row first; all finite.
    pub values: Vec<[f32; 3]>,
}

impl Image {
    /// Degree of linear polarization at twice the orientation.
    pub fn phasor(&self, i: usize) -> Complex32 {
        phasor(self.values[i])
    }

    /// Interpolated values at a position, by cubic convolution; `None` within a pixel of the edge and outside.
    pub fn at(&self, [x, y]: [f64; 2]) -> Option<[f32; 3]> {
        let (left, top) = (x.floor(), y.floor());
        let inside = left >= 1.0 && top >= 1.0 && left + 2.0 < self.width as f64 && top + 2.0 < self.height as f64;
        if !inside {
            return None;
        }
        let (across, down) = (catmull_rom((x - left) as f32), catmull_rom((y - top) as f32));
        let first = (top as usize - 1) * self.width + left as usize - 1;
        let mut sum = [0.0; 3];
        for (row, weight_down) in down.into_iter().enumerate() {
            let values = &self.values[first + row * self.width..][..4];
            for (value, weight) in values.iter().zip(across) {
                let weight = weight * weight_down;
                sum.iter_mut().zip(value).for_each(|(s, v)| *s += weight * v);
            }
        }
        Some(sum)
    }

    /// The image blurred by a Gaussian of this standard deviation in pixels; edges are continued.
    pub fn blurred(&self, sigma: f64) -> Self {
        let kernel = gaussian(sigma);
        let rows = convolved(&self.values, self.width, &kernel);
        let turned = transposed(&rows, self.width, self.height);
        let columns = convolved(&turned, self.height, &kernel);
        Self { values: transposed(&columns, self.height, self.width), ..*self }
    }

    /// The image averaged over blocks of `step` pixels; incomplete blocks are dropped.
    pub fn reduced(&self, step: usize) -> Self {
        let (width, height) = ((self.width / step).max(1), (self.height / step).max(1));
        let mean = |i: usize| {
            let (x, y) = (i % width * step, i / width * step);
            let mut sum = [0.0; 3];
            for row in y..(y + step).min(self.height) {
                for value in &self.values[row * self.width + x..][..step.min(self.width - x)] {
                    sum.iter_mut().zip(value).for_each(|(s, v)| *s += v);
                }
            }
            sum.map(|s| s / (step * step) as f32)
        };
        Self { width, height, values: (0..width * height).into_par_iter().map(mean).collect() }
    }
}

/// Degree of linear polarization at twice the orientation, from polarized part and brightness.
pub fn phasor([re, im, light]: [f32; 3]) -> Complex32 {
    if light > 0.0 { Complex32::new(re, im) / light } else { Complex32::default() }
}

/// Samples of a Gaussian, normalised, out to four standard deviations.
pub fn gaussian(sigma: f64) -> Vec<f32> {
    let reach = (4.0 * sigma).ceil() as i64;
    let weights: Vec<f64> = (-reach..=reach).map(|k| (-0.5 * (k as f64 / sigma.max(1e-6)).powi(2)).exp()).collect();
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|w| (w / sum) as f32).collect()
}

fn convolved(values: &[[f32; 3]], width: usize, kernel: &[f32]) -> Vec<[f32; 3]> {
    let reach = kernel.len() / 2;
    let mut out = vec![[0.0; 3]; values.len()];
    out.par_chunks_mut(width).zip(values.par_chunks(width)).for_each(|(out, row)| {
        for (x, out) in out.iter_mut().enumerate() {
            for (k, weight) in kernel.iter().enumerate() {
                let value = row[(x + k).saturating_sub(reach).min(width - 1)];
                out.iter_mut().zip(value).for_each(|(o, v)| *o += weight * v);
            }
        }
    });
    out
}

fn transposed<T: Copy + Default + Send + Sync>(values: &[T], width: usize, height: usize) -> Vec<T> {
    let mut turned = vec![T::default(); values.len()];
    turned.par_chunks_mut(height).enumerate().for_each(|(x, column)| {
        column.iter_mut().enumerate().for_each(|(y, v)| *v = values[y * width + x]);
    });
    turned
}
