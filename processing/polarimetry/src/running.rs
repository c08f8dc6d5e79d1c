//! A reconstruction on its way: photographs are folded into sums as they come.

use crate::angles::aligned::{AngleErrors, alignment, correct_analyser_angles, correlated, fit_moved_back};
use crate::fit::merge::{Merge, clear_of_white};
use crate::fit::repeats::{compare_halves, pairs};
use crate::fit::sample::Sample;
use crate::fit::views::{View, brackets, views};
use crate::fit::weighted::WeightedFit;
use crate::reconstruct::{Asked, Photographed, check_light, divide_by_flat, noise_of, reported, solve_with};
use crate::report::disk::Disk;
use crate::report::errors::{Angles, systematic};
use crate::report::output::Writer;
use crate::smooth;
use crate::{
    Align, Alignment, Design, Fit, FrameNoise, NoiseSource, ObliqueReport, Options, RepeatsReport, Report, StokesMaps,
    check_memory,
};
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use nacre_frames::ASSUMED;
use nacre_frames::{Frame, LinearFrame, Linearizer, LoadedFrames};
use nacre_image::OutputFolder;
use nacre_image::registration::Registrar;
use rayon::prelude::*;
use std::time::Instant;

/// Registration keeps windows of every view, so longer series are not registered: memory stays bounded.
const REGISTERED: usize = 24;

/// A reconstruction that takes its photographs one by one, in order, as they arrive: the result is the same to the
/// byte as that of [`reconstruct`](crate::reconstruct).
pub struct Running {
    pub(crate) frames: LoadedFrames,
    pub(crate) linearizer: Linearizer,
    /// Numbers of the photographs that are merged into one view each.
    pub(crate) brackets: Vec<Vec<usize>>,
    pub(crate) views: Vec<View>,
    pub(crate) sums: Sums,
    /// A few pixels of every view.
    pub(crate) sample: Sample,
    /// Watches how the photographs lie against each other; a sensor that takes all angles at once needs none.
    registrar: Option<Registrar>,
    /// Brackets taken in.
    added: usize,
    read_and_fit_s: f64,
}

/// What is kept of the photographs.
pub(crate) enum Sums {
    /// All pixels of a view are alike.
    Alike(Fit),
    /// Exposures were merged, so that variances differ from pixel to pixel.
    Weighted(WeightedFit),
}

impl Sums {
    pub(crate) fn new(weighted: bool, width: usize, height: usize) -> Self {
        if weighted { Self::Weighted(WeightedFit::new(width, height)) } else { Self::Alike(Fit::new(width, height)) }
    }

    /// The same kind without its views.
    pub(crate) fn emptied(&self, width: usize, height: usize) -> Self {
        Self::new(matches!(self, Self::Weighted(_)), width, height)
    }

    pub(crate) fn width(&self) -> usize {
        match self {
            Self::Alike(fit) => fit.width(),
            Self::Weighted(fit) => fit.width(),
        }
    }

    /// Views added.
    pub(crate) fn views(&self) -> usize {
        match self {
            Self::Alike(fit) => fit.frames(),
            Self::Weighted(fit) => fit.frames(),
        }
    }

    pub(crate) fn thinned(&self, step: usize) -> Self {
        match self {
            Self::Alike(fit) => Self::Alike(fit.thinned(step)),
            Self::Weighted(fit) => Self::Weighted(fit.thinned(step)),
        }
    }

    pub(crate) fn solve(self, design: &Design) -> StokesMaps {
        match self {
            Self::Alike(fit) => fit.solve(design),
            Self::Weighted(fit) => fit.solve(),
        }
    }

    /// Folds in views at once, of which only one photograph each counts where pixels are alike. `row(v, k, y, values, bad)` yields
    /// a row of the `k`-th photograph of the `v`-th view.
    fn add_several(
        &mut self,
        views: &[(f64, &Merge)],
        row: impl Fn(usize, usize, usize, &mut [f32], &mut [u8]) + Sync,
    ) {
        match self {
            Self::Alike(fit) => {
                let angles: Vec<f64> = views.iter().map(|(angle, _)| *angle).collect();
                fit.add_several(&angles, |v, y, light, bad| row(v, 0, y, light, bad));
            }
            Self::Weighted(_) => {
                for (v, (angle, merge)) in views.iter().enumerate() {
                    self.add(*angle, merge, |k, y, light, bad| row(v, k, y, light, bad));
                }
            }
        }
    }

