//! Convolution by the fast Fourier transform.

use nacre_fourier::{ComplexToReal, Fft, Real, RealToComplex, real_forward, real_inverse};
use num_complex::Complex32;
use rayon::prelude::*;
use std::sync::Arc;

/// Transformed kernel for images of one size.
pub struct Convolution {
    /// Width of the padded transform.
    width: usize,
    height: usize,
    forward: Arc<dyn RealToComplex<f32>>,
    backward: Arc<dyn ComplexToReal<f32>>,
    columns: [Arc<dyn Fft<f32>>; 2],
    /// Transform of the kernel, column by column, divided by the number of values (the transforms do not normalise).
    kernel: Vec<Complex32>,
}

impl Convolution {
    /// Prepares a kernel for images of `size` (width, height) with zeros beyond. Width and height of the kernel are
    /// odd.
    pub fn new(size: [usize; 2], kernel: [usize; 2], values: &[f32]) -> Self {
        // Padding by half the kernel: only zeros wrap around.
        let [width, height] = [0, 1].map(|axis| good_size(size[axis] + kernel[axis] / 2));
        let mut this = Self {
            width,
            height,
            forward: real_forward(width),
            backward: real_inverse(width),
            columns: [f32::forward(height), f32::inverse(height)],
            kernel: vec![],
        };
        let mut image = vec![0.0; width * height];
        for (i, v) in values.iter().enumerate() {
            let x = (i % kernel[0] + width - kernel[0] / 2) % width;
            let y = (i / kernel[0] + height - kernel[1] / 2) % height;
            image[y * width + x] += v / (width * height) as f32;
        }
        this.kernel = this.transformed(&|y, row| row.copy_from_slice(&image[y * width..][..width]));
        this
    }

    /// Number of values per row of the half spectrum.
    fn half(&self) -> usize {
        self.width / 2 + 1
    }

    /// Transform of an image, column by column.
    fn transformed(&self, fill: &(dyn Fn(usize, &mut [f32]) + Sync)) -> Vec<Complex32> {
        let half = self.half();
        let mut rows = vec![Complex32::default(); half * self.height];
        rows.par_chunks_mut(half).enumerate().for_each_init(
            || (self.forward.make_input_vec(), self.forward.make_scratch_vec()),
            |(input, scratch), (y, out)| {
                input.fill(0.0);
                fill(y, input);
                // The lengths are those of the plan, so this cannot fail.
                _ = self.forward.process_with_scratch(input, out, scratch);
            },
        );
        let mut columns = turned(&rows, half);
        self.along_columns(&mut columns, 0);
        columns
    }

    fn along_columns(&self, columns: &mut [Complex32], direction: usize) {
        let plan = &self.columns[direction];
        columns.par_chunks_mut(self.height).for_each_init(
            || vec![Complex32::default(); plan.get_inplace_scratch_len()],
            |scratch, column| plan.process_with_scratch(column, scratch),
        );
    }

    /// Convolves an image, or correlates it with the kernel if `adjoint` (mirrored kernel).
    ///
    /// `fill(row, values)` writes one row of the image. The result has rows of [`Self::stride`] values.
    pub fn convolved(&self, fill: &(dyn Fn(usize, &mut [f32]) + Sync), adjoint: bool) -> Vec<f32> {
        let mut spectrum = self.transformed(fill);
        spectrum.par_iter_mut().zip(&self.kernel).for_each(|(v, k)| *v *= if adjoint { k.conj() } else { *k });
        self.along_columns(&mut spectrum, 1);
        let mut rows = turned(&spectrum, self.height);
        let mut image = vec![0.0; self.width * self.height];
        let (half, odd) = (self.half(), self.width % 2);
        rows.par_chunks_mut(half).zip(image.par_chunks_mut(self.width)).for_each_init(
            || self.backward.make_scratch_vec(),
            |scratch, (row, out)| {
                // Rounding can leave imaginary parts that the spectrum of a real signal does not have.
                row[0].im = 0.0;
                row[half - 1].im *= odd as f32;
                _ = self.backward.process_with_scratch(row, out, scratch);
            },
        );
        image
    }

    /// Number of values per row of the result of [`Self::convolved`].
    pub fn stride(&self) -> usize {
        self.width
    }
}

/// Transposes a matrix with `width` values per row.
fn turned(values: &[Complex32], width: usize) -> Vec<Complex32> {
    const TILE: usize = 16;
    let height = values.len() / width;
    let mut out = vec![Complex32::default(); values.len()];
    out.par_chunks_mut(TILE * height).enumerate().for_each(|(k, columns)| {
        for top in (0..height).step_by(TILE) {
            for (x, column) in columns.chunks_exact_mut(height).enumerate() {
                for y in top..(top + TILE).min(height) {
                    column[y] = values[y * width + k * TILE + x];
                }
            }
        }
    });
    out
}

/// Smallest even size from `at_least` on whose only prime factors are 2, 3 and 5.
pub(super) fn good_size(at_least: usize) -> usize {
    let good = |n: &usize| {
        let mut n = *n;
        for factor in [2, 3, 5] {
            while n.is_multiple_of(factor) {
                n /= factor;
            }
        }
        n == 1
    };
    (at_least.max(2).next_multiple_of(2)..).step_by(2).find(good).unwrap_or(at_least)
}
