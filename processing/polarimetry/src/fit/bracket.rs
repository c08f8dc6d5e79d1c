//! Photographs of one bracket: several exposures of one view.

use crate::FrameNoise;
use crate::fit::demosaic::{Demosaic, FullSize};
use crate::fit::merge::clear_of_white;
use crate::fit::views::Photograph;
use nacre_base::{Error, Result};
use nacre_frames::{ASSUMED, Linearizer, LoadedFrames};
use rayon::prelude::*;

/// Decodes the photographs of a bracket. If there are several, all but the shortest exposure keep a margin to white.
pub(crate) fn read<'a>(
    frames: &LoadedFrames,
    linearizer: &'a Linearizer,
    bracket: &[usize],
    demosaic: Demosaic,
) -> Result<Vec<Photograph<'a>>> {
    if bracket.is_empty() {
        return Err(Error::file(&frames.path, "has no photograph left", "report this"));
    }
    let margins = clear_of_white(frames, linearizer, bracket);
    let one = |(k, margin): (&usize, f64)| {
        let decoded = linearizer.frame(frames, &frames.set.frames[*k])?;
        let frame = if margin > 0.0 { decoded.below_white(margin) } else { decoded };
        let size = [frames.info.width, frames.info.height];
        let full = (demosaic != Demosaic::None).then(|| FullSize::new(&frame, size, demosaic));
        Ok(Photograph { frame, full })
    };
    bracket.par_iter().zip(margins).map(one).collect()
}

/// Noise of the photographs of a bracket: that of the camera, or of a modest default. Averaged sensor pixels have
/// correspondingly less.
pub(crate) fn noise_of_bracket(frames: &LoadedFrames, linearizer: &Linearizer, bracket: &[usize]) -> Vec<FrameNoise> {
    let camera = frames.set.noise.unwrap_or(ASSUMED);
    // The steepest part of the transfer curve, so that quantisation is never underestimated.
    let step = linearizer.step() * frames.set.transfer.slope(1.0);
    let averaged = frames.set.filters().map_or(1, |f| f.pixels(0, frames.set.channel).len()) as f64;
    let of = |k: &usize| {
        let frame = &frames.set.frames[*k];
        camera.frame(frame.gain.unwrap_or(1.0), frame.scale(), step).scaled(1.0 / averaged)
    };
    bracket.iter().map(of).collect()
}