    /// Folds in one view. `row(k, y, values, bad)` yields a row of its `k`-th photograph.
    pub(crate) fn add(&mut self, angle: f64, merge: &Merge, row: impl Fn(usize, usize, &mut [f32], &mut [u8]) + Sync) {
        match self {
            Self::Alike(fit) => fit.add(angle, |y, light, bad| row(0, y, light, bad)),
            Self::Weighted(fit) => fit.add(angle, |y, light, variances, bad| {
                merge.row(|k, light, bad| row(k, y, light, bad), light, variances, bad);
            }),
        }
    }
}

impl Running {
    /// Begins with a set whose photographs are all there, or will be when they are asked for.
    ///
    /// # Errors
    /// `Input` when the set is of another kind or its angles cannot tell an orientation.
    pub fn new(frames: LoadedFrames) -> Result<Self> {
        let running = Self::open(frames)?;
        running.design()?;
        Ok(running)
    }

    /// Begins with the first photographs of a series that goes on ([`Self::push`]): those at the first analyser angle. Dark
    /// photographs must be there already.
    ///
    /// # Errors
    /// `Input` when the set is of another kind or needs more memory than there is.
    pub fn open(frames: LoadedFrames) -> Result<Self> {
        check_memory(&frames)?;
        let brackets = brackets(&frames.set.frames);
        let views = views(&frames, &brackets)?;
        let linearizer = Linearizer::new(&frames)?;
        let block = views.first().map_or(1, |v| v.block);
        let size = [frames.info.width / block, frames.info.height / block];
        let sums = Sums::new(brackets.iter().any(|b| b.len() > 1), size[0], size[1]);
        let registered = block == 1 && views.len() <= REGISTERED;
        let registrar = registered.then(|| Registrar::new(size[0], size[1]));
        let sample = Sample::new(size[0], size[1]);
        Ok(Self { frames, linearizer, brackets, views, sums, sample, registrar, added: 0, read_and_fit_s: 0.0 })
    }

    /// More photographs of the series: all those at its next analyser angle. They are taken in by [`Self::add`].
    ///
    /// # Errors
    /// `Input` when a dark photograph of theirs cannot be read.
    pub fn push(&mut self, photographs: Vec<Frame>) -> Result<()> {
        self.linearizer.learn(&self.frames, &photographs)?;
        let first = self.frames.set.frames.len();
        self.brackets.extend(brackets(&photographs).into_iter().map(|b| b.into_iter().map(|k| first + k).collect()));
        self.frames.set.frames.extend(photographs);
        self.views = views(&self.frames, &self.brackets)?;
        if self.views.len() > REGISTERED {
            self.registrar = None;
        }
        Ok(())
    }

    /// Photographs taken in so far.
    pub fn added(&self) -> usize {
        self.brackets[..self.added].iter().map(Vec::len).sum()
    }

    /// The set so far.
    pub fn frames(&self) -> &[Frame] {
        &self.frames.set.frames
    }

    fn design(&self) -> Result<Design> {
        Design::new(&self.views.iter().map(|v| v.angle).collect::<Vec<_>>())
    }

    /// Takes in the next photograph, or all exposures at the next angle, which must be there.
    ///
    /// # Errors
    /// `Input` when it cannot be read or there is none left.
    pub fn add(&mut self) -> Result<()> {
        let begun = Instant::now();
        let Self { frames, linearizer, brackets, views, sums, sample, registrar, added, .. } = self;
        let bracket = brackets.get(*added).map_or(&[][..], |b| b);
        let taken = Taken::new(frames, linearizer, bracket)?;
        fold((sums, sample, registrar), views, *added, &[taken]);
        self.added += 1;
        self.read_and_fit_s += begun.elapsed().as_secs_f64();
        Ok(())
    }

    /// Takes in the rest, two brackets at a time: both are decoded at once, then folded in together, so that the sums go through
    /// the memory half as often. The order is fixed, so the result does not depend on timing.
    pub(crate) fn add_all(&mut self, progress: &dyn Progress) -> Result<()> {
        let (begun, all) = (Instant::now(), self.brackets.len());
        progress.stage("reading and fitting", all as u64);
        let Self { frames, linearizer, brackets, views, sums, sample, registrar, added, .. } = self;
        while *added < all {
            progress.check()?;
            let first = *added;
            let take = |i: usize| Taken::new(frames, linearizer, &brackets[i]);
            let (a, b) = rayon::join(|| take(first), || (first + 1 < all).then(|| take(first + 1)));
            let taken = [Some(a), b].into_iter().flatten().collect::<Result<Vec<_>>>()?;
            fold((&mut *sums, &mut *sample, &mut *registrar), views, first, &taken);
            *added += taken.len();
            taken.iter().for_each(|_| progress.step());
        }
        self.read_and_fit_s += begun.elapsed().as_secs_f64();
        Ok(())
    }

