//! Table over half vectors, as `lut.exr` of a photograph by a camera beside the flash.
//!
//! Stam's BRDF is `(1 + ωi·ωr)² / (cos θi cos θr)` times a function of the half vector and of w = cos θi + cos θr. A
//! table leaves w out, and has that of equal directions of light and view. So it is exact for those, and for orders of
//! surfaces so shallow that w only scales their amplitude (2017 TOG paper, section 4). The lobe in the mirror direction
//! does not follow this: a table has it too dark by cos²θ.

use super::{OUTSIDE, Prepared, Table, check_size, coherence};
use crate::engine::Memory;
use crate::geometry::{Direction, Pair};
use crate::height::{HeightField, Quality};
use crate::settings::Settings;
use nacre_base::Result;
use nacre_base::progress::Progress;
use nacre_image::{Attribute, write_exr, write_whole_with};
use nacre_optics::color::Illuminant;
use rayon::prelude::*;
use std::path::Path;

/// Error above which the table does not suffice: twice the 9.5 % of a sinusoid of 0.02 µm, which are of the linear
/// interpolation between entries.
const SHALLOW: f64 = 0.2;

/// Computes the table with `size` entries along a side.
///
/// # Errors
/// `Input` for a size out of range, and as [`map`](crate::map); `Output` if the file cannot be written.
pub fn half_vector(
    field: &HeightField,
    quality: &Quality,
    settings: &Settings,
    coherence_um: Option<f64>,
    size: usize,
    out: &Path,
    progress: &dyn Progress,
) -> Result<Table> {
    check_size("size", size, 16..=4096)?;
    let (coherence_um, mut warnings) = coherence(coherence_um, 2.0 * super::extent(field) / size as f64);
    let settings = Settings { coherence_um, ..settings.clone() };
    let prepared = Prepared::new(field, quality, &settings, 20 * size * size, progress)?;
    let samples = prepared.samples()?;
    let extent = prepared.extent;
    progress.stage("half vectors", size as u64);
    let mut xyz = vec![[0.0_f32; 3]; size * size];
    xyz.par_chunks_mut(size).enumerate().for_each_init(Memory::default, |memory, (y, row)| {
        if progress.cancelled() {
            return;
        }
        let at = |k: usize| ((2 * k + 1) as f64 / size as f64 - 1.0) * extent;
        for (x, out) in row.iter_mut().enumerate() {
            if let Some(middle) = Direction::of(at(x) / 2.0, -at(y) / 2.0) {
                let divisor = factor(&Pair::new(middle, middle));
                *out = prepared.xyz([middle, middle], &samples, memory).map(|v| (v / divisor) as f32);
            }
        }
        progress.step();
    });
    progress.check()?;
    let error = prepared.compared(&samples, prepared.mirror_lobe(), &|[light, view]| {
        let pair = Pair::new(light, view);
        let [x, y] = [pair.tangent[0], -pair.tangent[1]].map(|t| (t / extent + 1.0) / 2.0 * size as f64 - 0.5);
        interpolated(&xyz, size, x, y) * factor(&pair) * view.z
    });
    write(out, &xyz, size, extent, &settings)?;
    warnings.extend(prepared.warning());
    warnings.push("the lobe in the mirror direction is too dark by the squared cosine of incidence: it is no function of the half vector".into());
    if error > SHALLOW {
        warnings
            .push("the orders depend on more than the half vector, too: --format mitsuba holds both directions".into());
    }
    let choice = prepared.choice;
    Ok(Table { choice, shape: vec![size, size], coherence_um, extent, error, error_of: OUTSIDE, warnings })
}

/// Factor by which programs multiply a table: `(1 + ωi·ωr)² / (cos θi cos θr)`.
fn factor(pair: &Pair) -> f64 {
    pair.gain * pair.w * pair.w
}

/// Luminance between entries; dark outside.
fn interpolated(xyz: &[[f32; 3]], size: usize, x: f64, y: f64) -> f64 {
    let entry = |x: f64, y: f64| {
        let inside = x >= 0.0 && y >= 0.0 && x < size as f64 && y < size as f64;
        if inside { f64::from(xyz[y as usize * size + x as usize][1]) } else { 0.0 }
    };
    let (left, top) = (x.floor(), y.floor());
    let (right, below) = (x - left, y - top);
    (entry(left, top) * (1.0 - right) + entry(left + 1.0, top) * right) * (1.0 - below)
        + (entry(left, top + 1.0) * (1.0 - right) + entry(left + 1.0, top + 1.0) * right) * below
}

fn write(out: &Path, xyz: &[[f32; 3]], size: usize, extent: f64, settings: &Settings) -> Result<()> {
    let white = Illuminant::of(&settings.illuminant)?.white(settings.observer).unwrap_or([0.0, 1.0, 0.0]);
    let units = "X Y Z of the BRDF times cos θi cos θr / (1 + ωi·ωr)², in 1/sr, over half vectors ωi + ωr from -extent to extent, y up";
    let attributes = [
        ("units", Attribute::Text(units.into())),
        ("white", Attribute::Text(white.map(|v| format!("{v:.6}")).join(" "))),
        ("extent", Attribute::Text(extent.to_string())),
        ("warp", Attribute::Text("1".into())),
        ("illuminant", Attribute::Text(settings.illuminant.clone())),
    ];
    write_whole_with(out, |file| {
        write_exr(file, size, size, &["X", "Y", "Z", "coverage"], &attributes, &|c, y, row| {
            row.iter_mut().enumerate().for_each(|(x, out)| *out = xyz[y * size + x].get(c).copied().unwrap_or(1.0));
        })
    })
}
