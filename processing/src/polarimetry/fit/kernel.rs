//! The inner loops of the fit, over runs of pixels; compiled for the vectors of old and of new processors, which are told apart
//! when the program runs.
//!
//! No multiplication is fused with an addition, so all processors give the same bits, and so do all ways to group the frames.

use crate::polarimetry::Design;
use pulp::{Arch, Simd, WithSimd};

/// Sums of a run of pixels, all of the same length.
pub(super) struct Sums<'a> {
    pub pivot: &'a mut [f32],
    pub sum: &'a mut [f32],
    pub cos: &'a mut [f32],
    pub sin: &'a mut [f32],
    pub square: &'a mut [f32],
}

/// A run of pixels of one frame, and cos 2ψ and sin 2ψ of its analyser angle.
#[derive(Clone, Copy)]
pub(super) struct Run<'a> {
    pub values: &'a [f32],
    pub factors: [f32; 2],
}

/// What all pixels share when they are solved.
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
    /// Sums of nothing; the pivot stays.
    pub(super) fn clear(&mut self) {
        let Self { sum, cos, sin, square, .. } = self;
        [sum, cos, sin, square].into_iter().for_each(|plane| plane.fill(0.0));
    }

    /// Adds frames in their order. The first frame of all is the pivot, of which there is nothing to add.
    pub(super) fn fold(&mut self, frames: &[Run]) {
        Arch::new().dispatch(Fold { sums: self, frames });
    }

    /// Replaces the sums by what they tell: the pivot by S0, `cos` and `sin` by S1 and S2, `square` by the residual and `sum`
    /// by the correlation. All are NaN where `bad` is not 0 or a frame was not finite.
    pub(super) fn solve(&mut self, bad: &[u8], solution: &Solution) {
        Arch::new().dispatch(Solve { sums: self, bad, solution });
    }

    /// What [`Self::fold`] and [`Self::solve`] make of these frames, the pivot before the others, whatever was in the sums.
    pub(super) fn fit(&mut self, pivot: &[f32], others: &[Run], solution: &Solution) {
        Arch::new().dispatch(Fit { sums: self, pivot, others, solution });
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
        let (fours, rest) = self.frames.as_chunks();
        fours.iter().for_each(|four: &[_; 4]| fold(self.sums, four));
        match rest {
            [a, b, c] => fold(self.sums, &[*a, *b, *c]),
            [a, b] => fold(self.sums, &[*a, *b]),
            [a] => fold(self.sums, &[*a]),
            _ => {}
        }
    }
}

/// Adds `N` frames, every sum being loaded and stored once for all of them.
#[inline(always)]
fn fold<const N: usize>(sums: &mut Sums, frames: &[Run; N]) {
    // Lengths that the compiler knows to be equal, so that no index is checked inside the loop.
    let n = sums.pivot.len();
    let (values, factors) = (frames.map(|f| &f.values[..n]), frames.map(|f| f.factors));
    let (pivot, sum, cos) = (&sums.pivot[..n], &mut sums.sum[..n], &mut sums.cos[..n]);
    let (sin, square) = (&mut sums.sin[..n], &mut sums.square[..n]);
    for x in 0..n {
        let mut pixel = Pixel { sum: sum[x], cos: cos[x], sin: sin[x], square: square[x] };
        for k in 0..N {
            pixel.add(values[k][x] - pivot[x], factors[k]);
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
    sums: &'s mut Sums<'a>,
    pivot: &'f [f32],
    others: &'f [Run<'f>],
    solution: &'f Solution,
}

impl WithSimd for Fit<'_, '_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        macro_rules! fused {
            ($($n:literal)*) => {
                match self.others.len() {
                    $($n => if let Ok(others) = self.others.try_into() {
                        fit::<$n>(self.sums, self.pivot, others, self.solution);
                    })*
                    _ => self.in_parts(simd),
                }
            };
        }
        fused!(2 3 4 5 6 7 8 9 10 11 12);
    }
}

impl Fit<'_, '_, '_> {
    /// For more frames than the registers are worth.
    #[inline(always)]
    fn in_parts<S: Simd>(self, simd: S) {
        self.sums.pivot.copy_from_slice(self.pivot);
        self.sums.clear();
        Fold { sums: self.sums, frames: self.others }.with_simd(simd);
        let bad = [0; super::TILE];
        Solve { sums: self.sums, bad: &bad, solution: self.solution }.with_simd(simd);
    }
}

/// All frames at once: the sums never leave the registers.
#[inline(always)]
fn fit<const N: usize>(maps: &mut Sums, pivot: &[f32], others: &[Run; N], solution: &Solution) {
    let n = pivot.len();
    let (values, factors) = (others.map(|f| &f.values[..n]), others.map(|f| f.factors));
    let (s0, s1, s2) = (&mut maps.pivot[..n], &mut maps.cos[..n], &mut maps.sin[..n]);
    let (residual, correlation) = (&mut maps.square[..n], &mut maps.sum[..n]);
    for x in 0..n {
        let mut pixel = Pixel::default();
        for k in 0..N {
            pixel.add(values[k][x] - pivot[x], factors[k]);
        }
        [s0[x], s1[x], s2[x], residual[x], correlation[x]] = pixel.solve(pivot[x], true, solution);
    }
}
