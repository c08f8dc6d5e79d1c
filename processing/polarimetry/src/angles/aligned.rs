//! Corrections for a wedged analyser and an inexact stage: shifts between photographs, and analyser-angle errors.

use crate::FrameNoise;
use crate::angles::angle_error::Misses;
use crate::fit::merge::Merge;
use crate::fit::sample::Sample;
use crate::fit::views::View;
use crate::running::{Running, Sums, noise_of_bracket, read, sampled};
use nacre_base::Result;
use nacre_base::progress::Progress;
use nacre_frames::LoadedFrames;
use nacre_image::registration::{Alignment, Registrar, Resampler};

/// Which shifts the photographs have; `None` for sensors that take all angles at once.
pub(crate) fn alignment(registrar: Option<&Registrar>, angles: &[f64]) -> Option<Alignment> {
    Some(registrar?.polarized(angles).into())
}

/// Reads all photographs again and folds them into new sums, each moved back by its view's shift.
pub(crate) fn fit_moved_back(
    running: &Running,
    shifts: &[[f64; 2]],
    progress: &dyn Progress,
) -> Result<(Sums, Sample)> {
    let Running { frames, linearizer, brackets, views, .. } = running;
    let (width, height) = (frames.info.width, frames.info.height);
    progress.stage("moving photographs back", views.len() as u64);
    let mut sums = running.sums.emptied(width, height);
    let mut sample = running.sample.emptied();
    for (view, shift) in views.iter().zip(shifts) {
        progress.check()?;
        let bracket = &brackets[view.bracket];
        let photographs = read(frames, linearizer, bracket)?;
        let back = Resampler::new(*shift, width, height);
        let merge = Merge::new(noise_of_bracket(frames, linearizer, bracket)).scaled(back.noise_factor());
        let row = |k: usize, y: usize, values: &mut [f32], bad: &mut [u8]| {
            back.row(y, |y, v, b| photographs[k].row(y, v, b), values, bad);
        };
        sums.add(view.angle, &merge, row);
        sampled(&mut sample, photographs.len(), &merge, row);
        progress.step();
    }
    Ok((sums, sample))
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

/// Estimates analyser-angle errors from the residuals. They are corrected, and the photographs fitted anew, where a capture session turned the
/// analyser or where `angle_sigma_deg` states that angles may be wrong: elsewhere other causes, such as a drifting lamp, are as likely.
pub(crate) fn correct_analyser_angles(
    running: &mut Running,
    alignment: Option<&Alignment>,
    progress: &dyn Progress,
) -> Result<Option<AngleErrors>> {
    // Edges of photographs that are shifted against each other look like wrong angles.
    if alignment.is_some_and(Alignment::is_left) {
        return Ok(None);
    }
    let stated = running.frames.set.angle_sigma_deg.map(f64::to_radians);
    let Some(errors) = running.sample.misses(&running.views, stated) else { return Ok(None) };
    if stated.is_none() && !running.frames.from_session {
        return Ok(Some(AngleErrors::Kept(errors)));
    }
    running.views.iter_mut().zip(&errors.errors).for_each(|(view, error)| view.angle += error);
    match alignment.filter(|a| a.corrected) {
        Some(moved) => (running.sums, running.sample) = fit_moved_back(running, &moved.shifts_px, progress)?,
        None => running.fit_anew(progress)?,
    }
    Ok(Some(AngleErrors::Corrected(errors)))
}

/// What resampling leaves of the noise that a camera is said to have.
pub(crate) fn smoothed_noise(noise: &mut [FrameNoise], shifts: &[[f64; 2]], [width, height]: [usize; 2]) {
    for (noise, shift) in noise.iter_mut().zip(shifts) {
        let factor = Resampler::new(*shift, width, height).noise_factor();
        (noise.shot, noise.floor) = (noise.shot * factor, noise.floor * factor);
    }
}

/// How much larger the variance of a mean over many pixels is than the resampled pixels' own noise says, since they share it.
pub(crate) fn correlated(shifts: &[[f64; 2]], [width, height]: [usize; 2]) -> f64 {
    let left = |shift: &[f64; 2]| Resampler::new(*shift, width, height).noise_factor();
    shifts.len().max(1) as f64 / shifts.iter().map(left).sum::<f64>().max(f64::MIN_POSITIVE)
}
