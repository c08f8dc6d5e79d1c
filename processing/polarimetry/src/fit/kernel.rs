//! Inner loops of the fit over runs of pixels, compiled for several instruction sets, one of which is selected at run
//! time.
//!
//! Multiplications and additions are not fused, so results are bit-identical on all processors and for every grouping
//! of frames.

use super::TILE;
use crate::Design;
use nacre_base::memory::{prefetch, store_past_caches, stored};
use pulp::{Arch, Simd, WithSimd};
use std::ops::Range;

/// Sums of a run of pixels, all of the same length.
pub(super) struct Sums<'a> {
    pub pivot: &'a mut [f32],
    pub sum: &'a mut [f32],
    pub cos: &'a mut [f32],
    pub sin: &'a mut [f32],
    pub square: &'a mut [f32],
}

/// A run of pixels of one frame, with cos 2ψ and sin 2ψ of its analyser angle.
#[derive(Clone, Copy)]
pub(super) struct Run<'a> {
    pub values: &'a [f32],
    pub factors: [f32; 2],
}

/// Constants of the solution, shared by all pixels.
pub(super) struct Solution {
    inverse: [[f32; 3]; 3],
    frames: f32,
}

impl Solution {
    pub(super) fn new(design: &Design) -> Self {
        let inverse = std::array::from_fn(|i| std::array::from_fn(|j| design.inverse[(i, j)] as f32));
        Self { inverse, frames: design.frames() as f32 }
    }
}

impl Sums<'_> {
    /// Resets the sums; the pivot stays.
    pub(super) fn clear(&mut self) {
        let Self { sum, cos, sin, square, .. } = self;
        [sum, cos, sin, square].into_iter().for_each(|plane| plane.fill(0.0));
    }

    /// Adds frames in their order. The first frame is the pivot, which contributes nothing.
    pub(super) fn fold(&mut self, frames: &[Run]) {
        Arch::new().dispatch(Fold { sums: self, frames });
    }

    /// Replaces the sums by the solution: the pivot by S0, `cos` and `sin` by S1 and S2, `square` by the residual and
    /// `sum` by the correlation. All are NaN where `bad` is not 0 or a frame was not finite.
    pub(super) fn solve(&mut self, bad: &[u8], solution: &Solution) {
        Arch::new().dispatch(Solve { sums: self, bad, solution });
    }

    /// Result of [`Self::fold`] and [`Self::solve`] for these frames, with the pivot before the others. Previous sums,
    /// at most a [`TILE`] long, are overwritten. The slices of the other frames extend beyond the pixels of the pivot
    /// as far as there are more.
    pub(super) fn fit(&mut self, pivot: &[f32], others: &[Run], solution: &Solution) {
        Arch::new().dispatch(Fit { maps: self, pivot, others, solution });
    }
}

/// The sums of one pixel.
#[derive(Clone, Copy, Default)]
struct Pixel {
    sum: f32,
    cos: f32,
    sin: f32,
    square: f32,
}

impl Pixel {
    #[inline(always)]
    fn add(&mut self, difference: f32, [cos, sin]: [f32; 2]) {
        self.sum += difference;
        self.cos += cos * difference;
        self.sin += sin * difference;
        self.square += difference * difference;
    }

    /// S0, S1, S2, residual and correlation.
    #[inline(always)]
    fn solve(self, pivot: f32, usable: bool, Solution { inverse, frames }: &Solution) -> [f32; 5] {
        let t = [self.sum, self.cos, self.sin];
        let beta = inverse.map(|m| m[0] * t[0] + m[1] * t[1] + m[2] * t[2]);
        let explained = beta[0] * t[0] + beta[1] * t[1] + beta[2] * t[2];
        let total = self.square - t[0] * t[0] / frames;
        let left = (self.square - explained).max(0.0);
        let nan = if usable && self.sum.is_finite() { 0.0 } else { f32::NAN };
        let square = (1.0 - left / total).clamp(0.0, 1.0);
        let correlation = if total > 0.0 { square.sqrt() } else { 0.0 };
        [2.0 * (pivot + beta[0]), 2.0 * beta[1], 2.0 * beta[2], left, correlation].map(|v| v + nan)
    }
}

struct Fold<'s, 'a, 'f> {
    sums: &'s mut Sums<'a>,
    frames: &'f [Run<'f>],
}

impl WithSimd for Fold<'_, '_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Sums { pivot, sum, cos, sin, square } = self.sums;
        for some in self.frames.chunks(TOGETHER) {
            add_several(pivot, some, &Ahead::NOTHING, false, [&mut *sum, cos, sin, square]);
        }
    }
}

/// Maximum number of frames added together: every sum is loaded and stored once for all of them. These frames and as
/// many prefetched ones fit into an eight-way first-level cache; six take a tenth longer on one processor
/// (docs/validation/speed.md).
const TOGETHER: usize = 4;

/// Pixels that are added while as many of the next frames are prefetched.
const BLOCK: usize = 64;

/// Pixels of the frames that are needed next, and their distance from the present ones.
struct Ahead<'f> {
    frames: &'f [Run<'f>],
    by: usize,
}

impl Ahead<'_> {
    const NOTHING: Self = Self { frames: &[], by: 0 };

    #[inline(always)]
    fn fetch(&self, here: &Range<usize>) {
        for run in self.frames {
            prefetch(run.values.get(self.by + here.start..self.by + here.end).unwrap_or_default());
        }
    }
}

