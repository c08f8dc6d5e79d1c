//! Output files: maps with pictures, tables, reports. All are written atomically.

use super::brdf::{Map, Slice, Views};
use super::check::GratingCheck;
use super::figure::figure;
use super::height::HeightField;
use super::peaks::peaks_picture;
use super::settings::{Normalisation, Settings};
use nacre_base::{Error, Result};
use nacre_image::{Attribute, encode_png8, scalar_picture, write_exr, write_whole, write_whole_with};
use nacre_optics::color::displayed_codes;
use nacre_plot::png_from_svg;
use std::fmt::Write;
use std::path::Path;

/// Colour of directions below the surface, and reference brightness of the picture relative to white before
/// compression.
const BELOW: [u8; 3] = [58, 58, 66];
const KEY: f32 = 0.6;

/// Pixels of a figure per unit of its page.
const FIGURE_ZOOM: f32 = 2.0;

/// Largest number of rows of a table.
const MOST_ROWS: usize = 20_000_000;

/// Writes a map as an EXR (X, Y, Z).
///
/// # Errors
/// `Output` if the system refuses.
pub fn write_map(path: &Path, map: &Map, settings: &Settings) -> Result<()> {
    let units = match settings.normalisation {
        Normalisation::Brdf => "X Y Z of the BRDF in 1/sr; a BRDF of 1 at all wavelengths has Y = 1",
        Normalisation::Relative => "X Y Z of the reflectance relative to a flat mirror's in its mirror direction",
    };
    let attributes = [
        ("units", Attribute::Text(units.into())),
        ("mapping", Attribute::Text("(x, y) = sin θ (cos φ, sin φ), y up; NaN below the surface".into())),
        ("center_x", Attribute::Number(map.views.center[0])),
        ("center_y", Attribute::Number(map.views.center[1])),
        ("half_side", Attribute::Number(map.views.half)),
        ("light_theta_deg", Attribute::Number(settings.light_deg[0])),
        ("light_phi_deg", Attribute::Number(settings.light_deg[1])),
        ("illuminant", Attribute::Text(settings.illuminant.clone())),
        ("coherence_um", Attribute::Number(settings.coherence_um)),
        ("error_estimate", Attribute::Number(map.error_estimate)),
    ];
    write_whole_with(path, |file| {
        write_exr(file, map.size, map.size, &["X", "Y", "Z"], &attributes, &|c, y, row| {
            row.iter_mut().enumerate().for_each(|(x, out)| *out = map.xyz[y * map.size + x][c]);
        })
    })
}

/// Writes a map as a picture (sRGB, PNG). The exposure puts the 90th percentile of lit directions at 0.6 of white;
/// brighter values are compressed.
///
/// # Errors
/// `Output` if the system refuses.
pub fn write_picture(path: &Path, map: &Map) -> Result<()> {
    let encoded = encode_png8(map.size, map.size, 3, &codes(map)).map_err(|e| Error::output(path, e))?;
    write_whole(path, &encoded)
}

/// Writes a map as a figure with rings of equal angle, axes and a colour bar, as SVG and PNG.
///
/// # Errors
/// `Output` if the system refuses.
pub fn write_figure([svg, png]: [&Path; 2], map: &Map, settings: &Settings) -> Result<()> {
    let text = figure(map, settings)?;
    write_whole(svg, text.as_bytes())?;
    write_whole(png, &png_from_svg(&text, FIGURE_ZOOM)?)
}

/// sRGB codes of a map.
pub(crate) fn codes(map: &Map) -> Vec<u8> {
    let mut light: Vec<f32> = map.xyz.iter().map(|v| v[1]).filter(|y| *y > 0.0).collect();
    light.sort_by(f32::total_cmp);
    // The mirror direction outshines all orders, so the exposure follows from the distribution of the light.
    let most = light.last().copied().unwrap_or(1.0);
    let shining: Vec<f32> = light.iter().copied().filter(|y| *y > 1e-5 * most).collect();
    let scale = KEY / shining.get(shining.len() * 9 / 10).map_or(1.0, |y| y.max(f32::MIN_POSITIVE));
    let mut bytes = Vec::with_capacity(3 * map.xyz.len());
    for xyz in &map.xyz {
        bytes.extend(if xyz[1].is_nan() { BELOW } else { displayed_codes(xyz.map(|v| v * scale)) });
    }
    bytes
}

