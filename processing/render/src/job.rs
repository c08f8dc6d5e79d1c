//! From a scene to files.

use super::gpu::{self, Card};
use super::material::Notes;
use super::output;
use super::picture::{FEWEST, Picture, Pilot, SAMPLES};
use super::scene::Scene;
use super::spectral::{self, SpectralReport};
use super::sums::Sums;
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Seconds between two states that are kept.
const KEEP: f64 = 10.0;

/// What the user may choose.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Most samples of a pixel, on average over those with light: noisy ones get more, calm ones less.
    pub samples: usize,
    /// Error at which passes end: root mean square of the pixels' standard errors over the mean luminance.
    pub max_error: f64,
    /// This many wavelengths instead of as many as each place needs.
    pub wavelengths: Option<usize>,
    /// File that keeps what has been done.
    pub keep: Option<PathBuf>,
    /// Go on from that file.
    pub resume: bool,
    /// Measure what the sums are off by, against finer ones.
    pub check: bool,
    /// On a graphics card, where there is one that does the scene.
    pub gpu: bool,
    /// Spectra too, in bands so many nm apart.
    pub spectral_nm: Option<f64>,
    /// Draw light of environments by chance even where it could be summed up once.
    pub by_chance: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            samples: 256,
            max_error: 0.01,
            wavelengths: None,
            keep: None,
            resume: false,
            check: false,
            gpu: false,
            spectral_nm: None,
            by_chance: false,
        }
    }
}

/// What was expected.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Prediction {
    /// Passes that the error takes, or the samples allow.
    pub passes: usize,
    /// Error after them.
    pub noise: f64,
    /// Seconds that they take.
    pub seconds: f64,
}

/// What a rendering was like.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// How.
    pub method: &'static str,
    /// The graphics card, or "processor".
    pub device: String,
    /// Pixels of a row, and rows.
    pub size: [usize; 2],
    /// Samples of a pixel, on average over those with light.
    pub samples: usize,
    /// Root mean square of the pixels' standard errors over the mean luminance.
    pub noise: f64,
    /// What sums over orders and wavelengths are off by, from a look at some pixels with finer ones: root mean square over their mean
    /// luminance, as noise is.
    pub predicted_model_error: f64,
    /// The same, measured against much finer sums of more pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub measured_model_error: Option<f64>,
    /// The spectra, if they were asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spectral: Option<SpectralReport>,
    /// What was expected before.
    pub predicted: Prediction,
    /// How each material is computed.
    pub materials: BTreeMap<String, Notes>,
    /// What to know.
    pub warnings: Vec<String>,
    /// What is taken for granted.
    pub assumptions: Vec<&'static str>,
    /// Seconds of everything.
    pub seconds: f64,
    /// Seconds of the passes.
    pub seconds_of_passes: f64,
    /// Files that were written.
    pub files: Vec<PathBuf>,
}

const ASSUMPTIONS: [&str; 4] = [
    "light is reflected once: surfaces do not light each other, but shade each other",
    "gratings: scalar theory, unpolarised light, orders balanced so that none gain or lose light",
    "colours are linear sRGB of the observer's X, Y, Z without adaptation: D65 is white",
    "linear sRGB of environments stands for spectra that are mixtures of three parts of D65",
];

/// How far a rendering is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SoFar {
    /// Passes that are done.
    pub passes: usize,
    /// Passes that are expected, from how the noise falls.
    pub of: usize,
    /// Root mean square of the pixels' standard errors over the mean luminance; NaN after one pass.
    pub noise: f64,
    /// Seconds that the rest takes.
    pub seconds_left: f64,
}

/// Renders a scene whose files are sought in a folder.
///
/// # Errors
/// `Input` for what makes no sense; `Cancelled`; `Output` when the state cannot be kept.
pub fn render(scene: &Scene, folder: &Path, settings: &Settings, progress: &dyn Progress) -> Result<(Picture, Report)> {
    render_watched(scene, folder, settings, progress, &mut |_, _| {})
}

