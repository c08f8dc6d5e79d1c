//! Corrections for a wedged analyser and an inexact stage: shifts between photographs, and analyser-angle errors.

use crate::FrameNoise;
use crate::angles::angle_error::Misses;
use crate::fit::views::View;
use nacre_frames::LoadedFrames;
use nacre_image::registration::{Alignment, Registrar, Resampler};

/// Which shifts the photographs have; `None` for sensors that take all angles at once.
pub(crate) fn alignment(registrar: Option<&Registrar>, angles: &[f64]) -> Option<Alignment> {
    Some(registrar?.polarized(angles).into())
}

/// Errors beyond this in degrees are outside the reach of the linearised fit, which finds their presence but not their size.
const FINDABLE_DEG: f64 = 15.0;

/// Analyser-angle errors that the residuals show.
pub(crate) enum AngleErrors {
    /// The fit was made anew with corrected angles.
    Corrected(Misses),
    /// The stated angles were kept.
    Kept(Misses),
}

impl AngleErrors {
    /// The errors, where angles were corrected.
    pub(crate) fn corrected(&self) -> Option<&Misses> {
        match self {
            Self::Corrected(errors) => Some(errors),
            Self::Kept(_) => None,
        }
    }

    /// The largest error that was not corrected, and what to do.
    pub(crate) fn warning(&self, frames: &LoadedFrames, brackets: &[Vec<usize>], views: &[View]) -> Option<String> {
        let Self::Kept(Misses { errors, left }) = self else { return None };
        let (k, largest) = errors.iter().enumerate().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
        let frame = brackets.get(views.get(k)?.bracket)?.first()?;
        let file = frames.set.frames.get(*frame)?.file.display();
        let rms = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt().to_degrees();
        if rms >= FINDABLE_DEG {
            return Some(format!(
                "the residuals show a pattern that analyser-angle errors below {FINDABLE_DEG}° do not explain; the stated angles were kept. Check them, \
                 and whether the light changed between photographs"
            ));
        }
        let [left, largest] = [*left, *largest].map(f64::to_degrees);
        Some(format!(
            "the residuals show a pattern as of analyser-angle errors of {rms:.2}° ± {left:.2}° (root mean square), the largest of {largest:+.2}° at \
             {file}, or of light that changed between photographs; the stated angles were kept. If the analyser can be that inexact, state \
             angle_sigma_deg in frames.json, and the angles are corrected"
        ))
    }
}

/// What resampling leaves of the noise that a camera is said to have.
pub(crate) fn smoothed_noise(noise: &mut [FrameNoise], shifts: &[[f64; 2]], [width, height]: [usize; 2]) {
    for (noise, shift) in noise.iter_mut().zip(shifts) {
        *noise = noise.scaled(Resampler::new(*shift, width, height).noise_factor());
    }
}

/// How much larger the variance of a mean over many pixels is than the resampled pixels' own noise says, since they share it.
pub(crate) fn correlated(shifts: &[[f64; 2]], [width, height]: [usize; 2]) -> f64 {
    let left = |shift: &[f64; 2]| Resampler::new(*shift, width, height).noise_factor();
    shifts.len().max(1) as f64 / shifts.iter().map(left).sum::<f64>().max(f64::MIN_POSITIVE)
}
