//! The fit of frames that are all in memory: each is read once, and only the maps are written, bypassing the caches.

use super::kernel::{Run, Solution, Sums};
use super::{StokesMaps, TILE};
use crate::Design;
use rayon::prelude::*;

/// Fits all frames of `design`, given in its order. The result is bit-identical to adding them to a [`Fit`](super::Fit)
/// one by one. Pixels with a non-finite value in any frame are NaN in all maps. The content of `maps` is replaced, in
/// place if it has the length of the frames.
///
/// Frames should have equal lengths, a multiple of `width`; surplus values are ignored.
pub fn fit_stack(frames: &[&[f32]], width: usize, design: &Design, maps: &mut StokesMaps) {
    let length = frames.iter().map(|f| f.len()).min().unwrap_or(0);
    let Some((first, others)) = frames.split_first() else { return };
    let StokesMaps { s0, s1, s2, residual, correlation, covariance, .. } = maps;
    for plane in [&mut *s0, s1, s2, residual, correlation] {
        plane.resize(length, 0.0);
    }
    covariance.clear();
    let solution = Solution::new(design);
    let factors = |x: &nalgebra::Vector3<f64>| [x[1] as f32, x[2] as f32];
    let tiles = s0.par_chunks_mut(TILE).zip(s1.par_chunks_mut(TILE)).zip(s2.par_chunks_mut(TILE));
    let tiles = tiles.zip(residual.par_chunks_mut(TILE)).zip(correlation.par_chunks_mut(TILE)).enumerate();
    tiles.for_each_init(
        || Vec::with_capacity(others.len()),
        |runs, (i, ((((pivot, cos), sin), square), sum))| {
            let here = i * TILE..i * TILE + pivot.len();
            runs.clear();
            let rows = others.iter().zip(design.rows.iter().skip(1));
            runs.extend(rows.map(|(f, x)| Run { values: &f[here.start..], factors: factors(x) }));
            Sums { pivot, sum, cos, sin, square }.fit(&first[here], runs, &solution);
        },
    );
    (maps.width, maps.height) = (width, length / width.max(1));
}
