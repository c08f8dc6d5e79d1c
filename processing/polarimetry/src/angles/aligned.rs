//! Corrections for a wedged analyser and an inexact stage: shifts between photographs, and analyser-angle errors.

use crate::FrameNoise;
use crate::angles::angle_error::AngleErrorEstimate;
use crate::fit::views::View;
use nacre_frames::LoadedFrames;
use nacre_image::registration::{Alignment, Registrar, Resampler};

/// Alignment of the photographs by their shifts; `None` for sensors that take all angles at once.
pub(crate) fn alignment(registrar: Option<&Registrar>, angles: &[f64]) -> Option<Alignment> {
    Some(registrar?.polarized(angles).into())
}

/// Largest error in degrees within the range of the linearised fit. It detects larger errors, but does not determine
/// their size.
const FINDABLE_DEG: f64 = 15.0;

/// Analyser-angle errors estimated from the residuals.
pub(crate) enum AngleErrors {
    /// The fit was repeated with corrected angles.
    Corrected(AngleErrorEstimate),
    /// The stated angles were kept.
    Kept(AngleErrorEstimate),
}

impl AngleErrors {
    /// The errors, if angles were corrected.
    pub(crate) fn corrected(&self) -> Option<&AngleErrorEstimate> {
        match self {
            Self::Corrected(errors) => Some(errors),
            Self::Kept(_) => None,
        }
    }

    /// Warnings about changes of the light between photographs, and about the largest uncorrected error, with remedies.
    pub(crate) fn warnings(&self, frames: &LoadedFrames, brackets: &[Vec<usize>], views: &[View]) -> Vec<String> {
        let largest = |values: &[f64]| {
            let (k, largest) = values.iter().enumerate().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
            let frame = brackets.get(views.get(k)?.bracket)?.first()?;
            Some((*largest, frames.set.frames.get(*frame)?.file.display().to_string()))
        };
        [self.drift(largest), self.kept(largest)].into_iter().flatten().collect()
    }

    fn drift(&self, largest: impl Fn(&[f64]) -> Option<(f64, String)>) -> Option<String> {
        let (Self::Corrected(found) | Self::Kept(found)) = self;
        let rms = found.drift()?;
        let (most, file) = largest(&found.light_changes)?;
        Some(format!(
            "the light changed between photographs by {:.2} ± {:.2} % (root mean square), most at {file} ({:+.2} %): a lamp that drifts, or exposure times \
             that differ. Polarization is off by about half of that. Let the lamp warm up, or state each frame's exposure_s in proportion to its light",
            100.0 * rms,
            100.0 * found.light_sigma,
            100.0 * most
        ))
    }

    fn kept(&self, largest: impl Fn(&[f64]) -> Option<(f64, String)>) -> Option<String> {
        let Self::Kept(found) = self else { return None };
        let AngleErrorEstimate { errors, sigma, .. } = found;
        if !found.is_worth_correcting() {
            return None;
        }
        let (largest, file) = largest(errors)?;
        let rms = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt().to_degrees();
        if rms >= FINDABLE_DEG {
            return Some(format!(
                "the residuals show a pattern that analyser-angle errors below {FINDABLE_DEG}° do not explain; the stated angles were kept. Check them, \
                 and whether the light changed between photographs"
            ));
        }
        let [sigma, largest] = [*sigma, largest].map(f64::to_degrees);
        Some(format!(
            "the residuals show a pattern as of analyser-angle errors of {rms:.2}° ± {sigma:.2}° (root mean square), the largest of {largest:+.2}° at \
             {file}, or of light that changed between photographs; the stated angles were kept. If the analyser can be that inexact, state \
             angle_sigma_deg in frames.json, and the angles are corrected"
        ))
    }
}

/// Reduces the stated camera noise by the smoothing of the resampling.
pub(crate) fn smoothed_noise(noise: &mut [FrameNoise], shifts: &[[f64; 2]], [width, height]: [usize; 2]) {
    for (noise, shift) in noise.iter_mut().zip(shifts) {
        *noise = noise.scaled(Resampler::new(*shift, width, height).noise_factor());
    }
}

/// Ratio of the variance of a mean over many pixels to the variance expected from the resampled pixels' noise, which is
/// correlated between neighbours.
pub(crate) fn correlated(shifts: &[[f64; 2]], [width, height]: [usize; 2]) -> f64 {
    let sigma = |shift: &[f64; 2]| Resampler::new(*shift, width, height).noise_factor();
    shifts.len().max(1) as f64 / shifts.iter().map(sigma).sum::<f64>().max(f64::MIN_POSITIVE)
}
