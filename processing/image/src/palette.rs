//! Palettes for angles of lines: orientations and angles of linear polarization.

use std::f64::consts::TAU;
use std::fmt;
use std::str::FromStr;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::canvas::Rgb;

/// Colour of masked pixels: a grey that neither the palettes nor the scalar colours contain.
pub const MASKED: Rgb = [64, 64, 64];

/// Number of colours for half a turn: steps of 0.03° include all 1530 saturated hues.
const STEPS: usize = 6120;

// The cyclic palette is an ellipse in OKLab, `CENTER + COSINE cos u + SINE sin u`. Of all ellipses within sRGB, it has
// the largest CIEDE2000 difference between angles 20° apart for colour-blind readers. Only the cosine changes
// lightness.
const CENTER: [f64; 3] = [0.566, -0.007, 0.0];
const COSINE: [f64; 3] = [0.368, -0.041, 0.017];
const SINE: [f64; 3] = [0.0, -0.057, -0.094];
/// Position of the angle 0 on the ellipse (rad). The four quadrants of 45° then have four different mean lightnesses.
const START: f64 = 5.847;
/// Correction of the angle on the ellipse (rad) for equal CIEDE2000 steps: cosine and sine terms of the harmonics from
/// the 1st on.
const EVEN: [[f64; 2]; 5] = [[-0.009, -0.030], [-0.090, 0.052], [0.003, -0.027], [0.014, 0.000], [0.007, -0.005]];

/// Palette for angles. Half a turn is a full cycle, because the angle of a line repeats after 180°.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Palette {
    /// Pale yellow (0°), blue (45°), near black (90°), brown (135°): even steps, also for colour-blind readers.
    #[default]
    Cyclic,
    /// Saturated hues: red (0°), yellow-green (45°), cyan (90°), violet (135°).
    Hsv,
}

impl Palette {
    /// Colour of an angle in radians, with a period of π.
    pub fn color(self, theta: f32) -> Rgb {
        let turns = (f64::from(theta) / (0.5 * TAU)).rem_euclid(1.0);
        let byte = |v: f64| (255.0 * v).round().clamp(0.0, 255.0) as u8;
        match self {
            Self::Cyclic => cyclic(turns).map(|light| byte(srgb(light))),
            Self::Hsv => hue(turns).map(byte),
        }
    }

    /// Colour table, for many pixels.
    pub fn table(self) -> ColorTable {
        let theta = |i: usize| (0.5 * TAU * i as f64 / STEPS as f64) as f32;
        ColorTable { colors: (0..STEPS).map(|i| self.color(theta(i))).chain([MASKED]).collect() }
    }
}

impl fmt::Display for Palette {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Cyclic => "cyclic",
            Self::Hsv => "hsv",
        })
    }
}

impl FromStr for Palette {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        [Self::Cyclic, Self::Hsv]
            .into_iter()
            .find(|palette| palette.to_string() == text)
            .ok_or_else(|| format!("{text:?} is no palette; give cyclic or hsv"))
    }
}

/// Colours of angles in steps of 0.03°, and [`MASKED`] at the end.
#[derive(Clone, Debug)]
pub struct ColorTable {
    colors: Vec<Rgb>,
}

impl ColorTable {
    /// Colour of an angle in radians; [`MASKED`] if it is not finite.
    pub fn color(&self, theta: f32) -> Rgb {
        self.colors[Self::index(theta) as usize]
    }

    /// All colours, in the order of [`Self::index`].
    pub(super) fn colors(&self) -> &[Rgb] {
        &self.colors
    }

    /// Index of an angle's colour. It has no branches, so that it is vectorised.
    #[inline(always)]
    pub(super) fn index(theta: f32) -> i32 {
        let turns = theta / std::f32::consts::PI;
        let step = ((turns - turns.floor()) * STEPS as f32 + 0.5) as i32;
        if !theta.is_finite() {
            STEPS as i32
        } else if step >= STEPS as i32 {
            0
        } else {
            step
        }
    }
}

/// Linear sRGB (0 to 1) of the cyclic palette; `turns` from 0 to 1 are angles from 0° to 180°.
pub(super) fn cyclic(turns: f64) -> [f64; 3] {
    let angle = TAU * turns;
    let harmonic = |(k, [c, s]): (usize, &[f64; 2])| {
        let (sin, cos) = ((k + 1) as f64 * angle).sin_cos();
        c * cos + s * sin
    };
    let (sin, cos) = (angle + START + EVEN.iter().enumerate().map(harmonic).sum::<f64>()).sin_cos();
    linear_srgb_of_oklab([0, 1, 2].map(|i| CENTER[i] + COSINE[i] * cos + SINE[i] * sin))
}

/// Linear sRGB of OKLab (B. Ottosson, "A perceptual color space for image processing", 2020, with the matrices of
/// 2021).
fn linear_srgb_of_oklab([lightness, a, b]: [f64; 3]) -> [f64; 3] {
    let l = (lightness + 0.396_337_777_4 * a + 0.215_803_757_3 * b).powi(3);
    let m = (lightness - 0.105_561_345_8 * a - 0.063_854_172_8 * b).powi(3);
    let s = (lightness - 0.089_484_177_5 * a - 1.291_485_548_0 * b).powi(3);
    [
        4.076_741_662_1 * l - 3.307_711_591_3 * m + 0.230_969_929_2 * s,
        -1.268_438_004_6 * l + 2.609_757_401_1 * m - 0.341_319_396_5 * s,
        -0.004_196_086_3 * l - 0.703_418_614_7 * m + 1.707_614_701_0 * s,
    ]
}

/// sRGB value of linear light (IEC 61966-2-1).
fn srgb(light: f64) -> f64 {
    if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
}

/// sRGB of a saturated hue, 0 to 1.
fn hue(turns: f64) -> [f64; 3] {
    [5.0, 3.0, 1.0].map(|n| {
        let k = (n + 6.0 * turns).rem_euclid(6.0);
        1.0 - k.min(4.0 - k).clamp(0.0, 1.0)
    })
}
