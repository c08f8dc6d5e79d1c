//! The photograph: a file, merged exposures, or exposures that are merged first.

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

/// What is known of a photograph.
pub(super) struct Input {
    /// The channels that are wanted.
    pub channels: Vec<Photograph>,
    /// Settings with what the photograph's `frames.json` says.
    pub settings: Settings,
    /// Width of the filter's band in nm.
    pub band_nm: Option<f64>,
    /// How exposures were merged.
    pub merged: Option<hdr::Report>,
    /// Warnings about the photographs' files.
    pub warnings: Vec<String>,
}

/// All channels of a photograph by name.
struct Channels {
    path: PathBuf,
    width: usize,
    height: usize,
    planes: Vec<(String, Vec<f32>)>,
}

/// Whether there is something to make a table of, without a look at any pixel.
///
/// # Errors
/// As [`reconstruct`](super::reconstruct) for settings and files that make no sense.
pub(super) fn check_input(input: &Path, settings: &Settings) -> Result<Work> {
    settings.check()?;
    let operation = Operation::Table(settings.size * settings.size);
    let mut work = Source::check(input, operation)?;
    if let Some(light) = &settings.light {
        work = work.preceded_by(&Source::check(&light.path, operation)?);
    }
    with_frames(input, settings).and_then(|(settings, _)| settings.bands().map(|_| work))
}

/// Reads what the settings want of an input.
///
/// # Errors
/// `Input` for anything about the photograph.
pub(super) fn photograph(input: &Path, settings: &Settings, progress: &dyn Progress) -> Result<Input> {
    let (settings, band_nm) = with_frames(input, settings)?;
    let source = Source::find(input, progress)?;
    let channels = channels(&source.path, settings.transfer)?;
    let channels = if source.merged.is_some() { Channels { path: input.to_owned(), ..channels } } else { channels };
    let channels = channels.wanted(&settings)?;
    let warnings = source.warnings(settings.transfer.unwrap_or(Transfer::Linear));
    Ok(Input { channels, settings, band_nm, merged: source.merged, warnings })
}

/// The light of a photograph, and warnings about its file; `scale` is that of the pattern's photograph.
///
/// # Errors
/// `Input` for anything about the photograph.
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

/// An error about the photograph of a light, with its file.
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

/// Settings, completed by what `frames.json` says, and the filter's band.
fn with_frames(input: &Path, settings: &Settings) -> Result<(Settings, Option<f64>)> {
    // Photographs, and folders of them without one, say nothing.
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

/// Of a file of codes. The highest code is saturated.
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
    /// The channels that the settings want, in their order.
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