/// The same, and shows the picture after each pass; rendering waits meanwhile.
///
/// # Errors
/// As [`render`].
pub fn render_watched(
    scene: &Scene,
    folder: &Path,
    settings: &Settings,
    progress: &dyn Progress,
    watch: &mut dyn FnMut(&Picture, &SoFar),
) -> Result<(Picture, Report)> {
    let begun = Instant::now();
    check(settings)?;
    settings.spectral_nm.map_or(Ok(()), |step| spectral::check(scene, step))?;
    let mut sums = Sums::new(scene, folder, settings, progress)?;
    let digest = output::digest(scene, settings);
    let mut picture = Picture::new(sums.ready.size());
    if let Some(path) = settings.keep.as_ref().filter(|_| settings.resume) {
        picture = output::resumed(path, &digest, sums.ready.size())?;
    }
    let most = (settings.samples / SAMPLES).max(1);
    let (mut card, refused) = match settings.gpu.then(|| gpu::card(&sums.ready)) {
        Some(Ok(card)) => (Some(card), None),
        Some(Err(why)) => (None, Some(format!("rendered on the processor: {why}"))),
        None => (None, None),
    };
    let pilot = match &mut card {
        Some(card) => first_passes(card, &mut picture, most, progress)?,
        None => sums.pilot(settings, most, progress)?,
    };
    let ready = &sums.ready;
    let passes = pilot.passes(settings.max_error, most);
    let predicted = Prediction {
        passes,
        noise: pilot.noise(passes),
        seconds: pilot.seconds_of_a_pass * passes.saturating_sub(picture.passes) as f64,
    };
    let measured = if settings.check { Some(sums.checked(scene, folder, progress)?) } else { None };
    let passing = Instant::now();
    progress.stage("passes", passes as u64);
    let (mut kept, first, mut noise) = (Instant::now(), picture.passes, picture.error());
    while !picture.is_enough(most, settings.max_error) {
        match &mut card {
            Some(card) => on_card(card, &mut picture, progress)?,
            None => picture.add(ready, progress)?,
        }
        progress.step();
        noise = picture.error();
        let of = match picture.passes < 2 * FEWEST {
            true => passes.max(picture.passes),
            false => expected(&picture, noise, settings.max_error, most),
        };
        let pace = passing.elapsed().as_secs_f64() / (picture.passes - first) as f64;
        let seconds_left = pace * of.saturating_sub(picture.passes) as f64;
        watch(&picture, &SoFar { passes: picture.passes, of, noise, seconds_left });
        if let Some(path) = settings.keep.as_ref().filter(|_| kept.elapsed().as_secs_f64() > KEEP) {
            output::keep(path, &picture, &digest)?;
            kept = Instant::now();
        }
    }
    if let Some(path) = &settings.keep {
        output::keep(path, &picture, &digest)?;
    }
    let mut warnings = ready.warnings.clone();
    warnings.extend(refused);
    warnings.extend(sums.warning());
    if picture.pixels.iter().all(|p| p.luminance <= 0.0) {
        warnings.push("nothing is lit".into());
    }
    let (device, seconds_of_passes) =
        (card.map_or_else(|| "processor".into(), |card| card.name().to_owned()), passing.elapsed().as_secs_f64());
    let (size, materials) = (ready.size(), ready.notes.clone());
    let mut spectral = None;
    if let Some(step) = settings.spectral_nm {
        let (bands, about) = spectral::spectra(sums.ready, (scene, folder), step, settings, progress)?;
        (picture.bands, spectral) = (bands, Some(about));
    }
    let report = Report {
        method: "passes of 4 samples per pixel, most where noise is; exact orders in closed lobes under small lights, sums over orders and wavelengths or \
                 multiple importance sampling under environments",
        device,
        size,
        samples: picture.passes * SAMPLES,
        noise: if picture.passes > 1 { noise } else { predicted.noise },
        predicted_model_error: sums.error,
        measured_model_error: measured,
        spectral,
        predicted,
        materials,
        warnings,
        assumptions: ASSUMPTIONS.to_vec(),
        seconds: begun.elapsed().as_secs_f64(),
        seconds_of_passes,
        files: vec![],
    };
    Ok((picture, report))
}

/// Passes that an error takes when so many have this one: it falls with their root.
fn expected(picture: &Picture, noise: f64, wanted: f64, most: usize) -> usize {
    let passes = (picture.passes as f64 * (noise / wanted).powi(2)).ceil();
    if passes.is_finite() { (passes as usize).clamp(picture.passes, most) } else { most }
}

/// Adds a pass of a card's.
fn on_card(card: &mut Card, picture: &mut Picture, progress: &dyn Progress) -> Result<()> {
    progress.check()?;
    let pixels = card
        .pass(picture.passes * SAMPLES, SAMPLES)
        .map_err(|why| Error::input("gpu", why, "leave --gpu out to render on the processor"))?;
    picture.add_pixels(&pixels);
    Ok(())
}

/// The first passes of a card tell what the others will be like.
fn first_passes(card: &mut Card, picture: &mut Picture, most: usize, progress: &dyn Progress) -> Result<Pilot> {
    let begun = Instant::now();
    let before = picture.passes;
    while picture.passes < FEWEST.min(most) {
        on_card(card, picture, progress)?;
    }
    let seconds = begun.elapsed().as_secs_f64() / (picture.passes - before).max(1) as f64;
    Ok(Pilot::of(&picture.pixels, seconds, true))
}

pub(super) fn check(settings: &Settings) -> Result<()> {
    if !(1..=1 << 20).contains(&settings.samples) {
        let problem = format!("are {}", settings.samples);
        return Err(Error::input("samples", problem, "give 1 to 1048576 samples per pixel"));
    }
    if !(1e-5..=1.0).contains(&settings.max_error) {
        let problem = format!("is {}", settings.max_error);
        return Err(Error::input("max-error", problem, "give 0.00001 to 1"));
    }
    if settings.wavelengths.is_some_and(|n| !(3..=10_000).contains(&n)) {
        return Err(Error::input("wavelengths", "are too few or too many", "give 3 to 10000, or leave them out"));
    }
    if settings.resume && settings.keep.is_none() {
        return Err(Error::input("resume", "needs a file that was kept", "add --keep FILE.exr"));
    }
    Ok(())
}
