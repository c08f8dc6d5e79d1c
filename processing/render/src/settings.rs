//! Settings of a rendering.

use crate::environment::factor::MAX_RANK;
use nacre_base::{Error, Result};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Maximum number of samples per pixel.
pub(crate) const MAX_SAMPLES: usize = 1 << 20;

/// Method of rendering lookup tables under environments.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(rename = "RenderMethod")]
pub enum Method {
    /// The cheapest method that meets the target error: one correlation for a flat sample, two passes, or samples.
    #[default]
    Auto,
    /// Monte Carlo samples of the environment and of the table.
    Samples,
    /// Lookups in environments filtered by two passes (2017 CVMP and TOG papers).
    TwoPass,
}

/// Settings of a rendering.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Largest number of samples per pixel, averaged over lit pixels: noisy ones receive more, calm ones fewer.
    pub samples: usize,
    /// Target error: root mean square of the pixels' standard errors, relative to the mean luminance.
    pub max_error: f64,
    /// Fixed number of wavelengths; `None` for as many as each surface point needs.
    pub wavelengths: Option<usize>,
    /// File for the saved state of the rendering.
    pub keep: Option<PathBuf>,
    /// Continue from that file.
    pub resume: bool,
    /// Also measure the truncation error of sums over orders and wavelengths, against finer ones.
    pub check: bool,
    /// Render on a graphics card, if one supports the scene.
    pub gpu: bool,
    /// Spacing of spectral bands in nm (1 to 100); `None` for colours only.
    pub spectral_nm: Option<f64>,
    /// Method of rendering lookup tables under environments.
    pub method: Method,
    /// Largest number of terms per channel and part of a table in two passes (1 to 96); `None` for as many as the error
    /// requires.
    pub rank: Option<usize>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            samples: 256,
            max_error: 0.01,
            wavelengths: None,
            keep: None,
            resume: false,
            check: false,
            gpu: false,
            spectral_nm: None,
            method: Method::Auto,
            rank: None,
        }
    }
}

impl Settings {
    /// Checks the settings.
    ///
    /// # Errors
    /// `Input`, which names the setting.
    pub(crate) fn check(&self) -> Result<()> {
        if !(1..=MAX_SAMPLES).contains(&self.samples) {
            let problem = format!("are {}", self.samples);
            return Err(Error::input("samples", problem, "give 1 to 1048576 samples per pixel"));
        }
        if !(1e-5..=1.0).contains(&self.max_error) {
            let problem = format!("is {}", self.max_error);
            return Err(Error::input("max-error", problem, "give 0.00001 to 1"));
        }
        if self.wavelengths.is_some_and(|n| !(3..=10_000).contains(&n)) {
            return Err(Error::input("wavelengths", "are too few or too many", "give 3 to 10000, or leave them out"));
        }
        if let Some(rank) = self.rank.filter(|r| !(1..=MAX_RANK).contains(r)) {
            return Err(Error::input("rank", format!("is {rank}"), format!("give 1 to {MAX_RANK} terms")));
        }
        if self.rank.is_some() && self.method == Method::Samples {
            let remedy = "leave the rank out, or choose the method two-pass or auto";
            return Err(Error::input("rank", "is of two passes, which the method samples does not take", remedy));
        }
        if self.gpu && self.method == Method::TwoPass {
            let remedy = "leave out --gpu, or the method";
            return Err(Error::input("gpu", "does not render two passes, which the processor does", remedy));
        }
        if self.resume && self.keep.is_none() {
            return Err(Error::input("resume", "needs a file that was kept", "add --keep FILE.exr"));
        }
        Ok(())
    }
}
