//! Maps and pictures of a result folder.

use super::{OrientationMaps, StokesMaps};
use crate::Result;
use crate::frames::LoadedFrames;
use crate::image::{Attribute, OutputFolder, orientation_picture, scalar_picture, write_exr};
use crate::progress::Progress;

/// Writes `stokes.exr`, `aolp.exr`, `orientation.exr` and the pictures.
pub(super) fn write_maps(
    folder: &OutputFolder,
    frames: &LoadedFrames,
    maps: &StokesMaps,
    map: &OrientationMaps,
    progress: &dyn Progress,
) -> Result<()> {
    progress.stage("writing maps", 6);
    write_exrs(folder, frames, maps, map, progress)?;
    write_pictures(folder, maps, map, progress)
}

fn write_exrs(
    folder: &OutputFolder,
    frames: &LoadedFrames,
    maps: &StokesMaps,
    map: &OrientationMaps,
    progress: &dyn Progress,
) -> Result<()> {
    let (width, height) = (maps.width, maps.height);
    let mut attributes = vec![];
    if let Some(pixel) = frames.set.geometry.and_then(|g| g.pixel_um) {
        let block = frames.info.width / width;
        attributes.push(("pixel_um", Attribute::Number(pixel * block as f64)));
    }
    if let Some(wavelength) = frames.set.wavelength_nm {
        attributes.push(("wavelength_nm", Attribute::Number(wavelength)));
    }
    let with_units = |units: &str| {
        let mut all = attributes.clone();
        all.push(("units", Attribute::Text(units.into())));
        all
    };
    let copy = |plane: &[f32], y: usize, row: &mut [f32]| row.copy_from_slice(&plane[y * width..][..width]);

    let units = with_units("linear value / (exposure s * gain)");
    write_exr(&folder.path("stokes.exr"), width, height, &["S0", "S1", "S2"], &units, &|c, y, row| {
        copy([&maps.s0, &maps.s1, &maps.s2][c], y, row);
    })?;
    progress.step();
    progress.check()?;
    let units = with_units("aolp: rad; dolp: 0 to 1");
    write_exr(&folder.path("aolp.exr"), width, height, &["aolp", "dolp"], &units, &|c, y, row| {
        for (x, out) in row.iter_mut().enumerate() {
            let i = y * width + x;
            *out = if c == 0 { aolp(maps, i) } else { dolp(maps, i) };
        }
    })?;
    progress.step();
    progress.check()?;
    let units = with_units("orientation, sigma: rad; mask: 1 measured, 0 masked; correlation: 0 to 1");
    let channels = ["orientation", "sigma", "mask", "correlation"];
    write_exr(&folder.path("orientation.exr"), width, height, &channels, &units, &|c, y, row| match c {
        0 => copy(&map.orientation, y, row),
        1 => copy(&map.sigma, y, row),
        2 => {
            row.iter_mut().zip(&map.orientation[y * width..]).for_each(|(m, t)| *m = f32::from(u8::from(t.is_finite())))
        }
        _ => copy(&maps.correlation, y, row),
    })?;
    progress.step();
    progress.check()
}

fn write_pictures(
    folder: &OutputFolder,
    maps: &StokesMaps,
    map: &OrientationMaps,
    progress: &dyn Progress,
) -> Result<()> {
    let (width, height) = (maps.width, maps.height);
    let orientation = |x: usize, y: usize| Some(map.orientation[y * width + x]).filter(|t| t.is_finite());
    orientation_picture(width, height, &orientation, "Orientation").save_png(&folder.path("orientation.png"))?;
    progress.step();
    progress.check()?;
    // Up to the mask's limit of 1/8 rad, on a scale that the bulk of the pixels fills.
    let sigma = |x: usize, y: usize| {
        let i = y * width + x;
        map.orientation[i].is_finite().then(|| map.sigma[i].to_degrees())
    };
    let top = top_of_scale(width, height, &sigma);
    scalar_picture(width, height, &sigma, 0.0, top, "σ (°)", "Uncertainty").save_png(&folder.path("sigma.png"))?;
    progress.step();
    let dolp = |x: usize, y: usize| Some(dolp(maps, y * width + x)).filter(|d| d.is_finite());
    let top = top_of_scale(width, height, &dolp).min(1.0);
    scalar_picture(width, height, &dolp, 0.0, top, "DoLP", "Degree of linear polarization")
        .save_png(&folder.path("dolp.png"))?;
    progress.step();
    Ok(())
}

/// The 98th percentile of about 10,000 pixels, rounded up to 1, 2 or 5 in its last digit.
fn top_of_scale(width: usize, height: usize, value: &dyn Fn(usize, usize) -> Option<f32>) -> f32 {
    let stride = (width * height / 10_000).max(1);
    let mut values: Vec<f32> =
        (0..width * height).step_by(stride).filter_map(|i| value(i % width, i / width)).collect();
    values.sort_by(f32::total_cmp);
    let top = values.get(values.len() * 98 / 100).copied().unwrap_or(1.0).max(1e-6);
    let digit = 10_f32.powf(top.log10().floor());
    [1.0, 2.0, 5.0, 10.0].map(|k| k * digit).into_iter().find(|&t| t >= top).unwrap_or(top)
}

fn aolp(maps: &StokesMaps, i: usize) -> f32 {
    let angle = (0.5 * maps.s2[i].atan2(maps.s1[i])).rem_euclid(std::f32::consts::PI);
    if angle >= std::f32::consts::PI { 0.0 } else { angle }
}

fn dolp(maps: &StokesMaps, i: usize) -> f32 {
    if maps.s0[i] > 0.0 {
        maps.s1[i].hypot(maps.s2[i]) / maps.s0[i]
    } else if maps.s0[i].is_nan() {
        f32::NAN
    } else {
        0.0
    }
}
