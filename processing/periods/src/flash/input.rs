//! Input of the flash reconstruction, available before pixels are read.

use super::photographs::{Groups, groups};
use super::settings::Settings;
use nacre_base::estimate::Work;
use nacre_base::{Error, Result};
use nacre_frames::{LoadedFrames, load};
use nacre_image::budget::Operation;
use nacre_optics::geometry::{self, Camera, Geometry, Pose};
use std::path::Path;

/// Validates input and options without reading pixels, and predicts the work.
///
/// # Errors
/// As [`reconstruct`](super::reconstruct) for invalid options and sets.
pub(super) fn check_input(input: &Path, settings: &Settings) -> Result<Work> {
    settings.check()?;
    let frames = load(input)?;
    let work = work(&frames)?;
    let settings = completed(settings, &frames)?;
    let groups = groups(&frames)?;
    known_lights(&groups, &settings, &frames)?;
    wavelength(&settings, &frames)?;
    if settings.reference_px.is_none() && settings.size_mm.is_none() {
        let remedy = "give width and height of the sheet in mm, or --reference-px";
        return Err(Error::input("--size-mm", "is not known", remedy));
    }
    Ok(work)
}

/// Predicts the work from the header of the first photograph.
///
/// # Errors
/// `Input`, naming the photograph, if memory does not suffice.
pub(super) fn work(frames: &LoadedFrames) -> Result<Work> {
    let count = frames.set.frames.len();
    let first = frames.set.frames.first().map_or(frames.path.clone(), |first| frames.file(&first.file));
    Operation::Flash(count).check(&first, frames.info)
}

/// Options with the geometry beside the photographs, or that of the bench, unless one is given.
///
/// # Errors
/// `Input` for an unreadable geometry.
pub(super) fn completed(settings: &Settings, frames: &LoadedFrames) -> Result<Settings> {
    if settings.geometry.is_some() || settings.camera_mm.is_some() || settings.corners_px.is_some() {
        return Ok(settings.clone());
    }
    let geometry = geometry::beside(&frames.folder)?.or_else(|| of_bench(frames));
    Ok(Settings { geometry, ..settings.clone() })
}

/// Geometry from `frames.json`: the camera looks straight down on the picture's centre or beside it, with the light at
/// its height.
fn of_bench(frames: &LoadedFrames) -> Option<Geometry> {
    let bench = frames.set.geometry?;
    let pixel_mm = bench.pixel_um? / 1000.0;
    let middle = [frames.info.width, frames.info.height].map(|n| 0.5 * (n as f64 - 1.0));
    let center_px = bench.camera_px.unwrap_or([middle[0] - 0.5 * bench.baseline_mm / pixel_mm, middle[1]]);
    let [x, y] = [(center_px[0] - middle[0]) * pixel_mm, (middle[1] - center_px[1]) * pixel_mm];
    let camera = Camera { focal_px: [bench.distance_mm / pixel_mm; 2], center_px, distortion: [0.0; 5] };
    let rotation = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]];
    let sample = Pose { rotation, translation_mm: [-x, y, bench.distance_mm] };
    let light_mm = Some([x + bench.baseline_mm, y, bench.distance_mm]);
    Some(Geometry { light_mm, ..Geometry::new(camera, sample) })
}

/// Wavelength of the options, the set, or the geometry, in this order.
pub(super) fn wavelength(settings: &Settings, frames: &LoadedFrames) -> Result<f64> {
    let of_geometry = settings.geometry.as_ref().and_then(|g| g.wavelength_nm);
    settings.wavelength_nm.or(frames.set.wavelength_nm).or(of_geometry).ok_or_else(|| {
        Error::input("--wavelength-nm", "is not known", "give that of the filter, or write it into frames.json")
    })
}

/// Known positions of lights; rejects lights whose position cannot be determined.
pub(super) fn known_lights(
    groups: &Groups,
    settings: &Settings,
    frames: &LoadedFrames,
) -> Result<Vec<Option<[f64; 3]>>> {
    let one = settings.geometry.as_ref().and_then(|g| g.light_mm).filter(|_| groups.lights.len() == 1);
    let lights: Vec<Option<[f64; 3]>> = groups.lights.iter().map(|g| g.light_mm.or(one)).collect();
    if settings.light_height_mm.is_some() {
        return Ok(vec![None; lights.len()]);
    }
    if lights.contains(&None) {
        let problem = "does not say where the flash was (light_mm of its frames)";
        return Err(Error::file(
            &frames.path,
            problem,
            "add it, or give --light-height-mm: the highlight tells the rest",
        ));
    }
    Ok(lights)
}
