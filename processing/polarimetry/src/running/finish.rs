//! The final stages of a reconstruction: registration, angle correction, intensities, noise, orientations, periods,
//! smoothing, report, output.

use super::Running;
use super::light::{Photographed, check_light, divide_by_flat, noise_of, restore_contrast};
use super::moved::correct_analyser_angles;
use crate::angles::aligned::{AngleErrors, correlated};
use crate::angles::repeats::{compare_halves, pairs};
use crate::angles::sample::Sample;
use crate::angles::{duplicates, layout};
use crate::film::camera_position::CameraPosition;
use crate::film::curve::Source;
use crate::fit::demosaic::Demosaic;
use crate::fit::flat::Flat;
use crate::fit::views::View;
use crate::orientation::polarizers::PolarizerPositions;
use crate::report::disk::Disk;
use crate::report::errors::{Angles, systematic};
use crate::report::json::Pixels;
use crate::report::output::{LightNoise, Writer};
use crate::solve::{Solved, ViewDisplacement, solve_with};
use crate::{
    Align, Alignment, Design, FrameNoise, Model, NoiseSource, ObliqueReport, Options, RepeatsReport, Report,
    SolveOptions, StokesMaps, smooth,
};
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use nacre_frames::{Linearizer, LoadedFrames};
use nacre_image::OutputFolder;
use std::time::Instant;

impl Running {
    /// Solves and writes maps and pictures into `folder`; the caller writes the report.
    ///
    /// # Errors
    /// `Input` if photographs are missing or unusable; `Output` if writing fails; `Cancelled`.
    pub fn finish(mut self, folder: &OutputFolder, options: &Options, progress: &dyn Progress) -> Result<Report> {
        let period = options.check(&self.frames)?;
        let model = options.model_for(&self.frames);
        let corrections = self.correct(options.align_for(&self.frames), progress)?;
        let start = Instant::now();
        let (fitted, mut maps) = self.solve_intensities(corrections)?;
        let writer = Writer { folder, frames: &fitted.frames, options, model, progress };
        let disk = Disk::new();
        progress.stage("solving and writing maps", 5);
        let (mut solved, flat) = fitted.solve_orientations(&mut maps, &writer, &disk)?;
        // Periods use the measured pixels, whose σ is also that of the polarization.
        let periods = period.map(|p| p.period_maps(&maps, &solved.map)).transpose()?;
        progress.check()?;
        if options.smooth_maps {
            solved.map = smooth(&solved.map, options.smooth, fitted.shared_noise(), progress)?;
        }
        let mut report = fitted.report((options, model), &maps, &solved);
        let solve_s = start.elapsed().as_secs_f64();
        if let Some((found, period_report, warnings)) = periods {
            writer.periods(&found, &period_report.method)?;
            report.warnings.extend(warnings);
            report.period = Some(period_report);
        }
        // The report lists these terms separately.
        solved.add_systematic(&maps, model, &fitted.view_displacement());
        writer.maps(maps, &solved.map, &fitted.light(&flat), &disk)?;
        report.took(fitted.read_and_fit_s, solve_s, start.elapsed().as_secs_f64());
        Ok(report)
    }

    /// Registers the photographs and corrects the analyser's angles.
    fn correct(&mut self, align: Align, progress: &dyn Progress) -> Result<Corrections> {
        if self.added != self.brackets.len() {
            let problem = format!("only {} of its {} photographs were taken", self.added(), self.frames().len());
            return Err(Error::file(&self.frames.path, problem, "take the rest first"));
        }
        let (begun, before) = (Instant::now(), self.read_and_fit_s);
        let alignment = self.align(align, progress)?;
        let angle_errors = correct_analyser_angles(self, alignment.as_ref(), progress)?;
        self.read_and_fit_s = before + begun.elapsed().as_secs_f64();
        Ok(Corrections { alignment, angle_errors })
    }

    /// Solves the Stokes parameters of all pixels, and the noise of every view.
    fn solve_intensities(self, corrections: Corrections) -> Result<(Fitted, StokesMaps)> {
        let design = self.design()?;
        let Self { frames, linearizer, brackets, views, demosaic, accumulator, sample, read_and_fit_s, .. } = self;
        let Corrections { alignment, angle_errors } = corrections;
        linearizer.rest();
        let mut maps = accumulator.solve(&design);
        check_light(&frames, &maps, &linearizer)?;
        let taken = Photographed {
            frames: &frames,
            linearizer: &linearizer,
            brackets: &brackets,
            views: &views,
            sample: &sample,
            demosaic,
            shifts: shifts(alignment.as_ref()),
        };
        let noise = noise_of(&taken, &mut maps, &design);
        let design = restore_contrast(&mut maps, design, frames.set.analyser_contrast());
        let corrected = angle_errors.as_ref().and_then(AngleErrors::corrected);
        let angles = corrected.map_or_else(|| Angles::of(&frames, &sample, &views), Angles::corrected);
        let fitted = Fitted {
            frames,
            linearizer,
            brackets,
            views,
            demosaic,
            sample,
            design,
            noise,
            angles,
            alignment,
            angle_errors,
            read_and_fit_s,
        };
        Ok((fitted, maps))
    }
}

