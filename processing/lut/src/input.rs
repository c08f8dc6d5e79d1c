//! Input photograph: a file, merged exposures, or a series of exposures to merge.

use super::geometry::{Arrangement, Placement};
use super::light::Light;
use super::photograph::Photograph;
use super::settings::{LightPhotograph, Settings, Wavelength};
use nacre_base::estimate::Work;
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use nacre_frames::hdr::{self, Source, is_bracket};
use nacre_frames::{Channel, FILE_NAME, Transfer, load};
use nacre_image::budget::Operation;
use nacre_image::{Depth, read, read_exr};
use std::path::{Path, PathBuf};

/// A photograph with its metadata.
pub(super) struct Input {
    /// Selected channels.
    pub channels: Vec<Photograph>,
    /// Options completed with the photograph's `frames.json`.
    pub settings: Settings,
    /// Bandwidth of the filter in nm.
    pub band_nm: Option<f64>,
    /// Report on merging the exposures.
    pub merged: Option<hdr::Report>,
    /// Warnings about the photographs' files.
    pub warnings: Vec<String>,
}

/// All channels of a photograph, by name.
struct Channels {
    path: PathBuf,
    width: usize,
    height: usize,
    planes: Vec<(String, Vec<f32>)>,
}

/// Validates input and options without reading pixels, and predicts the work.
///
/// # Errors
/// As [`reconstruct`](super::reconstruct) for invalid options and files.
pub(super) fn check_input(input: &Path, settings: &Settings) -> Result<Work> {
    settings.check()?;
    let operation = Operation::Table(settings.size * settings.size);
    let mut work = Source::check(input, operation)?;
    if let Some(light) = &settings.light {
        work = work.preceded_by(&Source::check(&light.path, operation)?);
    }
    with_frames(input, settings).and_then(|(settings, _)| settings.bands().map(|_| work))
}

/// Reads the channels that the options select.
///
/// # Errors
/// `Input` for an invalid photograph.
pub(super) fn photograph(input: &Path, settings: &Settings, progress: &dyn Progress) -> Result<Input> {
    let (settings, band_nm) = with_frames(input, settings)?;
    let source = Source::find(input, progress)?;
    let channels = channels(&source.path, settings.transfer)?;
    let channels = if source.merged.is_some() { Channels { path: input.to_owned(), ..channels } } else { channels };
    let channels = channels.wanted(&settings)?;
    let warnings = source.warnings(settings.transfer.unwrap_or(Transfer::Linear));
    Ok(Input { channels, settings, band_nm, merged: source.merged, warnings })
}

/// Reads the photograph of a light, with warnings about its file; `scale` is that of the pattern's photograph.
///
/// # Errors
/// `Input` for an invalid photograph.
pub(super) fn light(
    photograph: &LightPhotograph,
    settings: &Settings,
    scale: f64,
    progress: &dyn Progress,
) -> Result<(Light, Vec<String>)> {
    let source = Source::find(&photograph.path, progress)?;
    let transfer = photograph.transfer.or(settings.transfer);
    let all = channels(&source.path, transfer)?;
    let gray = all.planes.iter().position(|(name, _)| name == "Y");
    let planes = match gray {
        Some(k) => vec![all.planes[k].1.clone()],
        None => {
            ["R", "G", "B"].iter().filter_map(|c| Some(all.planes.iter().find(|(n, _)| n == c)?.1.clone())).collect()
        }
    };
    let light = Light::cut_out(&planes, all.width, photograph.center, photograph.scale.unwrap_or(scale))
        .map_err(|e| named(&photograph.path, e))?;
    Ok((light, source.warnings(transfer.unwrap_or(Transfer::Linear))))
}

/// Attaches the file name to an error about the photograph of a light.
pub(super) fn named(path: &Path, error: Error) -> Error {
    match error {
        Error::Input { problem, remedy, .. } => Error::file(path, problem, remedy),
        other => other,
    }
}

fn channels(path: &Path, transfer: Option<Transfer>) -> Result<Channels> {
    let exr = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"));
    if exr { of_exr(path) } else { of_raster(path, transfer) }
}

/// Options completed from `frames.json`, and the bandwidth of the filter in nm.
fn with_frames(input: &Path, settings: &Settings) -> Result<(Settings, Option<f64>)> {
    // A photograph, or a folder without `frames.json`, has no metadata.
    if !is_bracket(input) || input.is_dir() && !input.join(FILE_NAME).is_file() {
        return Ok((settings.clone(), None));
    }
    let set = load(input)?.set;
    let wavelength_nm = settings.wavelength_nm.or(set.wavelength_nm.map(Wavelength::Band));
    let of_frames = set.geometry.filter(|_| settings.scale.is_none()).and_then(|g| {
        let pixel_um = g.pixel_um?;
        let baseline_mm = [g.baseline_mm, 0.0];
        let (camera_mm, flash_mm) = (g.distance_mm, g.distance_mm);
        Some(Placement::Arranged(Arrangement { camera_mm, flash_mm, baseline_mm, pixel_um }))
    });
    let geometry = settings.geometry.clone().or(of_frames);
    Ok((Settings { wavelength_nm, geometry, ..settings.clone() }, set.band_nm))
}

fn of_exr(path: &Path) -> Result<Channels> {
    let map = read_exr(path)?;
    Ok(Channels {
        path: path.to_owned(),
        width: map.width,
        height: map.height,
        planes: map.channels.into_iter().collect(),
    })
}

/// Channels of an integer-coded file; the highest code counts as saturated.
fn of_raster(path: &Path, transfer: Option<Transfer>) -> Result<Channels> {
    let raster = read(path)?;
    if raster.info().depth == Depth::U8 && transfer.is_none() {
        let remedy = "say --transfer linear, srgb or gamma=2.2; better, merge exposures (nacre reconstruct hdr)";
        return Err(Error::file(path, "has 8 bits, whose values seldom grow in proportion with light", remedy));
    }
    let transfer = transfer.unwrap_or(Transfer::Linear);
    let n = raster.channels;
    let names: &[&str] = if n == 1 { &["Y"] } else { &["R", "G", "B"] };
    let plane =
        |c: usize| (0..raster.width * raster.height).map(|p| transfer.light(&raster.samples, p * n + c)).collect();
    let planes = names.iter().enumerate().map(|(c, name)| ((*name).to_owned(), plane(c))).collect();
    Ok(Channels { path: path.to_owned(), width: raster.width, height: raster.height, planes })
}

impl Channels {
    /// The channels selected by the options, in their order.
    fn wanted(mut self, settings: &Settings) -> Result<Vec<Photograph>> {
        let mut take = |name: &str| -> Result<Photograph> {
            let Some(at) = self.planes.iter().position(|(n, _)| n == name) else {
                let names: Vec<&str> = self.planes.iter().map(|(n, _)| n.as_str()).collect();
                let problem = format!("has no channel {name}, but {}", names.join(" "));
                return Err(Error::file(&self.path, problem, "give a photograph with R G B or Y"));
            };
            let light = self.planes.swap_remove(at).1;
            Ok(Photograph { light, width: self.width, height: self.height })
        };
        match settings.bands()? {
            Wavelength::Channels(_) => ["R", "G", "B"].into_iter().map(take).collect(),
            Wavelength::Band(nm) => {
                let of_color = settings.channel.unwrap_or_else(|| Channel::nearest(nm));
                take("Y").or_else(|_| take(of_color.letter())).map(|p| vec![p])
            }
        }
    }
}
