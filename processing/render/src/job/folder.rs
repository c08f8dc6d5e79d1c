//! Rendering as a job: reads a folder with a scene, writes a folder with picture and report.

use super::report::{Report, SoFar};
use super::{render_watched, spectral};
use crate::picture::{Picture, exposure, png, write_picture, write_png};
use crate::scene::{MAX_BYTES, REMEDY, Scene};
use crate::settings::{Method, Settings};
use nacre_base::estimate::{Machine, Work};
use nacre_base::operation::{Input, Operation, Summary};
use nacre_base::progress::Progress;
use nacre_base::text::read_text;
use nacre_base::{Error, OutputFolder, Result};
use nacre_image::budget;
use nacre_image::{Depth, Info};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Interval between two previews, and their largest share of the total time.
const PAUSE: Duration = Duration::from_secs(1);
const SHARE: u32 = 20;

/// Longest side of a preview in pixels.
const SIDE: usize = 1024;

/// Render a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(extend("x-input" = "A folder with one scene (TOML) and the files that it names"))]
#[schemars(rename = "RenderOptions")]
pub struct Options {
    /// Largest number of samples per pixel, averaged over lit pixels. Half of the samples are distributed by noise.
    #[schemars(range(min = 1, max = 1_048_576))]
    pub samples: usize,
    /// Target error: root mean square of the pixels' standard errors, relative to the mean luminance.
    #[schemars(range(min = 1e-5, max = 1.0))]
    pub max_error: f64,
    /// Fixed number of wavelengths, evenly spaced in 1/λ; default: as many as each surface point needs.
    #[schemars(extend("x-advanced" = true))]
    pub wavelengths: Option<usize>,
    /// Also measure the truncation error of the sums over orders and wavelengths.
    #[schemars(extend("x-advanced" = true))]
    pub check: bool,
    /// Spacing of spectral bands in nm (1 to 100) for a spectrum per pixel, stored as EXR channels S0.550,000000nm and
    /// so on.
    #[schemars(extend("x-advanced" = true, "x-aliases" = ["spectral"]))]
    pub spectral_nm: Option<f64>,
    /// Method for lookup tables under environments: auto is the cheapest that meets the target error.
    pub method: Method,
    /// Largest number of terms per channel and part of a table in two passes (1 to 96); default: as many as the error
    /// requires.
    #[schemars(extend("x-advanced" = true))]
    pub rank: Option<usize>,
    /// Text of a scene (TOML) that replaces the scene of the folder, beside the same files.
    #[schemars(extend("x-request" = true))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scene: Option<String>,
}

impl Default for Options {
    fn default() -> Self {
        let Settings { samples, max_error, wavelengths, check, spectral_nm, method, rank, .. } = Settings::default();
        Self { samples, max_error, wavelengths, check, spectral_nm, method, rank, scene: None }
    }
}

impl Options {
    /// Converts to settings of a rendering.
    pub fn settings(&self) -> Settings {
        let Self { samples, max_error, wavelengths, check, spectral_nm, method, rank, .. } = *self;
        Settings { samples, max_error, wavelengths, check, spectral_nm, method, rank, ..Settings::default() }
    }

    /// Text of the scene: the given one, or that of the folder.
    fn text(&self, folder: &Path) -> Result<String> {
        self.scene.clone().map_or_else(|| scene_text(folder), Ok)
    }
}

/// A report with the requested options.
#[derive(Debug, Serialize, JsonSchema)]
#[schemars(rename = "RenderReport")]
pub struct Written {
    #[serde(flatten)]
    report: Report,
    settings: Options,
    /// Factor from linear radiance to the PNG.
    exposure: f64,
}

impl Summary for Written {
    fn summary(&self) -> String {
        self.report.summary()
    }

    fn warnings(&self) -> &[String] {
        self.report.warnings()
    }
}

/// Upper bound of a rendering's work; many renderings end earlier, when they meet the target error.
fn work(scene: &Scene, options: &Options) -> Work {
    let picture = Info { width: scene.camera.width, height: scene.camera.height, channels: 3, depth: Depth::F32 };
    budget::Operation::Rendering(options.samples).work(picture)
}

/// Work of a rendering whose time is extrapolated from a few passes: `taken_s` seconds have elapsed on this machine,
/// `left_s` remain.
pub(super) fn measured_work(scene: &Scene, settings: &Settings, [taken_s, left_s]: [f64; 2]) -> Work {
    let most = work(scene, &Options { samples: settings.samples, ..Options::default() });
    // A separate operation name: the time in `most` is a bound, from which this estimate must not be calibrated.
    Work { operation: "passes".into(), seconds: left_s * Machine::here().speed, taken_s, ..most }
}

/// Text of the scene in a folder: its only TOML file.
///
/// # Errors
/// `Input` if there is none, or more than one.
pub fn scene_text(folder: &Path) -> Result<String> {
    read_text(&scene_in(folder)?, MAX_BYTES, REMEDY)
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

impl Operation for Options {
    const NAME: &'static str = "render";
    const TITLE: &'static str = "Picture of a scene: measured and invented surfaces under any light";
    const INPUT: Input = Input::Files;
    type Report = Written;

    /// Does not read the files that the scene refers to; they must lie in the folder. Many renderings end before the
    /// estimate, when they meet the target error.
    fn check(&self, input: &Path) -> Result<Work> {
        self.settings().check()?;
        let scene = Scene::beside(&self.text(input)?, input)?;
        self.spectral_nm.map_or(Ok(()), |step| spectral::check(&scene, step))?;
        Ok(work(&scene, self))
    }

    /// Writes `render.exr`, `render.png`, and the scene as `scene.toml`. Previews are shown at most once a second and
    /// take at most a twentieth of the time.
    fn run(&self, input: &Path, out: &OutputFolder, progress: &dyn Progress) -> Result<Written> {
        let text = self.text(input)?;
        let scene = Scene::beside(&text, input)?;
        let mut due = Instant::now();
        let mut watch = |picture: &Picture, so_far: &SoFar| {
            let begun = Instant::now();
            if begun < due || !progress.is_watched() {
                return;
            }
            let small = picture.shrunk(SIDE);
            // A failed preview must not fail the job.
            if let Ok(png) = png(&small, scene.exposure.unwrap_or_else(|| exposure(&small))) {
                progress.show(serde_json::to_value(so_far).unwrap_or_default(), png);
            }
            due = Instant::now() + PAUSE.max(begun.elapsed() * SHARE);
        };
        let (picture, mut report) = render_watched(&scene, input, &self.settings(), progress, &mut watch)?;
        progress.stage("writing", 1);
        let exposure = scene.exposure.unwrap_or_else(|| exposure(&picture));
        write_picture(&out.path("render.exr"), &picture)?;
        write_png(&out.path("render.png"), &picture, exposure)?;
        out.write("scene.toml", text.as_bytes())?;
        let (noise, wanted) = (report.noise, self.max_error);
        if progress.is_enough() {
            report
                .warnings
                .push(format!("stopped on request at a noise of {noise:.2e} of the mean; {wanted} was asked for"));
        } else if noise > wanted {
            report.warnings.push(format!(
                "the noise is {noise:.2e} of the mean, more than the {wanted} asked for: allow more samples"
            ));
        }
        report.files = ["render.exr", "render.png", "scene.toml"].map(PathBuf::from).into();
        progress.step();
        Ok(Written { report, settings: self.clone(), exposure })
    }
}
