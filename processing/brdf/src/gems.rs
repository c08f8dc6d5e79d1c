//! Diffraction shader of GPU Gems (2004, chapter 8) for comparison: colours from the period alone.

use super::brdf::Views;
use super::geometry::{Direction, Pair};
use nacre_base::{Error, Result};
use nacre_image::{Attribute, write_exr, write_png8, write_whole_with};
use nacre_optics::color::srgb_code;
use std::path::Path;

/// Number of orders in the sum.
const ORDERS: usize = 8;

/// Scale from the shader's wavelengths (0.5 to 1; blue 0.625, green 0.75, red 0.875) to µm.
const MICRON: f64 = 0.72;

/// Grey of directions below the surface.
const BELOW: u8 = 60;

/// Linear red, green and blue for a component `u` of `ωi + ωr` across the grooves.
///
/// Each order n adds the shader's bump at the wavelength `period·|u|/n` with equal weight, regardless of depth and
/// profile.
pub fn color(u: f64, period_um: f64) -> [f64; 3] {
    let bump = |x: f64| (1.0 - x * x).max(0.0);
    let mut sum = [0.0; 3];
    for n in 1..=ORDERS {
        let y = 2.0 * period_um * u.abs() / (n as f64 * MICRON) - 1.0;
        for (c, middle) in [0.75, 0.5, 0.25].into_iter().enumerate() {
            sum[c] += bump(4.0 * (y - middle));
        }
    }
    sum
}

/// Map of the shader over viewing directions: linear red, green and blue; NaN outside of the hemisphere.
///
/// `light_deg` is the light's angle from the normal and its azimuth, `direction_deg` the direction of the grating
/// vector.
///
/// # Errors
/// `Input` for a period outside of 0.1 to 100 µm, and for light and views as for a map.
pub fn gems_map(period_um: f64, direction_deg: f64, light_deg: [f64; 2], views: Views) -> Result<Vec<[f32; 3]>> {
    if !(0.1..=100.0).contains(&period_um) {
        return Err(Error::input("period-um", format!("is {period_um}"), "give 0.1 to 100 µm"));
    }
    if !direction_deg.is_finite() {
        return Err(Error::input("direction-deg", "is no angle", "give degrees"));
    }
    views.check()?;
    let light = Direction::light(light_deg[0], light_deg[1])?;
    let (sin, cos) = direction_deg.to_radians().sin_cos();
    let at = |i: usize| match views.direction(i % views.size, i / views.size) {
        Some(view) => {
            let [x, y] = Pair::new(light, view).tangent;
            color(x * cos + y * sin, period_um).map(|v| v as f32)
        }
        None => [f32::NAN; 3],
    };
    Ok((0..views.size * views.size).map(at).collect())
}

/// Writes the shader's map (EXR) and its picture (sRGB, PNG; 1 is white).
///
/// # Errors
/// `Output` if the system refuses.
pub fn write_gems(path: &Path, picture: &Path, map: &[[f32; 3]], views: Views) -> Result<()> {
    let attributes = [
        ("units", Attribute::Text("linear red, green and blue of the shader; 1 is the top of one order's bump".into())),
        ("mapping", Attribute::Text("(x, y) = sin θ (cos φ, sin φ), y up; NaN below the surface".into())),
    ];
    let size = views.size;
    write_whole_with(path, |file| {
        write_exr(file, size, size, &["R", "G", "B"], &attributes, &|c, y, row| {
            row.iter_mut().enumerate().for_each(|(x, out)| *out = map[y * size + x][c]);
        })
    })?;
    let codes: Vec<u8> =
        map.iter().flat_map(|rgb| rgb.map(|v| if v.is_nan() { BELOW } else { srgb_code(v) })).collect();
    write_png8(picture, size, size, 3, &codes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_repeat_at_multiples_and_have_their_colours() {
        // 1.6 µm: 450, 540 and 630 nm of the first order.
        for (nm, c) in [(450.0, 2), (540.0, 1), (630.0, 0)] {
            let rgb = color(nm / 1600.0, 1.6);
            assert!((rgb[c] - 1.0).abs() < 1e-9 && rgb.iter().all(|v| *v <= rgb[c]), "{nm}: {rgb:?}");
        }
        assert_eq!(color(0.0, 1.6), [0.0; 3]);
    }
}
