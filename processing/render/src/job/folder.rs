//! Rendering as a job: from a folder with a scene to one with its picture and a report.

use super::report::{Report, SoFar};
use super::{render_watched, spectral};
use crate::picture::{Picture, exposure, png, write_picture, write_png};
use crate::prepared_scene;
use crate::scene::Scene;
use crate::settings::Settings;
use nacre_base::estimate::{Machine, Work};
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use nacre_image::budget::Operation;
use nacre_image::{Depth, Info, OutputFolder};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Time between two glimpses, and the part of all time that they may take.
const PAUSE: Duration = Duration::from_secs(1);
const SHARE: u32 = 20;

/// Longest side of a glimpse, in pixels.
const SIDE: usize = 1024;

/// What the user may choose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Options {
    /// Most samples of a pixel, on average over those with light.
    pub samples: usize,
    /// Error at which passes end: root mean square of the pixels' standard errors over the mean luminance.
    pub max_error: f64,
    /// This many wavelengths instead of as many as each place needs.
    pub wavelengths: Option<usize>,
    /// Measure what the sums over orders and wavelengths are off by, against finer ones.
    pub check: bool,
    /// Spectra too, in bands so many nm apart.
    pub spectral_nm: Option<f64>,
}

impl Default for Options {
    fn default() -> Self {
        let Settings { samples, max_error, wavelengths, check, spectral_nm, .. } = Settings::default();
        Self { samples, max_error, wavelengths, check, spectral_nm }
    }
}

impl Options {
    fn settings(&self) -> Settings {
        let Self { samples, max_error, wavelengths, check, spectral_nm } = *self;
        Settings { samples, max_error, wavelengths, check, spectral_nm, ..Settings::default() }
    }
}

/// A picture while it is rendered.
#[derive(Clone, Debug)]
pub struct Glimpse {
    /// What is there, as a PNG with at most 1024 pixels along a side.
    pub png: Vec<u8>,
    /// How far it is.
    pub so_far: SoFar,
}

/// A report with what was asked for.
#[derive(Serialize)]
struct Written<'a> {
    #[serde(flatten)]
    report: Report,
    settings: &'a Options,
    /// What linear light was multiplied with for the PNG.
    exposure: f64,
}

/// Refuses what cannot be rendered, without a look into the files that the scene names; they have to lie in the folder.
///
/// # Errors
/// `Input`, which names the key, the file or the option.
pub fn check_folder(input: &Path, options: &Options) -> Result<Scene> {
    options.settings().check()?;
    let scene = Scene::read(&scene_in(input)?)?;
    prepared_scene::check(&scene)?;
    scene.check_files(input)?;
    options.spectral_nm.map_or(Ok(()), |step| spectral::check(&scene, step))?;
    Ok(scene)
}

/// What a rendering needs at most; many end earlier, once their error is met.
pub fn work(scene: &Scene, options: &Options) -> Work {
    let picture = Info { width: scene.camera.width, height: scene.camera.height, channels: 3, depth: Depth::F32 };
    Operation::Rendering(options.samples).work(picture)
}

/// What a rendering needs whose time is known from a few passes: `taken_s` seconds of this machine are gone, `left_s` are left.
pub(super) fn measured_work(scene: &Scene, settings: &Settings, [taken_s, left_s]: [f64; 2]) -> Work {
    let most = work(scene, &Options { samples: settings.samples, ..Options::default() });
    // A name of its own: the time of `most` is a bound, from which nothing is learned about this one.
    Work { operation: "passes".into(), seconds: left_s * Machine::here().speed, taken_s, ..most }
}

/// The only TOML file of a folder.
fn scene_in(folder: &Path) -> Result<PathBuf> {
    let files =
        std::fs::read_dir(folder).map_err(|e| Error::file(folder, format!("cannot be read: {e}"), "send it anew"))?;
    let toml = |path: &PathBuf| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    let mut scenes = files.flatten().map(|entry| entry.path()).filter(toml);
    let remedy = "send one .toml file with the files that it names";
    match (scenes.next(), scenes.next()) {
        (Some(scene), None) => Ok(scene),
        (None, _) => Err(Error::input("scene", "is not there", remedy)),
        (Some(_), Some(_)) => Err(Error::input("scene", "is there more than once", remedy)),
    }
}

/// Renders the scene in `input` and writes `render.exr`, `render.png` and `report.json` into the new folder `out`. At most once a second, and
/// for at most a twentieth of the time, it makes a glimpse of what is there.
///
/// # Errors
/// `Input` for what cannot be rendered; `Output`; `Cancelled`. Nothing is left behind then.
pub fn render_folder(
    input: &Path,
    out: &Path,
    options: &Options,
    overwrite: bool,
    progress: &dyn Progress,
    seen: &mut dyn FnMut(Glimpse),
) -> Result<()> {
    let scene = check_folder(input, options)?;
    let folder = OutputFolder::begin(out, overwrite)?;
    let mut due = Instant::now();
    let mut watch = |picture: &Picture, so_far: &SoFar| {
        let begun = Instant::now();
        if begun < due {
            return;
        }
        let small = picture.shrunk(SIDE);
        // A picture to look at is not worth a failed job.
        if let Ok(png) = png(&small, scene.exposure.unwrap_or_else(|| exposure(&small))) {
            seen(Glimpse { png, so_far: *so_far });
        }
        due = Instant::now() + PAUSE.max(begun.elapsed() * SHARE);
    };
    let (picture, mut report) = render_watched(&scene, input, &options.settings(), progress, &mut watch)?;
    progress.stage("writing", 1);
    let exposure = scene.exposure.unwrap_or_else(|| exposure(&picture));
    write_picture(&folder.path("render.exr"), &picture)?;
    write_png(&folder.path("render.png"), &picture, exposure)?;
    if report.noise > options.max_error {
        let Report { noise, .. } = report;
        let wanted = options.max_error;
        report.warnings.push(format!(
            "the noise is {noise:.2e} of the mean, more than the {wanted} asked for: allow more samples"
        ));
    }
    report.files = ["render.exr", "render.png"].map(PathBuf::from).into();
    folder.write_json("report.json", &Written { report, settings: options, exposure })?;
    progress.check()?;
    folder.commit()?;
    progress.step();
    Ok(())
}
