//! Height fields from grey images and EXR maps.

use super::read::Scale;
use super::stored::{Pitch, pixel_um};
use super::{HeightField, check_size, gaps};
use nacre_base::{Error, Result};
use nacre_image::{Depth, Raster, Samples};
use std::path::Path;

/// Reads a grey image: PNG, JPEG, BMP.
pub(super) fn read(path: &Path, scale: &Scale) -> Result<HeightField> {
    with_pitch(path, scale, Pitch::Unknown)
}

/// Reads a grey image whose file states this pitch.
pub(super) fn with_pitch(path: &Path, scale: &Scale, pitch: Pitch) -> Result<HeightField> {
    let info = nacre_image::info(path)?;
    check_size(&path.display().to_string(), info.width, info.height)?;
    let pixel_um = pixel_um(path, scale, pitch)?;
    let range = scale.range_um.ok_or_else(|| {
        Error::file(path, "does not say how high white is above black", "give this height with --range-um")
    })?;
    let raster = nacre_image::read(path)?;
    let full = f64::from(info.depth.full_scale());
    let um = grey(path, &raster)?.into_iter().map(|v| v / full * range).collect();
    let subject = path.display().to_string();
    let (width, height, um, resampled) = pitch.squared(&subject, [info.width, info.height], um)?;
    let mut field = HeightField::new(&subject, width, height, pixel_um, um)?;
    field.step_um = (info.depth != Depth::F32).then_some(range / full);
    field.notes.extend(resampled);
    Ok(field)
}

/// Values of a grey image, which may be stored as RGB.
fn grey(path: &Path, raster: &Raster) -> Result<Vec<f64>> {
    let values: Vec<f64> = match &raster.samples {
        Samples::U8(v) => v.iter().map(|v| f64::from(*v)).collect(),
        Samples::U16(v) => v.iter().map(|v| f64::from(*v)).collect(),
        Samples::F32(v) => v.iter().map(|v| f64::from(*v)).collect(),
    };
    if raster.channels == 1 {
        return Ok(values);
    }
    let full = f64::from(raster.info().depth.full_scale());
    let colored = |rgb: &[f64]| (rgb[0] - rgb[1]).abs().max((rgb[1] - rgb[2]).abs()) > 0.02 * full;
    if let Some(at) = values.chunks_exact(3).position(colored) {
        let (x, y) = (at % raster.width, at / raster.width);
        let problem = format!("is coloured (column {x}, row {y}), so no height can be told from it");
        return Err(Error::file(path, problem, "export the heights as grey values, without a colour scale"));
    }
    Ok(values.chunks_exact(3).map(|rgb| rgb.iter().sum::<f64>() / 3.0).collect())
}

/// Reads an EXR map of heights.
pub(super) fn map(path: &Path, scale: &Scale) -> Result<HeightField> {
    let info = nacre_image::info(path)?;
    check_size(&path.display().to_string(), info.width, info.height)?;
    let mut map = nacre_image::read_exr(path)?;
    let name = match map.channels.keys().collect::<Vec<_>>()[..] {
        [only] => only.clone(),
        _ => "height".into(),
    };
    let values = map.take(&name, path)?;
    let number = |name: &str| map.attributes.get(name).and_then(|v| v.parse::<f64>().ok());
    let pitch = number("pixel_um").map_or(Pitch::Unknown, |um| Pitch::Um([um; 2]));
    let pixel_um = pixel_um(path, scale, pitch)?;
    let in_um = map.attributes.get("units").is_some_and(|u| u.starts_with("µm"));
    let factor = match (scale.range_um, in_um) {
        (Some(range), false) => range,
        (None, true) => 1.0,
        (Some(_), true) => {
            return Err(Error::file(path, "already holds heights in µm", "leave out --range-um"));
        }
        (None, false) => {
            let problem = "holds relative heights: its attribute `units` is not µm";
            return Err(Error::file(path, problem, "give the height of the value 1 with --range-um"));
        }
    };
    let mut um: Vec<f64> = values.into_iter().map(|v| f64::from(v) * factor).collect();
    let filled = gaps::fill(path, map.width, &mut um, "are not known (NaN or infinite)", scale)?;
    let mut field = HeightField::new(&path.display().to_string(), map.width, map.height, pixel_um, um)?;
    field.notes.extend(filled);
    Ok(field)
}
