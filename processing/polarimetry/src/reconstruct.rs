//! The whole job: a set of photographs to maps, pictures and a report in a new folder.

use crate::angles::aligned::smoothed_noise;
use crate::angles::angle_error::distorted;
use crate::film::choose::Choice;
use crate::film::cloud::cloud;
use crate::film::correction::{Corrected, Stand, choose_corrected};
use crate::film::locate::{Lens, locate};
use crate::fit::merge::Merge;
use crate::fit::repeats::{calibrate, pairs};
use crate::fit::sample::Sample;
use crate::fit::views::View;
use crate::fit::weighted::{scale_variances, variance_factor};
use crate::orientation::edges::{widen_at_edges, widen_where_apart};
use crate::orientation::orient::phases;
use crate::report::errors::Angles;
use crate::report::json::{Pixels, Report};
use crate::running::noise_of_bracket;
use crate::{
    Align, CircleCheck, Design, FrameNoise, MASK_SNR, Material, Model, NoiseSource, Oblique, ObliqueReport,
    OrientationMaps, PeriodMethod, Running, Smoothing, StokesMaps, check_circle, estimate_noise,
};
use nacre_base::progress::Progress;
use nacre_base::vectors::vectorised;
use nacre_base::{Error, Result};
use nacre_frames::{Linearizer, LoadedFrames, load};
use nacre_image::OutputFolder;
use rayon::prelude::*;
use std::path::Path;

/// What the user may choose.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The model; [`Options::model_for`] says which one is the default.
    pub model: Option<Model>,
    /// Whether photographs are moved back onto each other.
    pub align: Align,
    /// Whether oblique incidence is taken out.
    pub oblique: Oblique,
    /// Added to every orientation, to fix the gauge (degrees).
    pub offset_deg: f64,
    /// How orientations are smoothed in pictures.
    pub smooth: Smoothing,
    /// Smooth the map itself as well.
    pub smooth_maps: bool,
    /// Also write `smoothed.exr`, the smoothed orientations at full size.
    pub smoothed_exr: bool,
    /// Makes a map of periods, too.
    pub period: Option<PeriodMethod>,
    /// Replace results that are already there.
    pub overwrite: bool,
}

/// Reconstructs the orientation map of `input` (a session folder or `frames.json` of kind polarization or
/// division_of_focal_plane) into the new folder `out`.
///
/// Memory: 6 floats per pixel and two decoded photographs, whatever the number of frames; where several exposures at each
/// angle are merged, 22 floats and the photographs at two angles; 10 while the map is smoothed.
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
    /// The model asked for. By default [`Model::Auto`] for photographs of a capture session, which shows gratings lit by its panel;
    /// [`Model::Plain`] for others, whose scene nobody declared.
    pub fn model_for(&self, frames: &LoadedFrames) -> Model {
        self.model.unwrap_or(if frames.from_session { Model::Auto } else { Model::Plain })
    }

    /// Refuses what makes no sense, before anything is done; returns how periods are told, with the photographs' wavelength.
    ///
    /// # Errors
    /// `Input`, for numbers that make no sense and for a wavelength that nothing says.
    pub fn check(&self, frames: &LoadedFrames) -> Result<Option<PeriodMethod>> {
        if !self.offset_deg.is_finite() {
            return Err(Error::input(
                "--offset-deg",
                format!("{} is no angle", self.offset_deg),
                "give finite degrees",
            ));
        }
        if (self.smooth_maps || self.smoothed_exr) && self.smooth == Smoothing::NONE {
            let problem = "a smoothed map was asked for, but the smoothing is none";
            return Err(Error::input("--smooth", problem, "choose light, strong or a number of rounds"));
        }
        if self.model_for(frames) == Model::Plain {
            self.check_plain()?;
        }
        self.period.as_ref().map(|p| p.completed(frames.set.wavelength_nm)).transpose()
    }

    /// Refuses options that plain polarimetry has no use for.
    fn check_plain(&self) -> Result<()> {
        let of_gratings = [
            ("--offset-deg", self.offset_deg != 0.0),
            ("--oblique", self.oblique != Oblique::Off),
            ("--smooth-maps", self.smooth_maps),
            ("--smoothed-exr", self.smoothed_exr),
            ("--contrast-period", matches!(self.period, Some(PeriodMethod::Contrast { .. }))),
            ("--relative-period", matches!(self.period, Some(PeriodMethod::Brightness { .. }))),
        ];
        match of_gratings.into_iter().find(|(_, given)| *given) {
            Some((option, _)) => {
                let problem = "belongs to models of gratings, and the model is plain";
                Err(Error::input(option, problem, "leave it out, or add --model auto if this is a grating"))
            }
            None => Ok(()),
        }
    }
}

