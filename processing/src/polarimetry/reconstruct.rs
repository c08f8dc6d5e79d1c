//! The whole job: a set of photographs to maps, pictures and a report in a new folder.

use super::aligned::{alignment, correlated, fit_moved_back, smoothed_noise};
use super::choose::{Choice, choose};
use super::cloud::cloud;
use super::locate::locate;
use super::noise::ASSUMED;
use super::output::Writer;
use super::report::{Pixels, Report, Seconds};
use super::{
    CircleCheck, Design, Fit, FrameNoise, MASK_SNR, Model, NoiseSource, OrientationMaps, PeriodMethod, Smoothing,
    StokesMaps, check_circle, estimate_noise, orient, smooth,
};
use crate::frames::{Kind, LinearFrame, Linearizer, LoadedFrames, load};
use crate::image::OutputFolder;
use crate::image::registration::Registrar;
use crate::progress::Progress;
use crate::{Error, Result};
use std::path::Path;
use std::time::Instant;

/// What the user may choose.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The model.
    pub model: Model,
    /// Added to every orientation, to fix the gauge (degrees).
    pub offset_deg: f64,
    /// How orientations are smoothed in pictures.
    pub smooth: Smoothing,
    /// Smooth the map itself as well.
    pub smooth_maps: bool,
    /// Makes a map of periods, too.
    pub period: Option<PeriodMethod>,
    /// Replace results that are already there.
    pub overwrite: bool,
}

/// Reconstructs the orientation map of `input` (a session folder or `frames.json` of kind polarization or
/// division_of_focal_plane) into the new folder `out`.
///
/// Memory: 6 floats per pixel and two decoded photographs, whatever the number of frames; 10 while the picture is smoothed.
///
/// # Errors
/// `Input` for anything about the photographs, before anything is written; `Output` when writing fails, after which
/// nothing is left behind; `Cancelled`.
pub fn reconstruct(input: &Path, out: &Path, options: &Options, progress: &dyn Progress) -> Result<Report> {
    let mut running = Running::new(load(input)?)?;
    options.check(&running.frames)?;
    let folder = OutputFolder::begin(out, options.overwrite)?;
    running.add_all(progress)?;
    running.finish(folder, options, progress)
}

impl Options {
    /// Refuses what makes no sense, before anything is done; returns how periods are told, with the photographs' wavelength.
    ///
    /// # Errors
    /// `Input`, for numbers that make no sense and for a wavelength that nothing says.
    pub fn check(&self, frames: &LoadedFrames) -> Result<Option<PeriodMethod>> {
        if !self.offset_deg.is_finite() {
            return Err(Error::input("offset", format!("{} is no angle", self.offset_deg), "give finite degrees"));
        }
        if self.smooth_maps && self.smooth == Smoothing::NONE {
            let problem = "the map is to be smoothed, but the smoothing is none";
            return Err(Error::input("smoothing", problem, "choose light, strong or a number of rounds"));
        }
        self.period.as_ref().map(|p| p.completed(frames.set.wavelength_nm)).transpose()
    }
}

/// Registration keeps windows of every photograph, so longer series are not registered: memory stays bounded.
const REGISTERED: usize = 24;

/// A reconstruction that takes its photographs one by one, in order, as they arrive: the result is the same to the
/// byte as that of [`reconstruct`].
pub struct Running {
    pub(super) frames: LoadedFrames,
    pub(super) linearizer: Linearizer,
    pub(super) views: Vec<View>,
    design: Design,
    pub(super) fit: Fit,
    /// Watches how the photographs lie against each other; a sensor that takes all angles at once needs none.
    registrar: Option<Registrar>,
    /// Photographs taken in.
    added: usize,
    read_and_fit_s: f64,
}

impl Running {
    /// Begins; the set's dark photograph must be there already.
    ///
    /// # Errors
    /// `Input` when the set is of another kind or its angles cannot tell an orientation.
    pub fn new(frames: LoadedFrames) -> Result<Self> {
        let views = views(&frames)?;
        let design = Design::new(&views.iter().map(|v| v.angle).collect::<Vec<_>>())?;
        let linearizer = Linearizer::new(&frames)?;
        let block = views.first().map_or(1, |v| v.block);
        let fit = Fit::new(frames.info.width / block, frames.info.height / block);
        let registered = block == 1 && frames.set.frames.len() <= REGISTERED;
        let registrar = registered.then(|| Registrar::new(frames.info.width, frames.info.height));
        Ok(Self { frames, linearizer, views, design, fit, registrar, added: 0, read_and_fit_s: 0.0 })
    }

