//! Operation: a height field to a map, its picture and a report in a new folder.

use super::brdf::{Map, Views, map};
use super::geometry::Window;
use super::height::{EXTENSIONS, HeightField, Quality, Scale, read};
use super::output::{albedo, needed_size, write_figure, write_map, write_picture};
use super::report::Report;
use super::settings::Settings;
use nacre_base::estimate::Work;
use nacre_base::operation::{Input, Operation, Summary};
use nacre_base::progress::Progress;
use nacre_base::{Error, OutputFolder, Result};
use nacre_image::budget;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Options of a BRDF map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "BrdfOptions")]
pub struct Options {
    /// Pixel pitch of the height field in µm, unless its file states it.
    pub pixel_um: Option<f64>,
    /// Height of white above black in µm, unless the file states it.
    pub range_um: Option<f64>,
    /// Channel of a file with several: its name, or its number from 1 (default: the first height channel).
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-advanced" = true))]
    pub channel: Option<String>,
    /// Largest fraction of gaps to fill by interpolation, above 0 and at most 0.5; by default none are filled.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-advanced" = true))]
    pub fill_gaps: Option<f64>,
    /// Subtract the best-fitting plane, for tilted samples.
    pub level: bool,
    /// Pixels per side of the map, 8 to 4096.
    pub size: usize,
    /// Magnification: 4 shows a square of a quarter of the sines, for single orders.
    #[schemars(extend("x-advanced" = true))]
    pub zoom: f64,
    /// Centre of the map as sines, sin θ (cos φ, sin φ).
    #[schemars(extend("x-advanced" = true, "x-placeholder" = "X,Y"))]
    pub center: [f64; 2],
    /// Light, material, accuracy.
    #[schemars(extend("x-inline" = true))]
    pub settings: Settings,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            pixel_um: None,
            range_um: None,
            channel: None,
            fill_gaps: None,
            level: false,
            size: 512,
            zoom: 1.0,
            center: [0.0; 2],
            settings: Settings::default(),
        }
    }
}

/// Report fields of a map.
#[derive(Serialize, JsonSchema)]
#[schemars(rename = "BrdfMapReport")]
pub struct MapReport {
    /// Pixels per side.
    pub width: usize,
    /// Reflected fraction of the light within the map's directions, in X, Y, Z.
    pub albedo: [f64; 3],
    /// Number of evaluated densities.
    pub densities: f64,
}

impl Options {
    fn views(&self) -> Views {
        Views { size: self.size, center: self.center, half: 1.0 / self.zoom }
    }

    fn scale(&self) -> Scale {
        Scale {
            pixel_um: self.pixel_um,
            range_um: self.range_um,
            channel: self.channel.clone(),
            fill_gaps: self.fill_gaps,
        }
    }
}

impl Operation for Options {
    const NAME: &'static str = "brdf";
    const TITLE: &'static str = "Picture of the light that a height field diffracts into all directions";
    const INPUT: Input = Input::Files;
    type Report = Report<MapReport>;

    fn check(&self, input: &Path) -> Result<Work> {
        self.settings.check()?;
        self.views().check()?;
        self.scale().check()?;
        // Files other than images hold at most 16 Mpixel.
        budget::Operation::Heights.check_file(&file(input)?)
    }

    /// Makes a map of the height field `input`, or of the only one in this folder: `brdf.exr` and `brdf.png`, and as a
    /// figure with axes: `figure.svg` and `figure.png`.
    fn run(&self, input: &Path, out: &OutputFolder, progress: &dyn Progress) -> Result<Report<MapReport>> {
        let path = file(input)?;
        let (map, report) = self.map(&path, progress)?;
        write_map(&out.path("brdf.exr"), &map, &self.settings)?;
        write_picture(&out.path("brdf.png"), &map)?;
        write_figure([&out.path("figure.svg"), &out.path("figure.png")], &map, &self.settings)?;
        Ok(Report {
            input: path.file_name().map(PathBuf::from).unwrap_or_default(),
            files: ["brdf.exr", "brdf.png", "figure.svg", "figure.png"].map(PathBuf::from).into(),
            ..report
        })
    }

    fn missed(&self, report: &Report<MapReport>) -> Option<String> {
        let (error, wanted) = (report.error_estimate, self.settings.max_error);
        (error > wanted).then(|| format!("the error may be {error:.2e}, more than the {wanted} asked for"))
    }
}

impl Options {
    /// Computes the map of a height field, and its report without file names.
    ///
    /// # Errors
    /// `Input` for a file that is not a height field, and for invalid options.
    pub fn map(&self, height: &Path, progress: &dyn Progress) -> Result<(Map, Report<MapReport>)> {
        let begun = Instant::now();
        progress.stage("reading", 1);
        let field = read(height, &self.scale())?;
        let field: HeightField = if self.level { field.levelled() } else { field };
        let settings = &self.settings;
        let (_, window) = settings.check()?;
        let quality = Quality::of(&field, settings.coherence_um);
        progress.check()?;
        let map = map(&field, &quality, settings, self.views(), progress)?;
        let (more, warnings) = about_map(&map, &quality, window);
        let report = Report {
            product: "map",
            warnings,
            input: height.into(),
            quality,
            settings: settings.clone(),
            choice: map.choice.clone(),
            error_estimate: map.error_estimate,
            more,
            seconds: begun.elapsed().as_secs_f64(),
            files: vec![],
        };
        Ok((map, report))
    }
}

impl Summary for Report<MapReport> {
    fn summary(&self) -> String {
        let [x, y, z] = self.more.albedo;
        self.lines(&format!("light     X {x:.3} Y {y:.3} Z {z:.3} of what falls in"))
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }
}

/// Height field: the input, `height.exr` in it, or the only file in it that can be one.
fn file(input: &Path) -> Result<PathBuf> {
    if !input.is_dir() {
        return Ok(input.to_owned());
    }
    let named = input.join("height.exr");
    if named.is_file() {
        return Ok(named);
    }
    let cannot = |e: std::io::Error| Error::file(input, format!("cannot be read: {e}"), "check the path");
    let all = std::fs::read_dir(input).map_err(cannot)?.flatten().map(|entry| entry.path());
    let known = |path: &PathBuf| {
        let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        path.is_file() && ending.is_some_and(|e| EXTENSIONS.contains(&e.as_str()))
    };
    match all.filter(known).take(2).collect::<Vec<_>>().as_slice() {
        [only] => Ok(only.clone()),
        found => {
            let problem =
                if found.is_empty() { "holds no height field" } else { "holds several files that may be one" };
            Err(Error::file(input, problem, format!("give one {} file", EXTENSIONS.join(", "))))
        }
    }
}

/// Report fields of a map, and warnings about its pixels and the limits of scalar theory.
fn about_map(map: &Map, quality: &Quality, window: Window) -> (MapReport, Vec<String>) {
    let about = MapReport { width: map.size, albedo: albedo(map), densities: map.densities };
    let needed = needed_size(window.sigma, map.views);
    let mut warnings = quality.warnings.clone();
    if map.size < needed {
        warnings.push(format!(
            "lobes are narrower than the map's pixels, which hold the light of their middles only: a size of {needed} shows all"
        ));
    } else if about.albedo[1] > 1.02 {
        warnings.push(format!(
            "scalar theory reflects {:.2} times the light here: its gain overestimates grazing directions",
            about.albedo[1]
        ));
    }
    (about, warnings)
}
