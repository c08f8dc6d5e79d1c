//! Picture files.

use crate::material::{SAMPLES, WELL_SPREAD};
use crate::picture::Picture;
use crate::picture::pixel::Pixel;
use crate::scene::Scene;
use crate::settings::{Method, Settings};
use nacre_base::{Error, Result};
use nacre_image::{Attribute, encode_png8, read_exr, rewrite, write_exr, write_exr_zip, write_whole, write_whole_with};
use nacre_optics::color::{displayed_codes, xyz_of_linear_srgb};
use std::path::Path;

/// Tone mapping: level, relative to white, at which the brightest twentieth of the lit pixels starts.
const KEY: f64 = 0.8;

/// Channels of a saved state; `passes` holds the number of passes of each pixel.
const STATE: [&str; 5] = ["R", "G", "B", "Y", "squares"];

/// Name of a band's channel (Fichet et al. 2021, An OpenEXR layout for spectral images): unpolarised radiance at a
/// wavelength.
fn channel(nm: f64) -> String {
    format!("S0.{}nm", format!("{nm:.6}").replace('.', ","))
}

/// Writes a picture as an EXR: R, G, B (linear sRGB), `error` (standard error of the luminance), and its spectra, if
/// there are any.
///
/// # Errors
/// `Output` if the system refuses.
pub fn write_picture(path: &Path, picture: &Picture) -> Result<()> {
    let mut attributes = vec![
        ("units", Attribute::Text("radiance, linear sRGB (D65 is white, Y of a light's own unit); error of Y".into())),
        ("samples", Attribute::Number(picture.samples() as f64)),
        ("chromaticities", Attribute::SRGB),
    ];
    let width = picture.width;
    let bands: Vec<String> = picture.bands.iter().map(|band| channel(band.nm)).collect();
    if !bands.is_empty() {
        attributes.push(("spectralLayoutVersion", Attribute::Text("1.0".into())));
        attributes.push(("emissiveUnits", Attribute::Text("a.u. per nm, a light of luminance 1 has Y = 1".into())));
    }
    let channels: Vec<&str> = ["R", "G", "B", "error"].into_iter().chain(bands.iter().map(String::as_str)).collect();
    write_whole_with(path, |file| {
        write_exr_zip(file, [width, picture.height], &channels, &attributes, &|c, y, row| {
            if let Some(band) = c.checked_sub(4) {
                row.copy_from_slice(&picture.bands[band].radiance[y * width..(y + 1) * width]);
                return;
            }
            for (out, pixel) in row.iter_mut().zip(&picture.pixels[y * width..]) {
                *out = if c < 3 { pixel.rgb[c] } else { pixel.error() } as f32;
            }
        })
    })
}

/// Exposure of a picture, if none is given.
pub fn exposure(picture: &Picture) -> f64 {
    let mut light: Vec<f64> = picture.pixels.iter().map(|p| p.luminance).filter(|y| *y > 0.0).collect();
    light.sort_by(f64::total_cmp);
    let most = light.last().copied().unwrap_or(1.0);
    // The mirror direction outshines all other directions, and nearly dark pixels are ignored.
    let lit: Vec<f64> = light.into_iter().filter(|y| *y > 1e-4 * most).collect();
    KEY / lit.get(lit.len() * 19 / 20).map_or(1.0, |y| y.max(f64::MIN_POSITIVE))
}

/// A picture as sRGB bytes, row by row. Highlights are compressed, and colours outside the gamut are desaturated.
pub fn bytes(picture: &Picture, exposure: f64) -> Vec<u8> {
    let pixel = |p: &Pixel| {
        let xyz = xyz_of_linear_srgb(p.rgb.map(|v| (v * exposure) as f32));
        displayed_codes(xyz)
    };
    picture.pixels.iter().flat_map(pixel).collect()
}

/// A picture as a PNG (sRGB).
///
/// # Errors
/// As the encoder.
pub fn png(picture: &Picture, exposure: f64) -> std::io::Result<Vec<u8>> {
    encode_png8(picture.width, picture.height, 3, &bytes(picture, exposure))
}

/// Writes a picture as a PNG (sRGB).
///
/// # Errors
/// `Output` if the system refuses.
pub fn write_png(path: &Path, picture: &Picture, exposure: f64) -> Result<()> {
    let encoded = png(picture, exposure).map_err(|error| Error::output(path, error))?;
    write_whole(path, &encoded)
}