    /// Photographs taken in so far; the next one to add is the set's with this number.
    pub fn added(&self) -> usize {
        self.added
    }

    /// Takes in the next photograph, which must be there.
    ///
    /// # Errors
    /// `Input` when it cannot be read or there is none left.
    pub fn add(&mut self) -> Result<()> {
        let begun = Instant::now();
        let photograph = read(&self.frames, &self.linearizer, self.added)?;
        fold(&mut self.fit, &mut self.registrar, &self.views, self.added, &photograph);
        self.added += 1;
        self.read_and_fit_s += begun.elapsed().as_secs_f64();
        Ok(())
    }

    /// Takes in the rest, two at a time: both are decoded at once, then added in order, so that the result does not
    /// depend on timing.
    fn add_all(&mut self, progress: &dyn Progress) -> Result<()> {
        let (begun, all) = (Instant::now(), self.frames.set.frames.len());
        progress.stage("reading and fitting", all as u64);
        let Self { frames, linearizer, views, fit, registrar, added, .. } = self;
        while *added < all {
            progress.check()?;
            let first = *added;
            let second = || (first + 1 < all).then(|| read(frames, linearizer, first + 1));
            let (a, b) = rayon::join(|| read(frames, linearizer, first), second);
            for photograph in [Some(a), b].into_iter().flatten() {
                fold(fit, registrar, views, *added, &photograph?);
                *added += 1;
                progress.step();
            }
        }
        self.read_and_fit_s += begun.elapsed().as_secs_f64();
        Ok(())
    }

    /// Solves and writes maps, pictures and report into `folder`.
    ///
    /// # Errors
    /// `Input` when photographs are missing or useless; `Output` when writing fails; `Cancelled`. Nothing is left behind.
    pub fn finish(self, folder: OutputFolder, options: &Options, progress: &dyn Progress) -> Result<Report> {
        let period = options.check(&self.frames)?;
        let Self { frames, linearizer, views, design, mut fit, registrar, added, read_and_fit_s } = self;
        if added != frames.set.frames.len() {
            let problem = format!("only {added} of its {} photographs were taken", frames.set.frames.len());
            return Err(Error::file(&frames.path, problem, "take the rest first"));
        }
        let start = Instant::now();
        let size = [frames.info.width, frames.info.height];
        let angles: Vec<f64> = views.iter().map(|v| v.angle).collect();
        let alignment = alignment(registrar.as_ref(), &angles);
        drop(registrar);
        let moved = alignment.as_ref().filter(|a| a.corrected).map(|a| a.shifts_px.as_slice());
        if let Some(shifts) = moved {
            fit = fit_moved_back(&frames, &linearizer, &views, shifts, size, progress)?;
        }
        let mut maps = fit.solve(&design);
        check_light(&frames, &maps, &linearizer)?;
        let (mut noise, source) = noise_of(&frames, &linearizer, &views, &maps, &design);
        if let Some(shifts) = moved.filter(|_| source != NoiseSource::Estimated) {
            smoothed_noise(&mut noise, shifts, size);
        }
        let shared = moved.map_or(1.0, |shifts| correlated(shifts, size));
        let Solved { mut map, circle, choice, points } =
            solve_model(&mut maps, &design, &noise, options.model, options.offset_deg.to_radians());
        divide_by_flat(&frames, &linearizer, &mut maps)?;
        // From the pixels as measured: their σ is that of the polarization, too.
        let periods = period.map(|p| p.tell(&maps, &map)).transpose()?;
        progress.check()?;
        if options.smooth_maps {
            map = smooth(&map, options.smooth, shared, progress)?;
        }
        let pixels = Pixels::count(&maps, &map);
        let solved = start.elapsed().as_secs_f64();

        let mut report = Report::new(
            &frames,
            options,
            &design,
            (&noise, source),
            pixels,
            circle,
            choice.as_ref().map(|c| (c, points)),
        );
        report.registration = alignment;
        let writer = Writer { folder: &folder, frames: &frames, options, progress };
        if let Some((found, said, warnings)) = periods {
            writer.periods(&found, &said.method)?;
            report.warnings.extend(warnings);
            report.period = Some(said);
        }
        writer.maps(maps, &map)?;
        let written = start.elapsed().as_secs_f64();
        report.seconds = Seconds {
            read_and_fit: read_and_fit_s,
            solve: solved,
            write: written - solved,
            total: read_and_fit_s + written,
        };
        folder.write("report.json", report.json().as_bytes())?;
        progress.check()?;
        folder.commit()?;
        Ok(report)
    }
}

