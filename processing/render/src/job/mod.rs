//! Renders a scene in passes until the target error is met, with a report, and as a job on folders.

mod draft;
mod flats;
mod folder;
mod report;
mod spectral;
mod sums;
mod two_pass;

pub use draft::draft;
pub use folder::{Options, Written, scene_text};
pub use report::{Prediction, Report, SoFar};
pub use spectral::SpectralReport;
pub use two_pass::EnvironmentReport;

use crate::gpu::{self, Card};
use crate::material::{SAMPLES, WELL_SPREAD};
use crate::picture::{FEWEST, Picture, Pilot, digest, keep, resumed};
use crate::prepared_scene::PreparedScene;
use crate::scene::Scene;
use crate::settings::Settings;
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use std::path::Path;
use std::time::Instant;
use sums::Sums;

/// Interval in s between saved states.
const KEEP: f64 = 10.0;

/// Samples per pixel from which passes have [`WELL_SPREAD`] samples: fewer passes with better stratification.
const MANY: usize = 256;

const ASSUMPTIONS: [&str; 4] = [
    "light is reflected once: surfaces do not light each other, but shade each other",
    "gratings: scalar theory, unpolarised light, orders balanced so that none gain or lose light",
    "colours are linear sRGB of the observer's X, Y, Z without adaptation: D65 is white",
    "linear sRGB of environments stands for spectra that are mixtures of three parts of D65",
];

/// Renders a scene whose files are in `folder`.
///
/// # Errors
/// `Input` for invalid scenes and settings; `Cancelled`; `Output` if the state cannot be saved.
pub fn render(scene: &Scene, folder: &Path, settings: &Settings, progress: &dyn Progress) -> Result<(Picture, Report)> {
    render_watched(scene, folder, settings, progress, &mut |_, _| {})
}

/// As [`render`], with a callback that receives the picture after each pass; rendering waits for it.
///
/// Time, memory and disk space are reported after a few passes, whose time is measured.
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
    settings.check()?;
    settings.spectral_nm.map_or(Ok(()), |step| spectral::check(scene, step))?;
    let mut sums = Sums::new(scene, folder, settings, progress)?;
    let digest = digest(scene, settings);
    let mut picture = Picture::new(sums.prepared.size());
    if let Some(path) = settings.keep.as_ref().filter(|_| settings.resume) {
        picture = resumed(path, &digest, sums.prepared.size())?;
    }
    let mut most = (settings.samples / SAMPLES).max(1);
    let (mut card, refused) = match settings.gpu.then(|| gpu::card(&sums.prepared)) {
        Some(Ok(card)) => (Some(card), None),
        Some(Err(why)) => (None, Some(format!("rendered on the processor: {why}"))),
        None => (None, None),
    };
    let mut pilot = match &mut card {
        Some(card) => first_passes(card, &mut picture, most, progress)?,
        None => sums.pilot(settings, most, progress)?,
    };
    let wanted = sums.noise(settings.max_error);
    if card.is_none() && picture.passes == 0 && pilot.passes(wanted, most) >= MANY / SAMPLES {
        picture.pass_samples = WELL_SPREAD;
    }
    most = (settings.samples / picture.pass_samples).max(1);
    let prepared = &sums.prepared;
    let measured = if settings.check { Some(sums.checked(scene, folder, progress)?) } else { None };
    let passing = Instant::now();
    let (mut kept, first) = (Instant::now(), picture.passes);
    if card.is_none() {
        pilot = own_first_passes(prepared, &mut picture, pilot, (wanted, most), progress, watch)?;
    }
    let mut noise = picture.error();
    let passes = pilot.passes(wanted, most);
    let predicted = Prediction {
        passes,
        noise: pilot.noise(passes),
        seconds: pilot.seconds_of_a_pass * passes.saturating_sub(first) as f64,
    };
    let times = [begun.elapsed().as_secs_f64(), predicted.seconds];
    progress.expect(&folder::measured_work(scene, settings, times))?;
    progress.stage("passes", passes.saturating_sub(picture.passes) as u64);
    while !picture.is_enough(most, wanted, progress) {
        match &mut card {
            Some(card) => on_card(card, &mut picture, progress)?,
            None => picture.add(prepared, progress)?,
        }
        progress.step();
        noise = picture.error();
        let of = match picture.passes < 2 * FEWEST {
            true => passes.max(picture.passes),
            false => expected(&picture, noise, wanted, most),
        };
        let pace = passing.elapsed().as_secs_f64() / (picture.passes - first) as f64;
        let seconds_left = pace * of.saturating_sub(picture.passes) as f64;
        watch(&picture, &SoFar { passes: picture.passes, of, noise, seconds_left });
        if let Some(path) = settings.keep.as_ref().filter(|_| kept.elapsed().as_secs_f64() > KEEP) {
            keep(path, &picture, &digest)?;
            kept = Instant::now();
        }
    }
    if let Some(path) = &settings.keep {
        keep(path, &picture, &digest)?;
    }
    let mut warnings = prepared.warnings.clone();
    warnings.extend(refused);
    warnings.extend(sums.warning());
    warnings.extend(sums.two_pass_warning(settings.max_error));
    if picture.pixels.iter().all(|p| p.luminance <= 0.0) {
        warnings.push("nothing is lit".into());
    }
    let (device, seconds_of_passes) =
        (card.map_or_else(|| "processor".into(), |card| card.name().to_owned()), passing.elapsed().as_secs_f64());
    let (size, materials) = (prepared.size(), prepared.notes.clone());
    let mut spectral = None;
    if let Some(step) = settings.spectral_nm {
        let (bands, about) = spectral::spectra(sums.prepared, (scene, folder), step, settings, progress)?;
        (picture.bands, spectral) = (bands, Some(about));
    }
    let report = Report {
        method: "passes of 4 or 16 samples per pixel, most where noise is; exact orders in closed lobes under small lights, sums over orders and wavelengths or \
                 multiple importance sampling under environments",
        device,
        size,
        samples: picture.samples(),
        noise: if picture.passes > 1 { noise } else { predicted.noise },
        predicted_model_error: sums.error.hypot(sums.two_pass),
        measured_model_error: measured,
        spectral,
        predicted,
        materials,
        environments: sums.environments,
        hints: scene.hints.clone(),
        warnings,
        assumptions: ASSUMPTIONS.to_vec(),
        seconds: begun.elapsed().as_secs_f64(),
        seconds_of_passes,
        files: vec![],
    };
    Ok((picture, report))
}