/// Size of a map whose pixels resolve the lobes. A lobe of the coherence window has the standard deviation λσ, smallest
/// at 380 nm.
pub fn needed_size(sigma: f64, views: Views) -> usize {
    // One pixel per standard deviation separates lobes and loses none; two would be ample.
    (views.half / (0.38 * sigma)).ceil() as usize
}

/// Reflected light within a map, `∫ f cos θ dω`, in X, Y, Z; for all directions, the albedo in the illuminant's
/// colours.
pub fn albedo(map: &Map) -> [f64; 3] {
    let area = (2.0 * map.views.half / map.size as f64).powi(2);
    let mut sum = [0.0; 3];
    for (k, xyz) in map.xyz.iter().enumerate() {
        if map.views.direction(k % map.size, k / map.size).is_some() {
            sum.iter_mut().zip(xyz).for_each(|(s, v)| *s += f64::from(*v) * area);
        }
    }
    sum
}

/// Writes a slice as a table: `wavelength_nm,theta_r_deg,reflectance`.
///
/// # Errors
/// `Input` for too many rows; `Output` if the system refuses.
pub fn write_slice(path: &Path, slice: &Slice) -> Result<()> {
    check_rows(slice.values.len())?;
    let mut csv = String::from("wavelength_nm,theta_r_deg,reflectance\n");
    for (nm, row) in slice.wavelengths_nm.iter().zip(slice.values.chunks(slice.theta_deg.len())) {
        for (theta, value) in slice.theta_deg.iter().zip(row) {
            let _ = writeln!(csv, "{nm},{theta},{value:e}");
        }
    }
    write_whole(path, csv.as_bytes())
}

/// Checks the number of rows of a table.
///
/// # Errors
/// `Input` for more than 20 million rows.
pub fn check_rows(rows: usize) -> Result<()> {
    if rows > MOST_ROWS {
        let problem = format!("has {rows} rows");
        return Err(Error::input(
            "table",
            problem,
            format!("ask for at most {MOST_ROWS}: larger steps, or less range"),
        ));
    }
    Ok(())
}

/// Writes the peaks of a check as a table: `wavelength_nm,theta_r_deg,period_nm,relative`.
///
/// # Errors
/// `Output` if the system refuses.
pub fn write_check(path: &Path, check: &GratingCheck) -> Result<()> {
    let mut csv = String::from("wavelength_nm,theta_r_deg,period_nm,relative\n");
    for p in &check.peaks {
        let _ = writeln!(csv, "{},{:.6},{:.4},{:e}", p.wavelength_nm, p.theta_r_deg, p.period_nm, p.relative);
    }
    write_whole(path, csv.as_bytes())
}

/// Writes a picture (SVG) of the peaks of a check with the grating equation.
///
/// # Errors
/// `Output` if the system refuses.
pub fn write_check_picture(path: &Path, check: &GratingCheck) -> Result<()> {
    write_whole(path, peaks_picture(check).as_bytes())
}

/// Writes a height field as an EXR map (`height` in µm, attribute `pixel_um`), and as a picture if a path is given,
/// optionally with a scale bar.
///
/// # Errors
/// `Output` if the system refuses.
pub fn write_height(path: &Path, picture: Option<(&Path, bool)>, field: &HeightField) -> Result<()> {
    let attributes = [("units", Attribute::Text("µm".into())), ("pixel_um", Attribute::Number(field.pixel_um))];
    let (w, h) = (field.width, field.height);
    write_whole_with(path, |file| {
        write_exr(file, w, h, &["height"], &attributes, &|_, y, row| {
            row.iter_mut().zip(&field.um[y * w..]).for_each(|(to, from)| *to = *from as f32);
        })
    })?;
    let Some((picture, scale_bar)) = picture else { return Ok(()) };
    let [low, high] = field.ends_um();
    let value = |x: usize, y: usize| Some(field.um[y * w + x] as f32);
    let bar_um = scale_bar.then_some(field.pixel_um);
    let canvas = scalar_picture([w, h], &value, [low as f32, high as f32], "height (µm)", "Height field", bar_um);
    let encoded = encode_png8(canvas.width, canvas.height, 3, &canvas.rgb).map_err(|e| Error::output(picture, e))?;
    write_whole(picture, &encoded)
}