/// Orientations under the chosen model.
pub(super) struct Solved {
    pub map: OrientationMaps,
    pub circle: Option<CircleCheck>,
    pub choice: Option<Choice>,
    /// Points that the models were compared on.
    pub points: usize,
}

/// Pixels that models are fitted to and compared on.
pub(crate) const CLOUD: usize = 100_000;

/// From intensities to orientations.
pub(super) fn solve_model(
    maps: &mut StokesMaps,
    design: &Design,
    noise: &[FrameNoise],
    model: Model,
    offset: f64,
) -> Solved {
    solve_on(maps, design, noise, model, offset, CLOUD)
}

/// Orientations alone, with models fitted to and compared on so many pixels: for charts.
pub(crate) fn orient_with(
    maps: &mut StokesMaps,
    design: &Design,
    noise: &[FrameNoise],
    model: Model,
    pixels: usize,
) -> OrientationMaps {
    solve_on(maps, design, noise, model, 0.0, pixels).map
}

fn solve_on(
    maps: &mut StokesMaps,
    design: &Design,
    noise: &[FrameNoise],
    model: Model,
    offset: f64,
    pixels: usize,
) -> Solved {
    let mut points = cloud(maps, design, noise, pixels);
    points.retain(|p| p.snr >= f64::from(MASK_SNR));
    let choice = choose(&points, model);
    let map = match &choice {
        Some(choice) => locate(maps, design, noise, &choice.candidates[choice.chosen], offset),
        None => orient(maps, design, noise, offset),
    };
    let circle = check_circle(maps, &map);
    Solved { map, circle, choice, points: points.len() }
}

fn read<'a>(frames: &LoadedFrames, linearizer: &'a Linearizer, i: usize) -> Result<LinearFrame<'a>> {
    let Some(frame) = frames.set.frames.get(i) else {
        return Err(Error::file(&frames.path, "has no photograph left", "report this"));
    };
    linearizer.read(&frames.file(&frame.file), frame.scale())
}

/// Adds photograph `i`, which is one view, or four of a polarization sensor.
fn fold(fit: &mut Fit, registrar: &mut Option<Registrar>, views: &[View], i: usize, frame: &LinearFrame) {
    let per_frame = views.first().map_or(1, |v| v.block * v.block);
    for view in &views[i * per_frame..(i + 1) * per_frame] {
        let ([x, y], block) = (view.position, view.block);
        fit.add(view.angle, |row, light, bad| frame.strided(row * block + y, x, block, light, bad));
    }
    if let Some(registrar) = registrar {
        registrar.add(|row, light, bad| frame.row(row, light, bad));
    }
}

/// One intensity image at one analyser angle: a whole photograph, or one position of its 2×2 blocks.
pub(super) struct View {
    pub(super) frame: usize,
    /// `(x, y)` inside the block and the block's size.
    pub(super) position: [usize; 2],
    pub(super) block: usize,
    pub(super) angle: f64,
}

pub(super) fn views(frames: &LoadedFrames) -> Result<Vec<View>> {
    let set = &frames.set;
    let indexed = set.frames.iter().enumerate();
    Ok(match (set.kind, set.layout) {
        (Kind::Polarization, _) => indexed
            .map(|(frame, f)| {
                let angle = f.analyser_deg.unwrap_or_default().to_radians();
                View { frame, position: [0, 0], block: 1, angle }
            })
            .collect(),
        (Kind::DivisionOfFocalPlane, Some(layout)) => indexed
            .flat_map(|(frame, _)| (0..4).map(move |k| (frame, [k % 2, k / 2])))
            .map(|(frame, position)| View {
                frame,
                position,
                block: 2,
                angle: layout[position[1]][position[0]].to_radians(),
            })
            .collect(),
        _ => {
            let problem = "holds photographs of another kind than polarization or division_of_focal_plane";
            return Err(Error::file(&frames.path, problem, "give the analyser angles, see `nacre schema frames`"));
        }
    })
}

