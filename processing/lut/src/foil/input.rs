//! Input photograph of a foil.

use super::measure::Light;
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use nacre_frames::hdr::{Source, is_bracket};
use nacre_frames::{Channel, FILE_NAME, Transfer, load};
use nacre_image::{Depth, read_exr};
use nacre_optics::geometry::Geometry;
use std::path::Path;

/// Reads linear light.
///
/// # Errors
/// `Input` unless the file is a photograph in linear light with the size of the geometry.
pub(super) fn read_light(path: &Path, channel: Channel) -> Result<Light> {
    let exr = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"));
    if exr {
        let mut map = read_exr(path)?;
        let values = map.take("Y", path).or_else(|_| map.take(channel.letter(), path))?;
        return Ok(Light { width: map.width, height: map.height, values });
    }
    let raster = nacre_image::read(path)?;
    if raster.info().depth == Depth::U8 {
        let remedy = "merge exposures first (nacre reconstruct hdr), or give 16 bits of linear light";
        return Err(Error::file(path, "has 8 bits, whose values seldom grow in proportion with light", remedy));
    }
    let (n, c) = (raster.channels, if raster.channels == 1 { 0 } else { channel as usize });
    let values =
        (0..raster.width * raster.height).map(|p| Transfer::Linear.light(&raster.samples, p * n + c)).collect();
    Ok(Light { width: raster.width, height: raster.height, values })
}

/// Reads the photograph at `input`, after merging exposures if necessary. Also returns warnings about the photographs'
/// files.
///
/// # Errors
/// `Input`; `Cancelled`.
pub(super) fn read(input: &Path, geometry: &Geometry, progress: &dyn Progress) -> Result<(Light, Vec<String>)> {
    let of_frames = if is_bracket(input) && (input.is_file() || input.join(FILE_NAME).is_file()) {
        load(input)?.set.wavelength_nm
    } else {
        None
    };
    let nm = geometry.wavelength_nm.or(of_frames).unwrap_or(530.0);
    let source = Source::find(input, progress)?;
    let light = read_light(&source.path, Channel::nearest(nm))?;
    let size = [light.width as u32, light.height as u32];
    if let Some(known) = geometry.image_px.filter(|known| *known != size) {
        let problem =
            format!("is {} x {} pixels, and the geometry is for {} x {}", size[0], size[1], known[0], known[1]);
        return Err(Error::file(
            input,
            problem,
            "take it with the camera that was calibrated, neither cropped nor scaled",
        ));
    }
    Ok((light, source.warnings(Transfer::Linear)))
}
