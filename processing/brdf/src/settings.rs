//! What the user may choose.

use super::fresnel::Reflectance;
use super::geometry::{Direction, Window};
use nacre_base::{Error, Result};
use nacre_optics::color::{NAMES, Observer};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::str::FromStr;

/// Lobes with this part of the light are to be as exact as asked for: an amplitude that is off by δ makes one of η off by 2δ/√η.
pub(super) const FAINTEST: f64 = 1e-3;

/// Limits of a map's side.
pub const SIZES: std::ops::RangeInclusive<usize> = 8..=4096;

/// Highest power that can be asked for.
const MOST_ORDER: usize = 100;

/// How the power density of a surface is computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(rename = "BrdfMethod")]
pub enum Method {
    /// The cheapest that meets the wanted error.
    #[default]
    Auto,
    /// Direct sums over all pixels, in double precision: the truth, and slow.
    Reference,
    /// Powers of the height (2014 thesis, FLSS).
    Taylor,
    /// Chebyshev polynomials of the height (Jacobi and Anger).
    Chebyshev,
    /// Transforms of `exp(ikwh)` itself at some kw, with a polynomial between.
    Fft,
    /// Only the wavelengths λ = d·u/n of a single period d (2014 thesis, section 4.5.2, mended).
    Nmm,
    /// Whole repetitions of the patch under an even window (2014 thesis, section 3.6, mended), its transform interpolated by sinc functions.
    Pq,
    /// The same, interpolated linearly.
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

/// What the numbers of a result are.
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

/// What every product takes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "BrdfSettings")]
pub struct Settings {
    /// Angle of the light from the normal, and its azimuth anticlockwise from the right, in degrees.
    #[schemars(extend("x-aliases" = ["light"], "x-placeholder" = "THETA[,PHI]", "x-short" = true))]
    pub light_deg: [f64; 2],
    /// How the power density is computed.
    pub method: Method,
    /// Highest power of `taylor`, whatever it is off by: 1 is the first order of the 2017 paper (section 6.1), which its measured heights
    /// are drawn by.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-advanced" = true))]
    pub order: Option<usize>,
    /// Width of the coherence window in µm: four standard deviations of its amplitude.
    pub coherence_um: f64,
    /// Error that is asked for: relative, of every lobe that holds at least a thousandth of the light.
    pub max_error: f64,
    /// Distance of wavelengths in nm, 0.01 to 100, instead of as close as each direction needs (2014 thesis, Fig. 6.5). The error is measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-advanced" = true))]
    pub wavelength_step_nm: Option<f64>,
    /// What the numbers are.
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
    /// Refuses what makes no sense; the light's direction and the window.
    ///
    /// # Errors
    /// `Input`, which names the setting.
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
