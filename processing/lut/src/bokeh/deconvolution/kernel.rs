//! Convolution with a separable, symmetric kernel, compiled for several vector widths and dispatched at run time.
//!
//! Taps at equal distances share one multiplication. Columns are convolved first, two rows at a time, because both rows
//! load mostly the same values. The results stay in a scratch buffer in the cache until the row convolution.

use super::plane::{BAND, GROUP, Plane};
use pulp::{Arch, Simd, WithSimd};
use std::ops::Range;

/// Width of a strip in columns: as many of its rows as there are taps fit into the first-level cache.
const STRIP: usize = 128;

/// Number of vectors computed together along rows and along columns.
const ALONG_ROWS: usize = 4;
const ALONG_COLUMNS: usize = 2;

/// Number of rows computed together along the columns.
const PAIR: usize = 2;

/// Processing of each convolved row while it is in the cache.
pub(super) trait Rows {
    /// Processes the convolved row `y`.
    fn row(&mut self, y: usize, convolved: &[f32]);
}

/// Buffers of one thread.
#[derive(Default)]
pub(super) struct Scratch {
    /// Rows convolved along the columns, with zero padding.
    columns: Vec<f32>,
    /// One row convolved along both axes.
    row: Vec<f32>,
}

/// Convolves the rows `rows` of `input` with `half` (the centre and one side of the kernel) along both axes and passes
/// them to `each`. `input` needs at least `half.len() - 1` zeros of padding on every side.
pub(super) fn convolve<R: Rows>(input: &Plane, half: &[f32], rows: Range<usize>, scratch: &mut Scratch, each: &mut R) {
    Arch::new().dispatch(Convolve { input, half, rows, scratch, each });
}

struct Convolve<'a, R> {
    input: &'a Plane,
    half: &'a [f32],
    rows: Range<usize>,
    scratch: &'a mut Scratch,
    each: &'a mut R,
}

impl<R: Rows> WithSimd for Convolve<'_, R> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { input, half, rows, scratch, each } = self;
        let (stride, width) = (input.stride, input.width.next_multiple_of(GROUP));
        let left = input.start(0) % stride;
        scratch.columns.resize(stride * (BAND + PAIR) + GROUP, 0.0);
        scratch.row.resize(width, 0.0);
        let columns = &mut scratch.columns[..];
        let n = ALONG_COLUMNS * S::F32_LANES;
        for strip in (0..width).step_by(STRIP) {
            let end = (strip + STRIP).min(width);
            for y in rows.clone().step_by(PAIR) {
                let (from, to) = (input.start(y), (y - rows.start) * stride + left);
                for x in (strip..end).step_by(n) {
                    // The partner of the last row is computed from padding and discarded.
                    let [upper, lower] = pair::<S, ALONG_COLUMNS>(simd, &input.values, from + x, stride, half);
                    put::<S, ALONG_COLUMNS>(&mut columns[to + x..], upper);
                    put::<S, ALONG_COLUMNS>(&mut columns[to + stride + x..], lower);
                }
            }
        }
        let n = ALONG_ROWS * S::F32_LANES;
        for y in rows.clone() {
            let from = (y - rows.start) * stride + left;
            for x in (0..width).step_by(n) {
                put::<S, ALONG_ROWS>(&mut scratch.row[x..], one::<S, ALONG_ROWS>(simd, columns, from + x, half));
            }
            each.row(y, &scratch.row[..input.width]);
        }
    }
}

/// Loads `N` vectors from a position on.
#[inline(always)]
fn get<S: Simd, const N: usize>(values: &[f32], at: usize) -> [S::f32s; N] {
    let vectors = S::as_simd_f32s(&values[at..at + N * S::F32_LANES]).0;
    std::array::from_fn(|i| vectors[i])
}

#[inline(always)]
fn put<S: Simd, const N: usize>(to: &mut [f32], vectors: [S::f32s; N]) {
    S::as_mut_simd_f32s(&mut to[..N * S::F32_LANES]).0.copy_from_slice(&vectors);
}

/// Convolution along a row.
#[inline(always)]
fn one<S: Simd, const N: usize>(simd: S, values: &[f32], at: usize, half: &[f32]) -> [S::f32s; N] {
    let middle = simd.splat_f32s(half[0]);
    let mut sums = get::<S, N>(values, at).map(|v| simd.mul_f32s(middle, v));
    for (k, tap) in half.iter().enumerate().skip(1) {
        let tap = simd.splat_f32s(*tap);
        let (before, after) = (get::<S, N>(values, at - k), get::<S, N>(values, at + k));
        for i in 0..N {
            sums[i] = simd.mul_add_e_f32s(tap, simd.add_f32s(before[i], after[i]), sums[i]);
        }
    }
    sums
}

/// Convolution along columns for two adjacent rows. The value `k - 1` above the upper row is `k` above the lower one,
/// so both share the load.
#[inline(always)]
fn pair<S: Simd, const N: usize>(simd: S, values: &[f32], at: usize, step: usize, half: &[f32]) -> [[S::f32s; N]; 2] {
    let middle = simd.splat_f32s(half[0]);
    let (mut above, mut below) = (get::<S, N>(values, at), get::<S, N>(values, at + step));
    let mut upper = above.map(|v| simd.mul_f32s(middle, v));
    let mut lower = below.map(|v| simd.mul_f32s(middle, v));
    for (k, tap) in half.iter().enumerate().skip(1) {
        let tap = simd.splat_f32s(*tap);
        let (higher, deeper) = (get::<S, N>(values, at - k * step), get::<S, N>(values, at + (k + 1) * step));
        for i in 0..N {
            upper[i] = simd.mul_add_e_f32s(tap, simd.add_f32s(higher[i], below[i]), upper[i]);
            lower[i] = simd.mul_add_e_f32s(tap, simd.add_f32s(above[i], deeper[i]), lower[i]);
        }
        (above, below) = (higher, deeper);
    }
    [upper, lower]
}