/// Adds at most [`TOGETHER`] frames to the sums, or replaces the sums if the frames are the `first`.
#[inline(always)]
fn add_several(pivot: &[f32], frames: &[Run], next: &Ahead, first: bool, sums: [&mut [f32]; 4]) {
    match *frames {
        [a, b, c, d] => add(pivot, [a, b, c, d], next, first, sums),
        [a, b, c] => add(pivot, [a, b, c], next, first, sums),
        [a, b] => add(pivot, [a, b], next, first, sums),
        [a] => add(pivot, [a], next, first, sums),
        _ => {}
    }
}

#[inline(always)]
fn add<const N: usize>(pivot: &[f32], frames: [Run; N], next: &Ahead, first: bool, sums: [&mut [f32]; 4]) {
    let (n, [sum, cos, sin, square]) = (pivot.len(), sums);
    let mut from = 0;
    while from < n {
        let here = from..(from + BLOCK).min(n);
        next.fetch(&here);
        let mut runs = frames;
        for run in &mut runs {
            run.values = &run.values[here.clone()];
        }
        let pivot = &pivot[here.clone()];
        let sums = [&mut sum[here.clone()], &mut cos[here.clone()], &mut sin[here.clone()], &mut square[here.clone()]];
        // For a constant length the compiler vectorises without a remainder loop.
        if here.len() == BLOCK {
            add_block(pivot, runs, first, sums, BLOCK)
        } else {
            add_block(pivot, runs, first, sums, here.len())
        }
        from = here.end;
    }
}

#[inline(always)]
fn add_block<const N: usize>(pivot: &[f32], mut runs: [Run; N], first: bool, sums: [&mut [f32]; 4], n: usize) {
    // Lengths known to be equal remove bounds checks from the loop.
    for run in &mut runs {
        run.values = &run.values[..n];
    }
    let (pivot, [sum, cos, sin, square]) = (&pivot[..n], sums);
    let (sum, cos, sin, square) = (&mut sum[..n], &mut cos[..n], &mut sin[..n], &mut square[..n]);
    for x in 0..n {
        let before = Pixel { sum: sum[x], cos: cos[x], sin: sin[x], square: square[x] };
        let mut pixel = if first { Pixel::default() } else { before };
        for run in &runs {
            pixel.add(run.values[x] - pivot[x], run.factors);
        }
        (sum[x], cos[x], sin[x], square[x]) = (pixel.sum, pixel.cos, pixel.sin, pixel.square);
    }
}

struct Solve<'s, 'a, 'f> {
    sums: &'s mut Sums<'a>,
    bad: &'f [u8],
    solution: &'f Solution,
}

impl WithSimd for Solve<'_, '_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let (n, Sums { pivot, sum, cos, sin, square }) = (self.sums.pivot.len(), self.sums);
        let (pivot, sum, cos, bad) = (&mut pivot[..n], &mut sum[..n], &mut cos[..n], &self.bad[..n]);
        let (sin, square) = (&mut sin[..n], &mut square[..n]);
        for x in 0..n {
            let pixel = Pixel { sum: sum[x], cos: cos[x], sin: sin[x], square: square[x] };
            [pivot[x], cos[x], sin[x], square[x], sum[x]] = pixel.solve(pivot[x], bad[x] == 0, self.solution);
        }
    }
}

struct Fit<'s, 'a, 'f> {
    maps: &'s mut Sums<'a>,
    pivot: &'f [f32],
    others: &'f [Run<'f>],
    solution: &'f Solution,
}

/// Distance between the sums of a tile: not a multiple of a page, to avoid conflicts in the first-level cache.
const APART: usize = TILE + 32;

impl WithSimd for Fit<'_, '_, '_> {
    type Output = ();

    /// A few frames at a time: frames are often a multiple of a page apart, and all of them at once then take 1.5 times
    /// as long (docs/validation/speed.md).
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { maps, pivot, others, solution } = self;
        let n = pivot.len();
        let mut planes = [[0.0; APART]; 5];
        let [sum, cos, sin, square, fifth] = planes.each_mut();
        let (sum, cos, sin, square, fifth) =
            (&mut sum[..n], &mut cos[..n], &mut sin[..n], &mut square[..n], &mut fifth[..n]);
        let mut rest = others;
        while !rest.is_empty() {
            let (some, left) = rest.split_at(TOGETHER.min(rest.len()));
            let (next, by) = if left.is_empty() { (others, n) } else { (left, 0) };
            let next = Ahead { frames: &next[..TOGETHER.min(next.len())], by };
            add_several(pivot, some, &next, rest.len() == others.len(), [&mut *sum, cos, sin, square]);
            rest = left;
        }
        for x in 0..n {
            let pixel = Pixel { sum: sum[x], cos: cos[x], sin: sin[x], square: square[x] };
            [sum[x], cos[x], sin[x], square[x], fifth[x]] = pixel.solve(pivot[x], true, solution);
        }
        let Sums { pivot: s0, cos: s1, sin: s2, square: residual, sum: correlation } = maps;
        for (map, solved) in [(s0, sum), (s1, cos), (s2, sin), (residual, square), (correlation, fifth)] {
            store_past_caches(map, solved);
        }
        stored();
    }
}