    /// Solves and writes maps, pictures and report into `folder`.
    ///
    /// # Errors
    /// `Input` when photographs are missing or useless; `Output` when writing fails; `Cancelled`. Nothing is left behind.
    pub fn finish(mut self, folder: OutputFolder, options: &Options, progress: &dyn Progress) -> Result<Report> {
        let period = options.check(&self.frames)?;
        let model = options.model_for(&self.frames);
        if self.added != self.brackets.len() {
            let problem = format!("only {} of its {} photographs were taken", self.added(), self.frames().len());
            return Err(Error::file(&self.frames.path, problem, "take the rest first"));
        }
        let (begun, before) = (Instant::now(), self.read_and_fit_s);
        let alignment = self.align(options.align, progress)?;
        let angle_errors = correct_analyser_angles(&mut self, alignment.as_ref(), progress)?;
        self.read_and_fit_s = before + begun.elapsed().as_secs_f64();
        let (design, start) = (self.design()?, Instant::now());
        let Self { frames, linearizer, brackets, views, sums, sample, read_and_fit_s, .. } = self;
        linearizer.rest();
        let mut maps = sums.solve(&design);
        check_light(&frames, &maps, &linearizer)?;
        let shifts = alignment.as_ref().filter(|a| a.corrected).map(|a| a.shifts_px.as_slice());
        let taken = Photographed {
            frames: &frames,
            linearizer: &linearizer,
            brackets: &brackets,
            views: &views,
            sample: &sample,
            shifts,
        };
        let (noise, source) = noise_of(&taken, &mut maps, &design);
        let writer = Writer { folder: &folder, frames: &frames, options, model, progress };
        let corrected = angle_errors.as_ref().and_then(AngleErrors::corrected);
        let angles = corrected.map_or_else(|| Angles::of(&frames, &sample, &views), Angles::corrected);
        let (disk, asked) = (Disk::new(), Asked::by((options, model), &frames, &views, &angles));
        progress.stage("solving and writing maps", 5);
        let residual = std::mem::take(&mut maps.residual);
        // What no model changes is written while the model is chosen.
        let early = || if frames.set.flat.is_none() { writer.light(&maps) } else { Ok(()) };
        let (written, solved) = disk.beside(early, || solve_with(&maps, residual, &design, &noise, &asked));
        written?;
        let mut solved = solved;
        if frames.set.flat.is_some() {
            divide_by_flat(&frames, &linearizer, &mut maps)?;
            writer.light(&maps)?;
        }
        let repeats = compare_halves(&sample, &pairs(&frames, &views, sample.views()), &views, &noise);
        // From the pixels as measured: their σ is that of the polarization, too.
        let periods = period.map(|p| p.tell(&maps, &solved.map)).transpose()?;
        progress.check()?;
        if options.smooth_maps {
            let shared = shifts.map_or(1.0, |shifts| correlated(shifts, [frames.info.width, frames.info.height]));
            solved.map = smooth(&solved.map, options.smooth, shared, progress)?;
        }
        let mut report = reported(&frames, (options, model), &design, (&noise, source), &maps, &solved);
        report.analyser_errors_deg = corrected.map(|m| m.errors.iter().map(|e| e.to_degrees()).collect());
        report.warnings.extend(angle_errors.iter().filter_map(|errors| errors.warning(&frames, &brackets, &views)));
        report.brackets = brackets.iter().filter(|b| b.len() > 1).count();
        report.with(systematic(&sample, &views, &noise, solved.choice.as_ref(), alignment.as_ref(), &angles));
        let apart_px = alignment.as_ref().map_or(0.0, Alignment::left_px);
        report.warnings.extend(alignment.iter().filter_map(Alignment::warning));
        report.registration = alignment;
        report.warnings.extend(repeats.iter().filter_map(RepeatsReport::warning));
        report.warnings.extend(report.oblique.iter().filter_map(ObliqueReport::warning).collect::<Vec<_>>());
        report.repeats = repeats;
        let solve_s = start.elapsed().as_secs_f64();
        if let Some((found, said, warnings)) = periods {
            writer.periods(&found, &said.method)?;
            report.warnings.extend(warnings);
            report.period = Some(said);
        }
        // The report has these terms one by one.
        solved.tell_systematic(model, apart_px);
        writer.maps(maps, &solved.map, &disk)?;
        report.took(read_and_fit_s, solve_s, start.elapsed().as_secs_f64());
        folder.write_json("report.json", &report)?;
        progress.check()?;
        folder.commit()?;
        Ok(report)
    }