/// Refuses sets in which no pixel can be used at all.
fn check_light(frames: &LoadedFrames, maps: &StokesMaps, linearizer: &Linearizer) -> Result<()> {
    let usable = maps.s0.iter().filter(|v| v.is_finite()).count();
    if usable == 0 {
        return Err(Error::file(
            &frames.path,
            "every pixel is saturated in at least one photograph",
            "expose less, or correct \"white\"",
        ));
    }
    let scale = frames.set.frames.iter().map(|f| f.scale()).fold(f64::INFINITY, f64::min);
    let one_code = (linearizer.step() * scale) as f32;
    if !maps.s0.iter().any(|&s0| 0.5 * s0 > one_code) {
        return Err(Error::file(
            &frames.path,
            "no pixel is brighter than black in these photographs",
            "expose longer, or correct \"black\"",
        ));
    }
    Ok(())
}

/// Noise of every view: as given, or from the residuals, or assumed.
pub(super) fn noise_of(
    frames: &LoadedFrames,
    linearizer: &Linearizer,
    views: &[View],
    maps: &StokesMaps,
    design: &Design,
) -> (Vec<FrameNoise>, NoiseSource) {
    let set = &frames.set;
    // The steepest part of the transfer curve, so that quantisation is never taken too small.
    let step = linearizer.step() * set.transfer.slope(1.0);
    let of_camera = |camera: super::NoiseModel| {
        let frame = |v: &View| &set.frames[v.frame];
        views.iter().map(|v| camera.frame(frame(v).gain.unwrap_or(1.0), frame(v).scale(), step)).collect()
    };
    if let Some(camera) = set.noise {
        return (of_camera(camera), NoiseSource::Given);
    }
    match estimate_noise(maps, design) {
        Some(mut noise) => {
            let scale = set.frames.iter().map(|f| f.scale()).sum::<f64>() / set.frames.len() as f64;
            noise.floor = noise.floor.max((step * scale).powi(2) / 12.0);
            (vec![noise; views.len()], NoiseSource::Estimated)
        }
        None => (of_camera(ASSUMED), NoiseSource::Assumed),
    }
}

/// Evens out illumination and vignetting: a common factor per pixel that no orientation depends on.
fn divide_by_flat(frames: &LoadedFrames, linearizer: &Linearizer, maps: &mut StokesMaps) -> Result<()> {
    let Some(flat) = &frames.set.flat else { return Ok(()) };
    let light = linearizer.plane(&frames.file(flat))?;
    let (block, width) = (frames.info.width / maps.width, frames.info.width);
    let mean = light.iter().map(|&v| f64::from(v)).sum::<f64>() / light.len() as f64;
    if mean <= 0.0 {
        return Err(Error::file(&frames.file(flat), "is black", "give a photograph of an evenly lit white surface"));
    }
    let area = (block * block) as f32 * mean as f32;
    for i in 0..maps.s0.len() {
        let (x, y) = (i % maps.width * block, i / maps.width * block);
        let sum: f32 = (0..block).flat_map(|j| light[(y + j) * width + x..][..block].iter()).sum();
        let factor = if sum > 0.0 { area / sum } else { f32::NAN };
        for plane in [&mut maps.s0, &mut maps.s1, &mut maps.s2] {
            plane[i] *= factor;
        }
    }
    Ok(())
}

impl Pixels {
    fn count(maps: &StokesMaps, map: &OrientationMaps) -> Self {
        let valid = map.orientation.iter().filter(|t| t.is_finite()).count();
        let saturated = maps.correlation.iter().filter(|t| t.is_nan()).count();
        let all = map.orientation.len();
        let mut sigma: Vec<f32> =
            map.sigma.iter().zip(&map.orientation).filter(|(_, t)| t.is_finite()).map(|(s, _)| *s).collect();
        let mut quantile = |q: f64| -> Option<f64> {
            let at = (q * (sigma.len().checked_sub(1)?) as f64) as usize;
            Some(f64::from(*sigma.select_nth_unstable_by(at, f32::total_cmp).1).to_degrees())
        };
        let correlation = maps.correlation.iter().zip(&map.orientation).filter(|(_, t)| t.is_finite());
        let correlation = correlation.map(|(c, _)| f64::from(*c)).sum::<f64>() / valid.max(1) as f64;
        Self {
            all,
            valid,
            saturated,
            too_little_modulation: all - valid - saturated,
            sigma_median_deg: quantile(0.5),
            sigma_p90_deg: quantile(0.9),
            correlation_mean: (valid > 0).then_some(correlation),
        }
    }
}
