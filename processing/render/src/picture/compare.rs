//! Visual difference of two pictures.

use nacre_frames::Transfer;
use nacre_optics::color::{delta_e_2000, displayed, lab, xyz_of_linear_srgb};

/// Luminance below which pixels are ignored for the exposure, relative to the brightest, and screen luminance from
/// which a pixel counts as lit.
const DARK: f64 = 1e-4;
const LIT: f64 = 1e-3;

/// Visual difference of two pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// Mean CIEDE2000 over the pixels that are lit in either picture.
    pub mean: f64,
    /// Number of these pixels.
    pub lit: usize,
}

/// Compares two pictures of one size in linear sRGB, both displayed at the first one's exposure, whose brightest
/// twentieth is at 0.8 and above.
pub fn difference(one: &[[f32; 3]], other: &[[f32; 3]]) -> Difference {
    let luminance = |p: &[f32; 3]| f64::from(xyz_of_linear_srgb(*p)[1]);
    let mut light: Vec<f64> = one.iter().map(luminance).filter(|y| *y > 0.0).collect();
    light.sort_by(f64::total_cmp);
    let most = light.last().copied().unwrap_or(1.0);
    light.retain(|y| *y > DARK * most);
    let exposure = 0.8 / light.get(light.len() * 19 / 20).copied().unwrap_or(1.0);
    let shown = |rgb: &[f32; 3]| {
        let shown = displayed(xyz_of_linear_srgb(rgb.map(|v| (f64::from(v) * exposure) as f32)));
        lab(xyz_of_linear_srgb(shown.map(|v| Transfer::Srgb.decode(v))).map(f64::from))
    };
    let lit = |(a, b): &(&[f32; 3], &[f32; 3])| luminance(a).max(luminance(b)) * exposure >= LIT;
    let (mut sum, mut count) = (0.0, 0);
    for (a, b) in one.iter().zip(other).filter(lit) {
        sum += delta_e_2000(shown(a), shown(b));
        count += 1;
    }
    Difference { mean: sum / count.max(1) as f64, lit: count }
}
