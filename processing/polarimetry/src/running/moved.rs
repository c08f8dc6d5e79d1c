//! Fits made anew: with photographs moved back onto each other, and at corrected angles.

use super::Running;
use crate::angles::aligned::{AngleErrors, alignment};
use crate::angles::sample::{Sample, sampled};
use crate::fit::bracket::{noise_of_bracket, read};
use crate::fit::demosaic::Demosaic;
use crate::fit::merge::Merge;
use crate::fit::sums::Sums;
use crate::{Align, Alignment};
use nacre_base::Result;
use nacre_base::progress::Progress;
use nacre_image::registration::Resampler;

impl Running {
    /// How the views lie against each other; the fit is made anew with views moved back where that is worth it.
    pub(super) fn align(&mut self, align: Align, progress: &dyn Progress) -> Result<Option<Alignment>> {
        let angles: Vec<f64> = self.views.iter().map(|v| v.angle).collect();
        let mut alignment = alignment(self.registrar.take().as_ref(), &angles);
        if let Some(found) = alignment.as_mut().filter(|_| align == Align::Off) {
            found.corrected = false;
        }
        if let Some(found) = alignment.as_ref().filter(|a| a.corrected) {
            (self.sums, self.sample) = fit_moved_back(self, &found.shifts_px, progress)?;
        }
        Ok(alignment)
    }

    /// Reads and fits all photographs anew, at the angles that its views have now.
    fn fit_anew(&mut self, progress: &dyn Progress) -> Result<()> {
        let [width, height] = [self.frames.info.width, self.frames.info.height];
        // The old sums, which are most of the memory, go before there are new ones.
        self.sums = self.sums.emptied(1, 1);
        self.sums = self.sums.emptied(width, height);
        (self.sample, self.added) = (self.sample.emptied(), 0);
        self.add_all(progress)
    }
}

/// Reads all photographs again and folds them into new sums, each moved back by its view's shift.
fn fit_moved_back(running: &Running, shifts: &[[f64; 2]], progress: &dyn Progress) -> Result<(Sums, Sample)> {
    let Running { frames, linearizer, brackets, views, .. } = running;
    let (width, height) = (frames.info.width, frames.info.height);
    progress.stage("moving photographs back", views.len() as u64);
    let mut sums = running.sums.emptied(width, height);
    let mut sample = running.sample.emptied();
    for (view, shift) in views.iter().zip(shifts) {
        progress.check()?;
        let bracket = &brackets[view.bracket];
        let photographs = read(frames, linearizer, bracket, Demosaic::None)?;
        let back = Resampler::new(*shift, width, height);
        let merge = Merge::new(noise_of_bracket(frames, linearizer, bracket)).scaled(back.noise_factor());
        let row = |k: usize, y: usize, values: &mut [f32], bad: &mut [u8]| {
            back.row(y, |y, v, b| photographs[k].row(view, y, v, b), values, bad);
        };
        sums.add(view.angle, &merge, row);
        sampled(&mut sample, photographs.len(), &merge, row);
        progress.step();
    }
    Ok((sums, sample))
}

/// Largest error of an angle that is corrected, in rad, where a session's stage turned the analyser: more is no error of a stage.
const STAGE_TOLERANCE: f64 = 5.0 * std::f64::consts::PI / 180.0;

/// The same in units of the stated `angle_sigma_deg`.
const STATED_TOLERANCE: f64 = 4.0;

/// Estimates analyser-angle errors from the residuals. They are corrected, and the photographs fitted anew, where a capture session turned the
/// analyser or where `angle_sigma_deg` states that angles may be wrong, up to the tolerance: elsewhere other causes, such as a drifting lamp, are as
/// likely.
pub(super) fn correct_analyser_angles(
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
    let tolerance = stated.map_or(STAGE_TOLERANCE, |sigma| STATED_TOLERANCE * sigma);
    let within = errors.errors.iter().all(|e| e.abs() <= tolerance);
    if !errors.is_worth_correcting() || !within || (stated.is_none() && !running.frames.from_session) {
        return Ok(Some(AngleErrors::Kept(errors)));
    }
    running.views.iter_mut().zip(&errors.errors).for_each(|(view, error)| view.angle += error);
    match alignment.filter(|a| a.corrected) {
        Some(moved) => (running.sums, running.sample) = fit_moved_back(running, &moved.shifts_px, progress)?,
        None => running.fit_anew(progress)?,
    }
    Ok(Some(AngleErrors::Corrected(errors)))
}