/// Reads the colours of a file written by [`write_picture`], without the errors.
///
/// # Errors
/// `Input` for other files.
pub fn read_picture(path: &Path) -> Result<Picture> {
    let mut map = read_exr(path)?;
    let [r, g, b] = [map.take("R", path)?, map.take("G", path)?, map.take("B", path)?];
    let pixel = |i: usize| {
        let rgb = [r[i], g[i], b[i]];
        Pixel { rgb: rgb.map(f64::from), luminance: xyz_of_linear_srgb(rgb)[1].into(), squares: 0.0, passes: 1 }
    };
    let pixels = (0..map.width * map.height).map(pixel).collect();
    Ok(Picture { width: map.width, height: map.height, pass_samples: SAMPLES, passes: 1, pixels, bands: vec![] })
}

/// Digest that identifies a scene and its accuracy.
pub(crate) fn digest(scene: &Scene, settings: &Settings) -> String {
    // FNV-1a, sufficient to detect a changed scene, but not an attack.
    let mut text = serde_json::to_string(&(scene, settings.max_error, settings.wavelengths)).unwrap_or_default();
    if (settings.method, settings.rank) != (Method::Auto, None) {
        text += &serde_json::to_string(&(settings.method, settings.rank)).unwrap_or_default();
    }
    let hash = text.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3));
    format!("{hash:016x}")
}

/// Saves a picture so that rendering can be continued.
///
/// # Errors
/// `Output` if the system refuses.
pub(crate) fn keep(path: &Path, picture: &Picture, digest: &str) -> Result<()> {
    let text = |number: usize| Attribute::Text(number.to_string());
    let attributes = [
        ("scene", Attribute::Text(digest.into())),
        ("passes", text(picture.passes)),
        ("pass_samples", text(picture.pass_samples)),
    ];
    let width = picture.width;
    // Each number is stored in two parts at full precision, because passes are allotted by them and a continued
    // rendering must not differ.
    let channels = STATE.map(|name| [name.to_owned(), format!("{name}.rest")]);
    let names: Vec<&str> = channels.iter().flatten().map(String::as_str).chain(["passes"]).collect();
    // With --resume the same file was read before.
    rewrite(path, |file| {
        write_exr(file, width, picture.height, &names, &attributes, &|c, y, row| {
            for (out, p) in row.iter_mut().zip(&picture.pixels[y * width..]) {
                let values = [p.rgb[0], p.rgb[1], p.rgb[2], p.luminance, p.squares];
                *out = match values.get(c / 2) {
                    Some(v) if c % 2 == 0 => *v as f32,
                    Some(v) => (v - f64::from(*v as f32)) as f32,
                    None => p.passes as f32,
                };
            }
        })
    })
}

/// Reads a saved picture.
///
/// # Errors
/// `Input` for other files, and for those of another scene.
pub(crate) fn resumed(path: &Path, digest: &str, [width, height]: [usize; 2]) -> Result<Picture> {
    let remedy = "give the file that --keep wrote for this scene and these options, or leave --resume out";
    let mut map = read_exr(path)?;
    let passes = map.attributes.get("passes").and_then(|t| t.parse::<usize>().ok()).filter(|n| *n < 1 << 24);
    let Some(passes) = passes.filter(|_| map.attributes.get("scene").is_some_and(|s| s == digest)) else {
        return Err(Error::file(path, "is of another scene or other options", remedy));
    };
    if [map.width, map.height] != [width, height] {
        return Err(Error::file(path, format!("is {} × {}", map.width, map.height), remedy));
    }
    let mut planes = vec![];
    for name in STATE {
        planes.push(map.take(name, path)?);
        planes.push(map.take(&format!("{name}.rest"), path)?);
    }
    planes.push(map.take("passes", path)?);
    let pixel = |i: usize| {
        let v = |c: usize| f64::from(planes[2 * c][i]) + f64::from(planes[2 * c + 1][i]);
        Pixel { rgb: [v(0), v(1), v(2)], luminance: v(3), squares: v(4), passes: planes[2 * STATE.len()][i] as u32 }
    };
    let pixels: Vec<Pixel> = (0..width * height).map(pixel).collect();
    if let Some(i) = planes.iter().find_map(|p| p.iter().position(|v| !v.is_finite())) {
        return Err(Error::file(path, format!("has no number in column {}, row {}", i % width, i / width), remedy));
    }
    // States of earlier versions have 4 samples per pass.
    let samples = map.attributes.get("pass_samples").and_then(|t| t.parse().ok());
    let pass_samples = samples.filter(|n| [SAMPLES, WELL_SPREAD].contains(n)).unwrap_or(SAMPLES);
    Ok(Picture { width, height, pass_samples, passes, pixels, bands: vec![] })
}
