//! Spectra, illuminants and colours for the CIE standard observers.
//!
//! Tables are those of the CIE as published in the colour-science package 0.4.7 (`data/LICENSE.txt`). Observers have
//! steps of 1 nm, illuminants of 5 nm; values in between are interpolated linearly.

mod difference;
mod illuminant;
mod spectrum;
#[cfg(test)]
mod tests;

pub use difference::{delta_e_2000, lab};
pub use illuminant::{Illuminant, NAMES};
pub use spectrum::Spectrum;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::LazyLock;

/// Range of the observers' tables in nm.
pub const VISIBLE_NM: [f64; 2] = [360.0, 830.0];

/// CIE standard observer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Observer {
    /// CIE 1931, field of view 2°.
    #[default]
    #[serde(rename = "1931")]
    Cie1931,
    /// CIE 1964, field of view 10°.
    #[serde(rename = "1964")]
    Cie1964,
}

/// Colour matching functions from 360 nm on, in steps of 1 nm.
type Rows = Vec<[f64; 3]>;

static CIE_1931: LazyLock<Rows> = LazyLock::new(|| rows(include_str!("data/cie_1931_2deg.csv")));
static CIE_1964: LazyLock<Rows> = LazyLock::new(|| rows(include_str!("data/cie_1964_10deg.csv")));

fn rows(csv: &str) -> Rows {
    let row = |line: &str| -> Option<[f64; 3]> {
        let mut values = line.split(',').skip(1).map(|v| v.trim().parse().ok());
        Some([values.next()??, values.next()??, values.next()??])
    };
    csv.lines().filter_map(row).collect()
}

impl Observer {
    /// Colour matching functions x̄, ȳ, z̄ at a wavelength in nm; 0 outside of [`VISIBLE_NM`].
    pub fn at(self, nm: f64) -> [f64; 3] {
        let rows: &Rows = match self {
            Self::Cie1931 => &CIE_1931,
            Self::Cie1964 => &CIE_1964,
        };
        let place = nm - VISIBLE_NM[0];
        if !(0.0..=VISIBLE_NM[1] - VISIBLE_NM[0]).contains(&place) {
            return [0.0; 3];
        }
        let k = place as usize;
        let (share, next) = (place - k as f64, (k + 1).min(rows.len() - 1));
        std::array::from_fn(|c| rows[k][c] * (1.0 - share) + rows[next][c] * share)
    }
}

/// Converts CIE XYZ (white has Y = 1) to linear sRGB (IEC 61966-2-1).
pub fn linear_srgb([x, y, z]: [f32; 3]) -> [f32; 3] {
    [
        3.240_454_2 * x - 1.537_138_5 * y - 0.498_531_4 * z,
        -0.969_266 * x + 1.876_010_8 * y + 0.041_556 * z,
        0.055_643_4 * x - 0.204_025_9 * y + 1.057_225_2 * z,
    ]
}

/// Converts linear sRGB to CIE XYZ: the inverse of [`linear_srgb`].
pub fn xyz_of_linear_srgb([r, g, b]: [f32; 3]) -> [f32; 3] {
    [
        0.412_456_4 * r + 0.357_576_1 * g + 0.180_437_5 * b,
        0.212_672_9 * r + 0.715_152_2 * g + 0.072_175 * b,
        0.019_333_9 * r + 0.119_192 * g + 0.950_304_1 * b,
    ]
}

/// Tone-maps CIE XYZ to sRGB values from 0 to 1.
///
/// Reinhard's curve compresses the range (Reinhard et al. 2002). Colours outside of the sRGB gamut lose saturation
/// until they are inside.
pub fn displayed(xyz: [f32; 3]) -> [f32; 3] {
    compressed(xyz).map(srgb_encode)
}

/// As [`displayed`], in 8-bit codes.
pub fn displayed_codes(xyz: [f32; 3]) -> [u8; 3] {
    compressed(xyz).map(srgb_code)
}

fn compressed([x, y, z]: [f32; 3]) -> [f32; 3] {
    let luminance = y.max(0.0);
    let rgb = linear_srgb([x, y, z]);
    let (least, most) = rgb.iter().fold((luminance, 1e-9_f32), |(a, b), v| (a.min(*v), b.max(*v)));
    let kept = if least < 0.0 { luminance / (luminance - least) } else { 1.0 };
    rgb.map(|v| (luminance + kept * (v - luminance)) / (1.0 + most))
}

/// sRGB value of linear light; both from 0 to 1 (IEC 61966-2-1).
pub fn srgb_encode(light: f32) -> f32 {
    let v = light.clamp(0.0, 1.0);
    if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

/// 8-bit code next to [`srgb_encode`], from a table without evaluating a power; 0 for NaN.
pub fn srgb_code(light: f32) -> u8 {
    /// Low bits of a float that are dropped to find its bucket. Buckets span 1/64 of an octave, less than one code.
    const REST: u32 = 17;
    /// First bucket; all smaller values round to code 0.
    const FIRST: u32 = (1.0_f32 / 8192.0).to_bits() >> REST;
    static CODES: LazyLock<(Vec<u8>, Vec<f32>)> = LazyLock::new(|| {
        let code = |light: f32| (255.0 * srgb_encode(light)).round() as u8;
        let buckets = (FIRST..=1.0_f32.to_bits() >> REST).map(|bucket| code(f32::from_bits(bucket << REST))).collect();
        // Positive floats are ordered like their bit patterns.
        let least = |wanted: u8| {
            let (mut low, mut high) = (0, 1.0_f32.to_bits());
            while low < high {
                let middle = low.midpoint(high);
                if code(f32::from_bits(middle)) >= wanted { high = middle } else { low = middle + 1 }
            }
            f32::from_bits(high)
        };
        (buckets, (0..=255).map(least).collect())
    });
    let (buckets, least) = &*CODES;
    let light = light.clamp(0.0, 1.0);
    let bucket = (light.to_bits() >> REST).saturating_sub(FIRST) as usize;
    let mut code = usize::from(buckets.get(bucket).copied().unwrap_or(0));
    while least.get(code + 1).is_some_and(|next| light >= *next) {
        code += 1;
    }
    code as u8
}
