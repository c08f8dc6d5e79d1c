//! Photographs of one bracket: exposures of one view.

use crate::FrameNoise;
use crate::fit::merge::clear_of_white;
use nacre_base::{Error, Result};
use nacre_frames::{ASSUMED, LinearFrame, Linearizer, LoadedFrames};
use rayon::prelude::*;

/// Decodes the photographs of a bracket. All but the shortest exposure keep a distance to white, if there are several.
pub(crate) fn read<'a>(
    frames: &LoadedFrames,
    linearizer: &'a Linearizer,
    bracket: &[usize],
) -> Result<Vec<LinearFrame<'a>>> {
    if bracket.is_empty() {
        return Err(Error::file(&frames.path, "has no photograph left", "report this"));
    }
    let margins = clear_of_white(frames, linearizer, bracket);
    let one = |(k, margin): (&usize, f64)| {
        let decoded = linearizer.frame(frames, &frames.set.frames[*k])?;
        Ok(if margin > 0.0 { decoded.below_white(margin) } else { decoded })
    };
    bracket.par_iter().zip(margins).map(one).collect()
}

/// Noise of the photographs of a bracket: the camera's, or that of a modest one.
pub(crate) fn noise_of_bracket(frames: &LoadedFrames, linearizer: &Linearizer, bracket: &[usize]) -> Vec<FrameNoise> {
    let camera = frames.set.noise.unwrap_or(ASSUMED);
    // The steepest part of the transfer curve, so that quantisation is never taken too small.
    let step = linearizer.step() * frames.set.transfer.slope(1.0);
    let frame = |k: &usize| &frames.set.frames[*k];
    bracket.iter().map(|k| camera.frame(frame(k).gain.unwrap_or(1.0), frame(k).scale(), step)).collect()
}