/// Orientations under the chosen model.
pub(crate) struct Solved {
    pub map: OrientationMaps,
    /// Pixels of metal without a grating.
    pub without_grating: usize,
    pub circle: Option<CircleCheck>,
    pub choice: Option<Choice>,
    /// What was done about oblique incidence.
    pub oblique: Option<ObliqueReport>,
}

/// Pixels that a thread works on in one go.
const CHUNK: usize = 1 << 14;

impl Solved {
    /// σ of noise becomes that of noise, of the model, of what the lens mixes at edges, and of photographs that are left so many pixels apart.
    /// Plain polarimetry has no model that could be wrong, and light that a lens mixes has the polarization of the mixture.
    pub fn tell_systematic(&mut self, model: Model, apart_px: f64) {
        widen_where_apart(&mut self.map, apart_px as f32);
        if model == Model::Plain {
            return;
        }
        let systematic = self.choice.as_ref().map_or(0.0, |c| c.systematic) as f32;
        let square = systematic * systematic;
        self.map.sigma.par_chunks_mut(CHUNK).for_each(|sigma| {
            vectorised(
                #[inline(always)]
                || {
                    for s in &mut *sigma {
                        *s = (*s * *s + square).sqrt().min(std::f32::consts::FRAC_PI_2);
                    }
                },
            );
        });
        widen_at_edges(&mut self.map);
    }
}

/// What is asked of a solution.
pub struct Asked {
    /// Model of the points (S1/S0, S2/S0).
    pub model: Model,
    /// Added to every orientation, in rad.
    pub offset: f64,
    /// Where the camera stands, if the photographs say so.
    pub stand: Option<(Stand, Material)>,
    /// Whether what oblique incidence does is taken out.
    pub oblique: Oblique,
    /// Standard deviation of the analyser's angles in rad, where it is known.
    pub angle_sigma: f64,
    /// Pixels that models are fitted to and compared on.
    pub pixels: usize,
}

impl Asked {
    /// This model, and nothing else.
    pub fn of(model: Model) -> Self {
        Self { model, offset: 0.0, stand: None, oblique: Oblique::Off, angle_sigma: 0.0, pixels: CLOUD }
    }

    /// What the user wants of these photographs.
    pub(crate) fn by(
        (options, model): (&Options, Model),
        frames: &LoadedFrames,
        views: &[View],
        angles: &Angles,
    ) -> Self {
        let size = [frames.info.width, frames.info.height];
        let stand = frames.set.geometry.and_then(|g| Stand::new(&g, size, views.first().map_or(1, |v| v.block)));
        Self {
            offset: options.offset_deg.to_radians(),
            stand: stand.map(|stand| (stand, frames.set.material.unwrap_or_default())),
            oblique: options.oblique,
            angle_sigma: angles.sigma.unwrap_or(0.0),
            ..Self::of(model)
        }
    }
}

/// Pixels that models are fitted to and compared on.
pub const CLOUD: usize = 30_000;

/// Orientations alone: for charts.
pub fn orient_with(maps: &mut StokesMaps, design: &Design, noise: &[FrameNoise], asked: &Asked) -> OrientationMaps {
    let mut solved = solve_model(maps, design, noise, asked);
    solved.tell_systematic(asked.model, 0.0);
    solved.map
}

/// From intensities to orientations. Consumes the residual map: σ takes its place in memory.
pub(crate) fn solve_model(maps: &mut StokesMaps, design: &Design, noise: &[FrameNoise], asked: &Asked) -> Solved {
    let residual = std::mem::take(&mut maps.residual);
    solve_with(maps, residual, design, noise, asked)
}

