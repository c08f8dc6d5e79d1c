//! Settings of a rendering.

use crate::environment::factor::MOST_RANK;
use nacre_base::{Error, Result};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Most samples of a pixel that may be asked for.
pub(crate) const MOST_SAMPLES: usize = 1 << 20;

/// How tables over half vectors are rendered under environments.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(rename = "RenderMethod")]
pub enum Method {
    /// The cheapest method that meets the error: one correlation for a flat sample, two passes, or samples.
    #[default]
    Auto,
    /// Samples of the environment and of the table, by Monte Carlo.
    Samples,
    /// Lookups in environments that two passes filter (2017 CVMP and TOG papers).
    TwoPass,
}

/// Settings of a rendering.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Most samples of a pixel, on average over those with light: noisy ones get more, calm ones less.
    pub samples: usize,
    /// Error at which passes end: root mean square of the pixels' standard errors over the mean luminance.
    pub max_error: f64,
    /// Fixed number of wavelengths; none to take as many as each place needs.
    pub wavelengths: Option<usize>,
    /// File that keeps the state of the rendering.
    pub keep: Option<PathBuf>,
    /// Go on from that file.
    pub resume: bool,
    /// Also measure the error of the sums over orders and wavelengths, against finer ones.
    pub check: bool,
    /// Render on a graphics card, if one supports the scene.
    pub gpu: bool,
    /// Distance of spectral bands in nm (1 to 100); none for colours only.
    pub spectral_nm: Option<f64>,
    /// How tables are rendered under environments.
    pub method: Method,
    /// Most terms per channel and part of a table that two passes take (1 to 96); none for as many as the error needs.
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
    /// Refuses settings that make no sense.
    ///
    /// # Errors
    /// `Input`, which names the setting.
    pub(crate) fn check(&self) -> Result<()> {
        if !(1..=MOST_SAMPLES).contains(&self.samples) {
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
        if let Some(rank) = self.rank.filter(|r| !(1..=MOST_RANK).contains(r)) {
            return Err(Error::input("rank", format!("is {rank}"), format!("give 1 to {MOST_RANK} terms")));
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
