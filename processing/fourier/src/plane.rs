//! Fourier transforms of complex images.

use crate::{Fft, Real};
use num_complex::Complex;
use rayon::prelude::*;
use std::sync::Arc;

/// Minimum number of values per task of a parallel transform; smaller images are transformed by the calling thread.
const TASK: usize = 1 << 16;

/// Side of the blocks transposed together, so that both rows and columns stay in the cache.
const BLOCK: usize = 16;

/// Fourier transforms of images of one size. Spectra are transposed: `width` rows of `height` values.
pub struct Fourier<T: Real> {
    size: [usize; 2],
    forward: [Arc<dyn Fft<T>>; 2],
    inverse: [Arc<dyn Fft<T>>; 2],
}

impl<T: Real> Fourier<T> {
    /// Transforms for images of this width and height.
    pub fn new(size: [usize; 2]) -> Self {
        Self { size, forward: size.map(T::forward), inverse: size.map(T::inverse) }
    }

    /// Transposed spectrum of an image of `width · height` values, row by row.
    pub fn forward(&self, mut image: Vec<Complex<T>>) -> Vec<Complex<T>> {
        let [width, height] = self.size;
        rows(&mut image, width, &*self.forward[0]);
        let mut spectrum = transposed(image, self.size);
        rows(&mut spectrum, height, &*self.forward[1]);
        spectrum
    }

    /// Image of a transposed spectrum, multiplied by `width · height`: neither direction is normalised.
    pub fn inverse(&self, mut spectrum: Vec<Complex<T>>) -> Vec<Complex<T>> {
        let [width, height] = self.size;
        rows(&mut spectrum, height, &*self.inverse[1]);
        let mut image = transposed(spectrum, [height, width]);
        rows(&mut image, width, &*self.inverse[0]);
        image
    }
}

fn rows<T: Real>(values: &mut [Complex<T>], length: usize, fft: &dyn Fft<T>) {
    values.par_chunks_mut(length * TASK.div_ceil(length)).for_each(|rows| fft.process(rows));
}

/// Transposes an image, in place if it is square.
fn transposed<T: Real>(mut image: Vec<Complex<T>>, [width, height]: [usize; 2]) -> Vec<Complex<T>> {
    if width == height {
        for top in (0..width).step_by(BLOCK) {
            for left in (0..=top).step_by(BLOCK) {
                for y in top..(top + BLOCK).min(width) {
                    for x in left..(left + BLOCK).min(y) {
                        image.swap(y * width + x, x * width + y);
                    }
                }
            }
        }
        return image;
    }
    let mut turned = vec![Complex::new(T::zero(), T::zero()); width * height];
    turned.par_chunks_mut(height * BLOCK).enumerate().for_each(|(block, columns)| {
        for y in 0..height {
            for (k, column) in columns.chunks_exact_mut(height).enumerate() {
                column[y] = image[y * width + block * BLOCK + k];
            }
        }
    });
    turned
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn spectra_are_sums_over_all_pixels_and_lead_back() {
        for size in [[6, 6], [40, 40], [12, 5], [3, 40]] {
            let [width, height] = size;
            let image: Vec<Complex<f64>> =
                (0..width * height).map(|i| Complex::new((i * i % 17) as f64, (i % 5) as f64)).collect();
            let fourier = Fourier::new(size);
            let spectrum = fourier.forward(image.clone());
            let [u, v] = [2 % width, 4 % height];
            let sum: Complex<f64> = (0..width * height)
                .map(|i| {
                    let phase = (u * (i % width)) as f64 / width as f64 + (v * (i / width)) as f64 / height as f64;
                    image[i] * Complex::cis(-TAU * phase)
                })
                .sum();
            assert!((spectrum[u * height + v] - sum).norm() < 1e-9 * sum.norm().max(1.0));
            let back = fourier.inverse(spectrum);
            let scale = (width * height) as f64;
            assert!(back.iter().zip(&image).all(|(b, i)| (b / scale - i).norm() < 1e-12 * scale));
        }
    }
}
