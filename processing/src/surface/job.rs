//! The whole job: a height field to a map, its picture and a report in a new folder.

use super::brdf::{Map, map};
use super::geometry::Window;
use super::height::{HeightField, Quality, Scale, read};
use super::output::{albedo, needed_size, write_map, write_picture};
use super::report::Report;
use super::settings::{SIZES, Settings};
use crate::image::{OutputFolder, photograph_in};
use crate::progress::Progress;
use crate::{Error, Result};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What a map is made of, and how.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MapOptions {
    /// Distance of two pixels of the height field in µm, unless its file says so.
    pub pixel_um: Option<f64>,
    /// Height of white above black in µm, unless the file says so.
    pub range_um: Option<f64>,
    /// Take the plane that fits best away.
    pub level: bool,
    /// Pixels of a row and of a column of the map.
    pub size: usize,
    /// Light, material, accuracy.
    pub settings: Settings,
}

impl Default for MapOptions {
    fn default() -> Self {
        Self { pixel_um: None, range_um: None, level: false, size: 512, settings: Settings::default() }
    }
}

/// What a map's report adds.
#[derive(Serialize)]
pub struct MapReport {
    /// Pixels of a row and of a column.
    pub width: usize,
    /// Light in all directions, over what falls in, in X, Y, Z.
    pub albedo: [f64; 3],
    /// Densities that were summed up.
    pub densities: f64,
}

impl MapOptions {
    /// Refuses what makes no sense, and input that is not there.
    ///
    /// # Errors
    /// `Input`.
    pub fn check(&self, input: &Path) -> Result<()> {
        self.settings.check()?;
        if !SIZES.contains(&self.size) {
            return Err(Error::input("size", format!("is {}", self.size), "give 8 to 4096"));
        }
        self.scale().check()?;
        file(input).map(drop)
    }

    fn scale(&self) -> Scale {
        Scale { pixel_um: self.pixel_um, range_um: self.range_um }
    }
}

/// Makes a map of the height field that `input` is, or is the only one in, in the new folder `out`: `brdf.exr`, `brdf.png` and
/// `report.json`.
///
/// # Errors
/// `Input` for anything about the height field and the options, before anything is written; `Output` when writing fails, after which
/// nothing is left behind; `Cancelled`.
pub fn render(input: &Path, out: &Path, options: &MapOptions, overwrite: bool, progress: &dyn Progress) -> Result<()> {
    let begun = Instant::now();
    options.check(input)?;
    let path = file(input)?;
    let folder = OutputFolder::begin(out, overwrite)?;
    progress.stage("reading", 1);
    let field = read(&path, &options.scale())?;
    let field: HeightField = if options.level { field.levelled() } else { field };
    let settings = &options.settings;
    let (_, window) = settings.check()?;
    let quality = Quality::of(&field, settings.coherence_um);
    progress.check()?;
    let map = map(&field, &quality, settings, options.size, progress)?;
    write_map(&folder.path("brdf.exr"), &map, settings)?;
    write_picture(&folder.path("brdf.png"), &map)?;
    let (more, warnings) = about_map(&map, &quality, window);
    let report = Report {
        product: "map",
        warnings,
        input: path.file_name().map(PathBuf::from).unwrap_or_default(),
        quality: &quality,
        settings,
        choice: &map.choice,
        error_estimate: map.error_estimate,
        more,
        seconds: begun.elapsed().as_secs_f64(),
        files: ["brdf.exr", "brdf.png"].map(PathBuf::from).into(),
    };
    folder.write("report.json", report.json().as_bytes())?;
    folder.commit()?;
    Ok(())
}

/// The height field: the input, `height.exr` in it, or the only image in it.
fn file(input: &Path) -> Result<PathBuf> {
    if !input.is_dir() {
        return Ok(input.to_owned());
    }
    photograph_in(input, "height.exr")
        .ok_or_else(|| Error::file(input, "holds no image, or several", "give one height field"))
}

/// What a map's report adds, and what the reader must know: what its pixels cannot show, and what scalar theory adds.
pub fn about_map(map: &Map, quality: &Quality, window: Window) -> (MapReport, Vec<String>) {
    let about = MapReport { width: map.size, albedo: albedo(map), densities: map.densities };
    let needed = needed_size(window.sigma);
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
