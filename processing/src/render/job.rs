//! From a scene to files.

use super::lobes::Accuracy;
use super::material::Notes;
use super::output;
use super::picture::{FEWEST, Picture, Pilot, SAMPLES};
use super::ready::Ready;
use super::scene::Scene;
use crate::progress::Progress;
use crate::{Error, Result};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Part of the wanted error that sums over orders and wavelengths may take.
const MODEL: f64 = 0.25;

/// Seconds between two states that are kept.
const KEEP: f64 = 10.0;

/// What the user may choose.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Most samples of a pixel.
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
}

impl Default for Settings {
    fn default() -> Self {
        Self { samples: 256, max_error: 0.01, wavelengths: None, keep: None, resume: false, check: false }
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
    /// Pixels of a row, and rows.
    pub size: [usize; 2],
    /// Samples of each pixel.
    pub samples: usize,
    /// Root mean square of the pixels' standard errors over the mean luminance.
    pub noise: f64,
    /// Relative error of the sums over orders and wavelengths that is predicted of the worst material.
    pub predicted_model_error: f64,
    /// The same, measured against finer sums: root mean square over some pixels, over that of their luminances.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub measured_model_error: Option<f64>,
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

/// Renders a scene whose files are sought in a folder.
///
/// # Errors
/// `Input` for what makes no sense; `Cancelled`; `Output` when the state cannot be kept.
pub fn render(scene: &Scene, folder: &Path, settings: &Settings, progress: &dyn Progress) -> Result<(Picture, Report)> {
    let begun = Instant::now();
    check(settings)?;
    let accuracy = Accuracy::new(MODEL * settings.max_error, settings.wavelengths);
    let ready = Ready::new(scene, folder, accuracy, progress)?;
    let digest = output::digest(scene, settings);
    let mut picture = Picture::new(ready.size());
    if let Some(path) = settings.keep.as_ref().filter(|_| settings.resume) {
        picture = output::resumed(path, &digest, ready.size())?;
    }
    let pilot = Pilot::new(&ready, progress)?;
    let most = (settings.samples / SAMPLES).max(1);
    let passes = pilot.passes(settings.max_error).min(most);
    let predicted = Prediction {
        passes,
        noise: pilot.error_of_a_pass / (passes as f64).sqrt(),
        seconds: pilot.seconds_of_a_pass * passes.saturating_sub(picture.passes) as f64,
    };
    let measured = if settings.check { Some(measured(scene, folder, &ready, settings, progress)?) } else { None };
    let passing = Instant::now();
    progress.stage("passes", passes as u64);
    let mut kept = Instant::now();
    while picture.passes < most {
        let enough = picture.passes >= FEWEST.min(most);
        if enough && (picture.passes >= 2 && picture.error() <= settings.max_error) {
            break;
        }
        picture.add(&ready, progress)?;
        progress.step();
        if let Some(path) = settings.keep.as_ref().filter(|_| kept.elapsed().as_secs_f64() > KEEP) {
            output::keep(path, &picture, &digest)?;
            kept = Instant::now();
        }
    }
    if let Some(path) = &settings.keep {
        output::keep(path, &picture, &digest)?;
    }
    let mut warnings = ready.warnings.clone();
    if picture.pixels.iter().all(|p| p.luminance <= 0.0) {
        warnings.push("nothing is lit".into());
    }
    let report = Report {
        method: "passes of 4 samples per pixel; exact orders in closed lobes under small lights, sums over orders and wavelengths or \
                 multiple importance sampling under environments",
        size: ready.size(),
        samples: picture.passes * SAMPLES,
        noise: if picture.passes > 1 { picture.error() } else { predicted.noise },
        predicted_model_error: ready.notes.values().map(|n| n.predicted_error).fold(0.0, f64::max),
        measured_model_error: measured,
        predicted,
        materials: ready.notes.clone(),
        warnings,
        assumptions: ASSUMPTIONS.to_vec(),
        seconds: begun.elapsed().as_secs_f64(),
        seconds_of_passes: passing.elapsed().as_secs_f64(),
        files: vec![],
    };
    Ok((picture, report))
}

fn check(settings: &Settings) -> Result<()> {
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

/// What sums over orders and wavelengths are off by: pixels rendered with the same numbers by chance, and sums a hundred times as exact.
fn measured(scene: &Scene, folder: &Path, ready: &Ready, settings: &Settings, progress: &dyn Progress) -> Result<f64> {
    let fine = Ready::new(scene, folder, Accuracy::new(1e-2 * MODEL * settings.max_error, None), progress)?;
    super::picture::compared(ready, &fine, progress)
}
