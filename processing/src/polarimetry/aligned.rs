//! What a wedged analyser or a loose stage does, undone: photographs that lie beside each other, and angles that are not what they are said to be.

use super::FrameNoise;
use super::angle_error::Misses;
use super::merge::Merge;
use super::running::{Running, Sums, noise_of_bracket, read, sampled};
use super::sample::Sample;
use crate::Result;
use crate::image::registration::{Alignment, Registrar, Resampler};
use crate::progress::Progress;

/// Which shifts the photographs have; `None` for sensors that take all angles at once.
pub(super) fn alignment(registrar: Option<&Registrar>, angles: &[f64]) -> Option<Alignment> {
    Some(registrar?.polarized(angles).into())
}

/// Reads all photographs again and folds them into new sums, each moved back by its view's shift.
pub(super) fn fit_moved_back(
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

/// Finds by residuals where the analyser stood; where that is worth it, photographs are read and fitted anew with these angles.
pub(super) fn put_angles_right(
    running: &mut Running,
    alignment: Option<&Alignment>,
    progress: &dyn Progress,
) -> Result<Option<Misses>> {
    // Where photographs show edges beside each other, these look like wrong angles.
    if alignment.is_some_and(Alignment::is_left) {
        return Ok(None);
    }
    let stated = running.frames.set.angle_sigma_deg.map(f64::to_radians);
    let Some(misses) = running.sample.misses(&running.views, stated) else { return Ok(None) };
    running.views.iter_mut().zip(&misses.errors).for_each(|(view, error)| view.angle += error);
    match alignment.filter(|a| a.corrected) {
        Some(moved) => (running.sums, running.sample) = fit_moved_back(running, &moved.shifts_px, progress)?,
        None => running.fit_anew(progress)?,
    }
    Ok(Some(misses))
}

/// What resampling leaves of the noise that a camera is said to have.
pub(super) fn smoothed_noise(noise: &mut [FrameNoise], shifts: &[[f64; 2]], [width, height]: [usize; 2]) {
    for (noise, shift) in noise.iter_mut().zip(shifts) {
        let factor = Resampler::new(*shift, width, height).noise_factor();
        (noise.shot, noise.floor) = (noise.shot * factor, noise.floor * factor);
    }
}

/// How much larger the variance of a mean over many pixels is than the resampled pixels' own noise says, since they share it.
pub(super) fn correlated(shifts: &[[f64; 2]], [width, height]: [usize; 2]) -> f64 {
    let left = |shift: &[f64; 2]| Resampler::new(*shift, width, height).noise_factor();
    shifts.len().max(1) as f64 / shifts.iter().map(left).sum::<f64>().max(f64::MIN_POSITIVE)
}