/// Number of passes for a target error, extrapolated from the present error, which falls with their square root.
fn expected(picture: &Picture, noise: f64, wanted: f64, most: usize) -> usize {
    let passes = (picture.passes as f64 * (noise / wanted).powi(2)).ceil();
    if passes.is_finite() { (passes as usize).clamp(picture.passes, most) } else { most }
}

/// Adds a pass rendered on a graphics card.
fn on_card(card: &mut Card, picture: &mut Picture, progress: &dyn Progress) -> Result<()> {
    progress.check()?;
    let pixels = card
        .pass(picture.passes * SAMPLES, SAMPLES)
        .map_err(|why| Error::input("gpu", why, "leave --gpu out to render on the processor"))?;
    picture.add_pixels(&pixels);
    Ok(())
}

/// Renders the first passes of all pixels and predicts the remaining ones from their noise. Returns the pilot `ahead`
/// for a picture that already has passes, or has fewer than two.
fn own_first_passes(
    prepared: &PreparedScene,
    picture: &mut Picture,
    ahead: Pilot,
    (error, most): (f64, usize),
    progress: &dyn Progress,
    watch: &mut dyn FnMut(&Picture, &SoFar),
) -> Result<Pilot> {
    let (begun, first) = (Instant::now(), picture.passes);
    let larger = picture.pass_samples / SAMPLES;
    let of = (ahead.passes(error, most * larger) / larger).max(FEWEST).min(most);
    progress.stage("first passes", FEWEST.min(most).saturating_sub(first) as u64);
    while picture.passes < FEWEST.min(most) && !picture.is_wanted_now(progress) {
        picture.add(prepared, progress)?;
        progress.step();
        let seconds_left = (ahead.seconds_of_a_pass * larger as f64) * (of - picture.passes) as f64;
        watch(picture, &SoFar { passes: picture.passes, of, noise: picture.error(), seconds_left });
    }
    if picture.passes == first || picture.passes < 2 {
        return Ok(ahead);
    }
    let seconds = begun.elapsed().as_secs_f64() / (picture.passes - first) as f64;
    Ok(Pilot::of_picture(picture, seconds))
}

/// The first passes on a card predict time and noise of the others.
fn first_passes(card: &mut Card, picture: &mut Picture, most: usize, progress: &dyn Progress) -> Result<Pilot> {
    let begun = Instant::now();
    let before = picture.passes;
    while picture.passes < FEWEST.min(most) {
        on_card(card, picture, progress)?;
    }
    let seconds = begun.elapsed().as_secs_f64() / (picture.passes - before).max(1) as f64;
    Ok(Pilot::of(&picture.pixels, seconds, true))
}