/// Registration of the photographs and analyser-angle errors.
struct Corrections {
    alignment: Option<Alignment>,
    angle_errors: Option<AngleErrors>,
}

/// Corrected shifts in pixels.
fn shifts(alignment: Option<&Alignment>) -> Option<&[[f64; 2]]> {
    alignment.filter(|a| a.corrected).map(|a| a.shifts_px.as_slice())
}

/// A series with solved intensities.
struct Fitted {
    frames: LoadedFrames,
    linearizer: Linearizer,
    brackets: Vec<Vec<usize>>,
    views: Vec<View>,
    demosaic: Demosaic,
    sample: Sample,
    design: Design,
    /// Noise of every view, and its source.
    noise: (Vec<FrameNoise>, NoiseSource),
    angles: Angles,
    alignment: Option<Alignment>,
    angle_errors: Option<AngleErrors>,
    read_and_fit_s: f64,
}

impl Fitted {
    /// Solves the orientations of all pixels. Maps that do not depend on the model are written in parallel.
    fn solve_orientations(&self, maps: &mut StokesMaps, writer: &Writer, disk: &Disk) -> Result<(Solved, Flat)> {
        let solve_options = self.solve_options(writer.options, writer.model);
        let residual = std::mem::take(&mut maps.residual);
        let has_flat = self.frames.set.flat.is_some();
        let none = Flat::default();
        let early = || if has_flat { Ok(()) } else { writer.light(maps, &self.light(&none)) };
        let (written, solved) =
            disk.beside(early, || solve_with(maps, residual, &self.design, &self.noise.0, &solve_options));
        written?;
        if !has_flat {
            return Ok((solved, none));
        }
        let flat = divide_by_flat(&self.frames, &self.linearizer, maps)?;
        writer.light(maps, &self.light(&flat))?;
        Ok((solved, flat))
    }

    /// Noise of intensities that were divided by `flat`.
    fn light<'a>(&'a self, flat: &'a Flat) -> LightNoise<'a> {
        LightNoise { design: &self.design, frames: &self.noise.0, flat }
    }

    /// Options of the solution, with the camera position and the accuracy of the angles.
    fn solve_options(&self, options: &Options, model: Model) -> SolveOptions {
        let Self { frames, views, angles, .. } = self;
        let size = [frames.info.width, frames.info.height];
        let camera =
            frames.set.geometry.and_then(|g| CameraPosition::new(&g, size, views.first().map_or(1, |v| v.step)));
        let retarder = frames.set.calibration.as_ref().and_then(|c| c.retarder.as_ref());
        SolveOptions {
            offset: options.offset_for(frames).to_radians(),
            camera: camera.map(|camera| (camera, frames.set.material.unwrap_or_default())),
            oblique: options.oblique,
            angle_sigma: angles.sigma.unwrap_or(0.0),
            source: retarder.map_or(Source::IDEAL, Source::of),
            ..SolveOptions::of(model)
        }
    }

    /// Ratio of the variance of a mean over many pixels to that expected from their own noise, since resampled pixels
    /// are correlated.
    fn shared_noise(&self) -> f64 {
        let size = [self.frames.info.width, self.frames.info.height];
        shifts(self.alignment.as_ref()).map_or(1.0, |shifts| correlated(shifts, size))
    }

    /// Relative positions of the views of a pixel.
    fn view_displacement(&self) -> ViewDisplacement {
        let polarizers = PolarizerPositions::of(&self.views, &self.design, self.demosaic);
        ViewDisplacement { apart_px: self.alignment.as_ref().map_or(0.0, Alignment::left_px), polarizers }
    }

    /// The report, except for times and periods.
    fn report(&self, options: (&Options, Model), maps: &StokesMaps, solved: &Solved) -> Report {
        let Self { frames, linearizer, brackets, views, sample, design, alignment, angle_errors, angles, .. } = self;
        let (noise, source) = &self.noise;
        let pixels = Pixels::count(maps, &solved.map, solved.without_grating);
        let mut report = Report::new(frames, options, design, (noise, *source), pixels, solved);
        report.warnings.extend(frames.warnings.iter().cloned().chain(linearizer.clipping()));
        report.warnings.extend(layout::contradiction(frames, views, sample));
        report.warnings.extend(duplicates::contradiction(frames, brackets, views, sample));
        let corrected = angle_errors.as_ref().and_then(AngleErrors::corrected);
        report.analyser_errors_deg = corrected.map(|m| m.errors.iter().map(|e| e.to_degrees()).collect());
        report.warnings.extend(angle_errors.iter().flat_map(|errors| errors.warnings(frames, brackets, views)));
        report.brackets = brackets.iter().filter(|b| b.len() > 1).count();
        report.with(systematic(sample, views, noise, solved.choice.as_ref(), alignment.as_ref(), angles));
        report.with_offset(options.0);
        report.warnings.extend(alignment.iter().filter_map(Alignment::warning));
        report.registration.clone_from(alignment);
        let repeats = compare_halves(sample, &pairs(frames, views, sample.views()), views, noise);
        report.warnings.extend(repeats.iter().filter_map(RepeatsReport::warning));
        report.warnings.extend(report.oblique.iter().filter_map(ObliqueReport::warning).collect::<Vec<_>>());
        report.repeats = repeats;
        report
    }
}
