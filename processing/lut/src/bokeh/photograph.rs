//! A photograph as linear light, cropped.

use nacre_base::{Error, Result};
use nacre_frames::Transfer;
use nacre_image::{Depth, read};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Channel taken from a colour photograph; a grey one has a single channel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(rename = "BokehLight")]
pub enum Light {
    /// The red channel.
    Red,
    /// The green channel.
    Green,
    /// The blue channel; its short wavelengths resolve the finest detail (2017 paper, section 5).
    #[default]
    Blue,
    /// Relative luminance of linear sRGB (IEC 61966-2-1).
    Luminance,
}

impl Light {
    fn weights(self) -> [f64; 3] {
        match self {
            Self::Red => [1.0, 0.0, 0.0],
            Self::Green => [0.0, 1.0, 0.0],
            Self::Blue => [0.0, 0.0, 1.0],
            Self::Luminance => [0.2126, 0.7152, 0.0722],
        }
    }
}

/// A region of a photograph in pixels: column and row of the upper left corner, width, height.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Crop(pub [usize; 4]);

/// Linear light of a photograph, relative to white.
#[derive(Clone, Debug)]
pub(super) struct Photograph {
    pub width: usize,
    pub height: usize,
    /// NaN where saturated or unknown.
    pub light: Vec<f32>,
    /// Quantisation step at the mean light; 0 for floating-point files.
    pub step: f64,
}

/// Reads a photograph.
///
/// # Errors
/// `Input` for an unreadable file, an unknown transfer function, and a region outside the photograph.
pub(super) fn photograph(path: &Path, light: Light, transfer: Transfer, crop: Option<Crop>) -> Result<Photograph> {
    transfer.check_known()?;
    let raster = read(path)?;
    let (width, height) = (raster.width, raster.height);
    let Crop([x, y, w, h]) = crop.unwrap_or(Crop([0, 0, width, height]));
    let inside =
        |from: usize, size: usize, all: usize| size > 0 && from.checked_add(size).is_some_and(|end| end <= all);
    if !inside(x, w, width) || !inside(y, h, height) {
        let problem = format!("{x},{y},{w},{h} is not inside the photograph of {width} x {height} pixels");
        return Err(Error::input("--crop", problem, "give column, row, width and height inside it"));
    }
    let weights = light.weights();
    let at = |i: usize| {
        let pixel = (y + i / w) * width + x + i % w;
        if raster.channels == 1 {
            return transfer.light(&raster.samples, pixel);
        }
        let part = |c: usize| weights[c] * f64::from(transfer.light(&raster.samples, 3 * pixel + c));
        (0..3).filter(|c| weights[*c] > 0.0).map(part).sum::<f64>() as f32
    };
    let light: Vec<f32> = (0..w * h).map(at).collect();
    let step = step(&light, raster.info().depth, transfer);
    Ok(Photograph { width: w, height: h, light, step })
}

/// Quantisation step of the light at its mean; 0 for floating-point files.
fn step(light: &[f32], depth: Depth, transfer: Transfer) -> f64 {
    if depth == Depth::F32 {
        return 0.0;
    }
    let known = light.iter().filter(|v| v.is_finite());
    let (sum, n) = known.fold((0.0, 0.0), |(sum, n), v| (sum + f64::from(*v), n + 1.0));
    transfer.slope(transfer.encode(sum / f64::max(n, 1.0))) / f64::from(depth.full_scale())
}