/// The same while others read the maps.
pub(crate) fn solve_with(
    maps: &StokesMaps,
    residual: Vec<f32>,
    design: &Design,
    noise: &[FrameNoise],
    asked: &Asked,
) -> Solved {
    if asked.model == Model::Plain {
        let map = phases(maps, residual, design, noise, 0.0);
        return Solved { map, without_grating: 0, circle: None, choice: None, oblique: None };
    }
    let mut points = cloud(maps, design, noise, asked.pixels);
    points.retain(|p| p.snr >= f64::from(MASK_SNR));
    let distorted = distorted(&points, maps, design, asked.angle_sigma);
    let Some(Corrected { choice, correction, report }) = choose_corrected(&points, asked, distorted) else {
        let map = phases(maps, residual, design, noise, asked.offset);
        return Solved { circle: check_circle(maps, &map), map, without_grating: 0, choice: None, oblique: None };
    };
    let chosen = &choice.candidates[choice.chosen];
    let lens = Lens { design, noise, model: chosen, correction: correction.as_ref(), offset: asked.offset };
    let (map, without_grating) = locate(maps, residual, &lens);
    // The check looks at the points as they are.
    let circle = if correction.is_none() { check_circle(maps, &map) } else { None };
    Solved { map, without_grating, circle, choice: Some(choice), oblique: report }
}

/// Refuses sets in which no pixel can be used at all.
pub(crate) fn check_light(frames: &LoadedFrames, maps: &StokesMaps, linearizer: &Linearizer) -> Result<()> {
    let usable = maps.s0.iter().filter(|v| v.is_finite()).count();
    if usable == 0 {
        return Err(Error::file(
            &frames.path,
            "every pixel is saturated at one angle at least",
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

/// Photographs that were taken in.
pub(crate) struct Photographed<'a> {
    pub frames: &'a LoadedFrames,
    pub linearizer: &'a Linearizer,
    pub brackets: &'a [Vec<usize>],
    pub views: &'a [View],
    pub sample: &'a Sample,
    /// Shifts in pixels that were undone, which smooths.
    pub shifts: Option<&'a [[f64; 2]]>,
}

/// Noise of every view: as given, or from repeats, or from the residuals, or assumed. Maps of merged exposures know their
/// variances, which are corrected by the residuals where no noise is given.
pub(crate) fn noise_of(taken: &Photographed, maps: &mut StokesMaps, design: &Design) -> (Vec<FrameNoise>, NoiseSource) {
    let Photographed { frames, linearizer, brackets, views, sample, shifts } = taken;
    let of_camera = || {
        let view = |v: &View| Merge::together(&noise_of_bracket(frames, linearizer, &brackets[v.bracket]));
        let mut noise: Vec<FrameNoise> = views.iter().map(view).collect();
        if let Some(shifts) = shifts {
            smoothed_noise(&mut noise, shifts, [maps.width, maps.height]);
        }
        noise
    };
    if frames.set.noise.is_some() {
        return (of_camera(), NoiseSource::Given);
    }
    if !maps.covariance.is_empty() {
        let Some(factor) = variance_factor(maps, design) else { return (of_camera(), NoiseSource::Assumed) };
        let scaled = |n: FrameNoise| FrameNoise { shot: n.shot * factor, floor: n.floor * factor };
        let noise = of_camera().into_iter().map(scaled).collect();
        scale_variances(maps, factor);
        return (noise, NoiseSource::Estimated);
    }
    let step = linearizer.step() * frames.set.transfer.slope(1.0);
    let all = &frames.set.frames;
    let scale = all.iter().map(|f| f.scale()).sum::<f64>() / all.len() as f64;
    let quantisation = (step * scale).powi(2) / 12.0;
    let black = linearizer.lowest().map_or(f64::NEG_INFINITY, |v| v * scale);
    if let Some(noise) = calibrate(sample, &pairs(frames, views, sample.views()), black, quantisation) {
        return (vec![noise; views.len()], NoiseSource::Repeats);
    }
    match estimate_noise(maps, design) {
        Some(mut noise) => {
            noise.floor = noise.floor.max(quantisation);
            (vec![noise; views.len()], NoiseSource::Estimated)
        }
        None => (of_camera(), NoiseSource::Assumed),
    }
}

/// The report, but for what took how long.
pub(crate) fn reported(
    frames: &LoadedFrames,
    options: (&Options, Model),
    design: &Design,
    noise: (&[FrameNoise], NoiseSource),
    maps: &StokesMaps,
    solved: &Solved,
) -> Report {
    let pixels = Pixels::count(maps, &solved.map, solved.without_grating);
    Report::new(frames, options, design, noise, pixels, solved)
}

/// Evens out illumination and vignetting: a common factor per pixel that no orientation depends on.
pub(crate) fn divide_by_flat(frames: &LoadedFrames, linearizer: &Linearizer, maps: &mut StokesMaps) -> Result<()> {
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
