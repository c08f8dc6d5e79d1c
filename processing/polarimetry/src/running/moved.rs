//! Repeated fits, with registered photographs and at corrected angles.

use super::Running;
use crate::angles::aligned::{AngleErrors, alignment};
use crate::angles::sample::{Sample, sampled};
use crate::fit::accumulator::Accumulator;
use crate::fit::bracket::{noise_of_bracket, read};
use crate::fit::demosaic::Demosaic;
use crate::fit::merge::Merge;
use crate::{Align, Alignment};
use nacre_base::Result;
use nacre_base::progress::Progress;
use nacre_image::registration::Resampler;

impl Running {
    /// Determines the shifts of the views; repeats the fit with registered views if that is worthwhile.
    pub(super) fn align(&mut self, align: Align, progress: &dyn Progress) -> Result<Option<Alignment>> {
        let angles: Vec<f64> = self.views.iter().map(|v| v.angle).collect();
        let mut alignment = alignment(self.registrar.take().as_ref(), &angles);
        if let Some(found) = alignment.as_mut().filter(|_| align == Align::Off) {
            found.corrected = false;
        }
        if let Some(found) = alignment.as_ref().filter(|a| a.corrected) {
            (self.accumulator, self.sample) = fit_moved_back(self, &found.shifts_px, progress)?;
        }
        Ok(alignment)
    }

    /// Reads and fits all photographs again, at the present angles of the views.
    fn fit_anew(&mut self, progress: &dyn Progress) -> Result<()> {
        let [width, height] = [self.frames.info.width, self.frames.info.height];
        // The old sums, most of the memory, are freed before new ones are allocated.
        self.accumulator = self.accumulator.emptied(1, 1);
        self.accumulator = self.accumulator.emptied(width, height);
        (self.sample, self.added) = (self.sample.emptied(), 0);
        self.add_all(progress)
    }
}

/// Reads all photographs again and adds them to new sums, with each view's shift corrected.
fn fit_moved_back(running: &Running, shifts: &[[f64; 2]], progress: &dyn Progress) -> Result<(Accumulator, Sample)> {
    let Running { frames, linearizer, brackets, views, .. } = running;
    let (width, height) = (frames.info.width, frames.info.height);
    progress.stage("moving photographs back", views.len() as u64);
    let mut accumulator = running.accumulator.emptied(width, height);
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
        accumulator.add(view.angle, &merge, row);
        sampled(&mut sample, photographs.len(), &merge, row);
        progress.step();
    }
    Ok((accumulator, sample))
}

/// Largest angle error in rad that is corrected if a session's stage rotated the analyser: larger ones are not stage
/// errors.
const STAGE_TOLERANCE: f64 = 5.0 * std::f64::consts::PI / 180.0;

/// Largest corrected angle error in units of the stated `angle_sigma_deg`.
const STATED_TOLERANCE: f64 = 4.0;

/// Estimates analyser-angle errors from the residuals. They are corrected, and the photographs fitted again, if a
/// capture session rotated the analyser or if `angle_sigma_deg` states that angles may be wrong, up to the tolerance.
/// Otherwise other causes, such as a drifting lamp, are as likely.
pub(super) fn correct_analyser_angles(
    running: &mut Running,
    alignment: Option<&Alignment>,
    progress: &dyn Progress,
) -> Result<Option<AngleErrors>> {
    // Edges of shifted photographs look like angle errors.
    if alignment.is_some_and(Alignment::is_left) {
        return Ok(None);
    }
    let stated = running.frames.set.angle_sigma_deg.map(f64::to_radians);
    let Some(errors) = running.sample.angle_errors(&running.views, stated) else { return Ok(None) };
    let tolerance = stated.map_or(STAGE_TOLERANCE, |sigma| STATED_TOLERANCE * sigma);
    let within = errors.errors.iter().all(|e| e.abs() <= tolerance);
    if !errors.is_worth_correcting() || !within || (stated.is_none() && !running.frames.from_session) {
        return Ok(Some(AngleErrors::Kept(errors)));
    }
    running.views.iter_mut().zip(&errors.errors).for_each(|(view, error)| view.angle += error);
    match alignment.filter(|a| a.corrected) {
        Some(moved) => (running.accumulator, running.sample) = fit_moved_back(running, &moved.shifts_px, progress)?,
        None => running.fit_anew(progress)?,
    }
    Ok(Some(AngleErrors::Corrected(errors)))
}
