//! The streaming fit: every frame is added to a few sums per pixel and discarded.
//!
//! The fit is memory-bound, so its time is proportional to the transferred bytes. With two frames at a time these are
//! 44 per pixel and pair (2·4 for the frames, 4 for the pivot, 2·16 for the sums). With all N frames in memory they are
//! 4 N + 20 (frames in, five maps out), since the sums of a pixel never leave the caches. Measurements:
//! docs/validation/speed.md.

pub(crate) mod accumulator;
pub(crate) mod bracket;
pub(crate) mod demosaic;
pub(crate) mod design;
pub(crate) mod flat;
mod kernel;
pub(crate) mod merge;
pub(crate) mod noise;
mod stack;
#[cfg(test)]
mod tests;
pub(crate) mod views;
pub(crate) mod weighted;

pub use stack::fit_stack;

use crate::Design;
use kernel::{Run, Solution, Sums};
use rayon::prelude::*;

/// Pixels per tile: with many frames their sums stay in the first- or second-level cache.
const TILE: usize = 2048;

/// Sums per pixel from which the fit can be solved at any time: 5 floats and a flag, for any number of frames.
///
/// Values are relative to the first frame (the pivot), so that f32 sums keep the precision of a modulation that is
/// small against the mean.
pub struct Fit {
    width: usize,
    frames: usize,
    pivot: Vec<f32>,
    sum: Vec<f32>,
    cos: Vec<f32>,
    sin: Vec<f32>,
    square: Vec<f32>,
    bad: Vec<u8>,
}

/// Solution per pixel. Pixels that were unusable (saturated) in any frame are NaN in all maps.
#[derive(Default)]
pub struct StokesMaps {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// S0, in linear input units.
    pub s0: Vec<f32>,
    /// S1.
    pub s1: Vec<f32>,
    /// S2.
    pub s2: Vec<f32>,
    /// Residual sum of squares of the fit; with `covariance`, each square is divided by its variance (χ²).
    pub residual: Vec<f32>,
    /// Normalised correlation between fit and measured intensities (2018 paper, section 7.3), 0 to 1.
    pub correlation: Vec<f32>,
    /// Covariances AA, AC, AS, CC, CS and SS of (A, C, S) = (S0, S1, S2)/2, if variances differ from pixel to pixel
    /// because exposures were merged. Otherwise empty, and the noise of the frames determines them.
    pub covariance: Vec<[f32; 6]>,
}

impl Fit {
    /// An empty fit for images of `width` × `height` pixels.
    pub fn new(width: usize, height: usize) -> Self {
        let plane = || vec![0.0; width * height];
        Self {
            width,
            frames: 0,
            pivot: plane(),
            sum: plane(),
            cos: plane(),
            sin: plane(),
            square: plane(),
            bad: vec![0; width * height],
        }
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// The fit of every `step`-th pixel of every `step`-th row.
    pub fn thinned(&self, step: usize) -> Self {
        fn thin<T: Copy>(plane: &[T], width: usize, step: usize) -> Vec<T> {
            plane.chunks(width.max(1)).step_by(step).flat_map(|row| row.iter().step_by(step).copied()).collect()
        }
        let plane = |plane: &[f32]| thin(plane, self.width, step);
        Self {
            width: self.width.div_ceil(step),
            frames: self.frames,
            pivot: plane(&self.pivot),
            sum: plane(&self.sum),
            cos: plane(&self.cos),
            sin: plane(&self.sin),
            square: plane(&self.square),
            bad: thin(&self.bad, self.width, step),
        }
    }

    /// Number of frames added.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Adds a frame taken at analyser angle `psi` (rad). `row(y, values, bad)` fills in one row of linear values and
    /// may set `bad[x] = 1` for unusable values; it is called from several threads.
    pub fn add(&mut self, psi: f64, row: impl Fn(usize, &mut [f32], &mut [u8]) + Sync) {
        self.add_several(&[psi], |_, y, values, bad| row(y, values, bad));
    }

    /// Adds frames taken at these analyser angles (rad). The result is bit-identical to adding them one by one, but the
    /// sums are read and written only once. `row(k, y, values, bad)` is that of [`Self::add`] for the `k`-th frame.
    pub fn add_several(&mut self, psi: &[f64], row: impl Fn(usize, usize, &mut [f32], &mut [u8]) + Sync) {
        let (width, first) = (self.width.max(1), usize::from(self.frames == 0));
        let factors: Vec<[f32; 2]> = psi.iter().map(|psi| factors(*psi)).collect();
        let Some(added) = factors.get(first..) else { return };
        self.rows(width).enumerate().for_each_init(
            || vec![0.0_f32; width * added.len()],
            |buffer, (y, (mut sums, bad))| {
                if first == 1 {
                    // Newly allocated memory is faster when it is written before it is read.
                    sums.clear();
                    bad.fill(0);
                    row(0, y, sums.pivot, bad);
                }
                let mut runs = Vec::with_capacity(added.len());
                for ((k, values), factors) in buffer.chunks_mut(width).enumerate().zip(added) {
                    let values = &mut values[..sums.pivot.len()];
                    row(first + k, y, values, bad);
                    runs.push(Run { values, factors: *factors });
                }
                sums.fold(&runs);
            },
        );
        self.frames += psi.len();
    }

    /// The sums and flags of `length` pixels at a time.
    fn rows(&mut self, length: usize) -> impl IndexedParallelIterator<Item = (Sums<'_>, &mut [u8])> {
        let Self { pivot, sum, cos, sin, square, bad, .. } = self;
        let two = |a, b| <[f32]>::par_chunks_mut(a, length).zip(<[f32]>::par_chunks_mut(b, length));
        let sums = two(pivot, sum).zip(two(cos, sin)).zip(square.par_chunks_mut(length));
        let sums = sums.map(|(((pivot, sum), (cos, sin)), square)| Sums { pivot, sum, cos, sin, square });
        sums.zip(bad.par_chunks_mut(length))
    }

    /// Solves every pixel. `design` must contain the angles in the order of [`Fit::add`]; the results reuse the memory
    /// of the sums.
    pub fn solve(mut self, design: &Design) -> StokesMaps {
        debug_assert_eq!(design.frames(), self.frames);
        let solution = Solution::new(design);
        self.rows(TILE).for_each(|(mut sums, bad)| sums.solve(bad, &solution));
        let (width, height) = (self.width, self.pivot.len() / self.width.max(1));
        let Self { pivot: s0, cos: s1, sin: s2, square: residual, sum: correlation, .. } = self;
        StokesMaps { width, height, s0, s1, s2, residual, correlation, covariance: vec![] }
    }
}

/// cos 2ψ and sin 2ψ.
fn factors(psi: f64) -> [f32; 2] {
    let (sin, cos) = (2.0 * psi).sin_cos();
    [cos as f32, sin as f32]
}
