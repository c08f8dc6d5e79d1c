//! Fourier transforms of a patch of which only the low frequencies are kept: orders beyond 2/λ leave the surface in no direction.

use num_complex::Complex;
use rayon::prelude::*;
use realfft::{FftNum, RealFftPlanner, RealToComplex};
use rustfft::{Fft, FftPlanner};
use std::sync::Arc;

/// Columns that are gathered at once: a line of the cache.
const TOGETHER: usize = 8;

/// f32 or f64.
pub(super) trait Real: FftNum {
    fn of(value: f64) -> Self;
    fn double(self) -> f64;
}

impl Real for f32 {
    #[inline(always)]
    fn of(value: f64) -> Self {
        value as f32
    }
    #[inline(always)]
    fn double(self) -> f64 {
        f64::from(self)
    }
}

impl Real for f64 {
    #[inline(always)]
    fn of(value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn double(self) -> f64 {
        self
    }
}

/// Takes the number of a function and its values along a row.
pub(super) type Put<'a> = dyn FnMut(usize, &[f64]) + 'a;

/// Transforms of one size.
///
/// A result holds `1/N Σ z exp(-2πi (fx x + fy y))` for the frequencies `fx = ix/width`, `fy = iy/height` (y up) of a rectangle:
/// `|ix|` and `|iy|` up to [`Plan::reach`].
pub(super) struct Plan<T: Real> {
    width: usize,
    height: usize,
    reach: [usize; 2],
    rows: Arc<dyn RealToComplex<T>>,
    complex_rows: Arc<dyn Fft<T>>,
    columns: Arc<dyn Fft<T>>,
}

impl<T: Real> Plan<T> {
    /// For patches of this size, and frequencies up to these, in cycles per patch.
    pub(super) fn new(width: usize, height: usize, [mx, my]: [usize; 2]) -> Self {
        let mut planner = FftPlanner::new();
        Self {
            width,
            height,
            reach: [mx.min((width - 1) / 2), my.min((height - 1) / 2)],
            rows: RealFftPlanner::new().plan_fft_forward(width),
            complex_rows: planner.plan_fft_forward(width),
            columns: planner.plan_fft_forward(height),
        }
    }

    /// Largest frequencies, in cycles per patch.
    pub(super) fn reach(&self) -> [usize; 2] {
        self.reach
    }

    /// Index of a frequency in a result.
    pub(super) fn place(&self, ix: isize, iy: isize) -> usize {
        let [mx, my] = self.reach.map(|m| m as isize);
        ((iy + my) * (2 * mx + 1) + ix + mx) as usize
    }

    /// Of real values.
    pub(super) fn real(&self, values: &[T]) -> Vec<Complex<T>> {
        let row = |y: usize, put: &mut Put| {
            let row: Vec<f64> = values[y * self.width..][..self.width].iter().map(|v| v.double()).collect();
            put(0, &row);
        };
        let mut plane = vec![];
        self.series(1, &row, |_, found| plane = found);
        plane
    }

    /// Of several real functions whose rows are made one after another: `row(y, put)` puts each function's row y by its number, and
    /// `done` gets their results. A row's functions never leave the processor's cache.
    pub(super) fn series(
        &self,
        count: usize,
        row: &(dyn Fn(usize, &mut Put) + Sync),
        mut done: impl FnMut(usize, Vec<Complex<T>>),
    ) {
        let kept = self.reach[0] + 1;
        let mut half = vec![Complex::new(T::zero(), T::zero()); count * kept * self.height];
        half.par_chunks_mut(count * kept).enumerate().for_each_init(
            || (self.rows.make_input_vec(), self.rows.make_output_vec(), self.rows.make_scratch_vec()),
            |(input, output, scratch), (y, all)| {
                row(y, &mut |k, values| {
                    input.iter_mut().zip(values).for_each(|(to, from)| *to = T::of(*from));
                    // Lengths are the plan's own, so this cannot fail.
                    let _ = self.rows.process_with_scratch(input, output, scratch);
                    all[k * kept..][..kept].copy_from_slice(&output[..kept]);
                });
            },
        );
        let [mx, my] = self.reach.map(|m| m as isize);
        for k in 0..count {
            let columns = self.transposed(&half[k * kept..], count * kept, kept);
            let mut out = vec![Complex::new(T::zero(), T::zero()); self.len()];
            for ix in 0..=mx {
                let column = &columns[ix as usize * self.height..][..self.height];
                for iy in -my..=my {
                    // Row numbers grow downwards.
                    let value = column[(-iy).rem_euclid(self.height as isize) as usize];
                    out[self.place(ix, iy)] = value;
                    out[self.place(-ix, -iy)] = value.conj();
                }
            }
            done(k, out);
        }
    }

    /// Of complex values.
    pub(super) fn complex(&self, mut values: Vec<Complex<T>>) -> Vec<Complex<T>> {
        values.par_chunks_mut(self.width).for_each_init(
            || vec![Complex::new(T::zero(), T::zero()); self.complex_rows.get_inplace_scratch_len()],
            |scratch, row| self.complex_rows.process_with_scratch(row, scratch),
        );
        let [mx, my] = self.reach.map(|m| m as isize);
        let (width, count) = (self.width, 2 * self.reach[0] + 1);
        let mut kept = vec![Complex::new(T::zero(), T::zero()); count * self.height];
        for (to, from) in kept.chunks_mut(count).zip(values.chunks(width)) {
            let (low, high) = to.split_at_mut(mx as usize);
            low.copy_from_slice(&from[width - mx as usize..]);
            high.copy_from_slice(&from[..=mx as usize]);
        }
        let columns = self.transposed(&kept, count, count);
        let mut out = vec![Complex::new(T::zero(), T::zero()); self.len()];
        for (k, column) in columns.chunks(self.height).enumerate() {
            for iy in -my..=my {
                out[self.place(k as isize - mx, iy)] = column[(-iy).rem_euclid(self.height as isize) as usize];
            }
        }
        out
    }

    fn len(&self) -> usize {
        (2 * self.reach[0] + 1) * (2 * self.reach[1] + 1)
    }

    /// Columns one after another, transformed and scaled, of the first `count` numbers of rows this far apart.
    fn transposed(&self, rows: &[Complex<T>], stride: usize, count: usize) -> Vec<Complex<T>> {
        let scale = T::of(1.0 / (self.width * self.height) as f64);
        let mut columns = vec![Complex::new(T::zero(), T::zero()); count * self.height];
        // Several columns at once: what a row holds of them lies together in memory.
        columns.par_chunks_mut(self.height * TOGETHER).enumerate().for_each_init(
            || vec![Complex::new(T::zero(), T::zero()); self.columns.get_inplace_scratch_len()],
            |scratch, (group, columns)| {
                for (y, row) in rows.chunks(stride).enumerate() {
                    let places = columns[y..].iter_mut().step_by(self.height);
                    places.zip(&row[group * TOGETHER..]).for_each(|(to, from)| *to = *from * scale);
                }
                columns.chunks_exact_mut(self.height).for_each(|c| self.columns.process_with_scratch(c, scratch));
            },
        );
        columns
    }
}
