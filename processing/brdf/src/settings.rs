//! Settings of all products.

use super::fresnel::Reflectance;
use super::geometry::{Direction, Window};
use nacre_base::{Error, Result};
use nacre_optics::color::{NAMES, Observer};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::str::FromStr;

/// Smallest fraction of the light for which lobes meet the requested error. An amplitude error of δ changes a lobe of
/// efficiency η by 2δ/√η.
pub(super) const FAINTEST: f64 = 1e-3;

/// Range of a map's side in pixels.
pub const SIZES: std::ops::RangeInclusive<usize> = 8..=4096;

/// Highest power that can be requested.
const MOST_ORDER: usize = 100;

/// Computation of the power density of a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(rename = "BrdfMethod")]
pub enum Method {
    /// The cheapest method that meets the requested error.
    #[default]
    Auto,
    /// Direct sums over all pixels in double precision: the slow reference.
    Reference,
    /// Powers of the height (2014 thesis, FLSS).
    Taylor,
    /// Chebyshev polynomials of the height (Jacobi-Anger expansion).
    Chebyshev,
    /// Transforms of `exp(ikwh)` at some kw, with polynomial interpolation between them.
    Fft,
    /// Only the wavelengths λ = d·u/n of a single period d (2014 thesis, section 4.5.2, corrected).
    Nmm,
    /// Whole repetitions of the patch under an even window, interpolated by sinc functions (2014 thesis, section 3.6,
    /// corrected).
    Pq,
    /// As `pq`, with linear interpolation.
    PqLinear,
}

impl FromStr for Method {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        Ok(match text {
            "auto" => Self::Auto,
            "reference" => Self::Reference,
            "taylor" => Self::Taylor,
            "chebyshev" => Self::Chebyshev,
            "fft" => Self::Fft,
            "nmm" => Self::Nmm,
            "pq" => Self::Pq,
            "pq-linear" => Self::PqLinear,
            _ => return Err("give auto, reference, taylor, chebyshev, fft, nmm, pq or pq-linear".into()),
        })
    }
}

/// Normalisation of a result.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Normalisation {
    /// The BRDF in 1/sr.
    #[default]
    Brdf,
    /// The BRDF over that of a flat mirror of the material in its own mirror direction (2014 thesis, section 3.3.3).
    Relative,
}

impl FromStr for Normalisation {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        match text {
            "brdf" => Ok(Self::Brdf),
            "relative" => Ok(Self::Relative),
            _ => Err("give brdf or relative".into()),
        }
    }
}

/// Settings of all products.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "BrdfSettings")]
pub struct Settings {
    /// Angle of the light from the normal, and its azimuth anticlockwise from the right, in degrees.
    #[schemars(extend("x-aliases" = ["light"], "x-placeholder" = "THETA[,PHI]", "x-short" = true))]
    pub light_deg: [f64; 2],
    /// Computation of the power density.
    pub method: Method,
    /// Highest power of `taylor` (1 to 100), regardless of its error. 1 is the first order of the 2017 paper (section
    /// 6.1), used with its measured heights.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-advanced" = true))]
    pub order: Option<usize>,
    /// Width of the coherence window in µm: four standard deviations of its amplitude.
    pub coherence_um: f64,
    /// Largest relative error of every lobe with at least 0.1 % of the light.
    pub max_error: f64,
    /// Step between wavelengths in nm, 0.01 to 100 (2014 thesis, Fig. 6.5). By default, it is as small as each
    /// direction needs. The error is measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-advanced" = true))]
    pub wavelength_step_nm: Option<f64>,
    /// Normalisation of the result.
    #[schemars(extend("x-advanced" = true))]
    pub normalisation: Normalisation,
    /// Reflectance of the smooth surface.
    #[schemars(extend("x-aliases" = ["material"], "x-placeholder" = "perfect|schlick=R0|aluminium|silver|gold|copper|nickel|chromium|silicon"))]
    pub reflectance: Reflectance,
    /// Shadowing and masking of V grooves.
    #[schemars(extend("x-advanced" = true))]
    pub shadowing: bool,
    /// Spectrum of the light of a map: a name or a CSV file.
    #[schemars(extend("x-file" = true, "examples" = NAMES, "x-placeholder" = "NAME|FILE.csv"))]
    pub illuminant: String,
    /// Observer of a map.
    #[schemars(extend("x-advanced" = true))]
    pub observer: Observer,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            light_deg: [0.0, 0.0],
            method: Method::Auto,
            order: None,
            coherence_um: 65.0,
            max_error: 0.01,
            wavelength_step_nm: None,
            normalisation: Normalisation::Brdf,
            reflectance: Reflectance::Perfect,
            shadowing: false,
            illuminant: "E".into(),
            observer: Observer::default(),
        }
    }
}

impl Settings {
    /// Checks the settings, and returns the light's direction and the coherence window.
    ///
    /// # Errors
    /// `Input`, naming the setting.
    pub fn check(&self) -> Result<(Direction, Window)> {
        if !(1e-6..=0.5).contains(&self.max_error) {
            let problem = format!("is {}", self.max_error);
            return Err(Error::input("max-error", problem, "give 0.000001 to 0.5"));
        }
        if let Some(nm) = self.wavelength_step_nm.filter(|nm| !(0.01..=100.0).contains(nm)) {
            return Err(Error::input("wavelength-step-nm", format!("is {nm}"), "give 0.01 to 100 nm"));
        }
        if let Some(order) = self.order {
            if self.method != Method::Taylor {
                return Err(Error::input("order", "is one of powers", "add --method taylor, or leave --order out"));
            }
            if !(1..=MOST_ORDER).contains(&order) {
                return Err(Error::input("order", format!("is {order}"), format!("give 1 to {MOST_ORDER}")));
            }
        }
        Ok((Direction::light(self.light_deg[0], self.light_deg[1])?, Window::new(self.coherence_um)?))
    }
}