    /// How the views lie against each other; the fit is made anew with views moved back where that is worth it.
    fn align(&mut self, align: Align, progress: &dyn Progress) -> Result<Option<Alignment>> {
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
    pub(crate) fn fit_anew(&mut self, progress: &dyn Progress) -> Result<()> {
        let [width, height] = [self.frames.info.width, self.frames.info.height];
        // The old sums, which are most of the memory, go before there are new ones.
        self.sums = self.sums.emptied(1, 1);
        self.sums = self.sums.emptied(width, height);
        (self.sample, self.added) = (self.sample.emptied(), 0);
        self.add_all(progress)
    }

    /// Noise of the maps so far.
    pub(crate) fn noise(&self, maps: &mut StokesMaps, design: &Design) -> (Vec<FrameNoise>, NoiseSource) {
        let views = &self.views[..self.sums.views()];
        let Self { frames, linearizer, brackets, sample, .. } = self;
        noise_of(&Photographed { frames, linearizer, brackets, views, sample, shifts: None }, maps, design)
    }
}

/// The decoded photographs of a bracket, and how they are merged.
struct Taken<'a> {
    photographs: Vec<LinearFrame<'a>>,
    merge: Merge,
}

impl<'a> Taken<'a> {
    fn new(frames: &LoadedFrames, linearizer: &'a Linearizer, bracket: &[usize]) -> Result<Self> {
        let photographs = read(frames, linearizer, bracket)?;
        Ok(Self { photographs, merge: Merge::new(noise_of_bracket(frames, linearizer, bracket)) })
    }
}

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

/// Adds brackets from number `first` on, each of which is one view, or four of a polarization sensor.
fn fold(
    (sums, sample, registrar): (&mut Sums, &mut Sample, &mut Option<Registrar>),
    views: &[View],
    first: usize,
    taken: &[Taken],
) {
    let of = |view: &View| view.bracket.checked_sub(first).and_then(|i| taken.get(i));
    let seen: Vec<(&View, &Taken)> = views.iter().filter_map(|v| Some((v, of(v)?))).collect();
    let angles: Vec<(f64, &Merge)> = seen.iter().map(|(view, taken)| (view.angle, &taken.merge)).collect();
    let row = |v: usize, k: usize, row: usize, light: &mut [f32], bad: &mut [u8]| {
        let (View { position: [x, y], block, .. }, taken) = seen[v];
        taken.photographs[k].strided(row * block + y, *x, *block, light, bad);
    };
    sums.add_several(&angles, row);
    for (v, (_, taken)) in seen.iter().enumerate() {
        sampled(sample, taken.photographs.len(), &taken.merge, |k, y, light, bad| row(v, k, y, light, bad));
    }
    let Some(registrar) = registrar else { return };
    for Taken { photographs, merge } in taken {
        match photographs.as_slice() {
            [one] => registrar.add(|y, left, light, bad| one.strided(y, left, 1, light, bad)),
            several => registrar.add(|y, left, light, bad| {
                let mut variances = vec![0.0; light.len()];
                merge.row(|k, light, bad| several[k].strided(y, left, 1, light, bad), light, &mut variances, bad);
            }),
        }
    }
}

/// Takes a view into the sample. `row(k, y, values, bad)` yields a row of its `k`-th photograph.
pub(crate) fn sampled(
    sample: &mut Sample,
    photographs: usize,
    merge: &Merge,
    row: impl Fn(usize, usize, &mut [f32], &mut [u8]) + Sync,
) {
    sample.add(|y, light, bad| match photographs {
        1 => row(0, y, light, bad),
        _ => merge.row(|k, light, bad| row(k, y, light, bad), light, &mut vec![0.0; light.len()], bad),
    });
}
