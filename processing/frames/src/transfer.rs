//! Transfer functions between light and file values.

use nacre_base::{Error, Result};
use nacre_image::{Depth, Samples};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Transfer function between light and file values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Transfer {
    /// Proportional to light.
    Linear,
    /// The sRGB curve of IEC 61966-2-1.
    Srgb,
    /// Value = light^(1/gamma).
    Gamma(f64),
    /// Light = v (1 + a v + b v² + c v³) / (1 + a + b + c) for a value v between black (0) and white (1): a measured
    /// response, which must rise.
    Polynomial([f64; 3]),
    /// Unknown: recovered from the photographs, for kind exposures.
    Recover,
}

/// Permitted exponents.
const GAMMAS: std::ops::RangeInclusive<f64> = 0.1..=10.0;

/// Light of a value between black (0) and white (1) for coefficients of [`Transfer::Polynomial`].
fn polynomial([a, b, c]: [f64; 3], v: f64) -> f64 {
    v * (1.0 + v * (a + v * (b + v * c))) / (1.0 + a + b + c)
}

/// Steps of Newton's method for the inverse of a polynomial.
const ROUNDS: usize = 8;

impl Transfer {
    /// Rejects unusual exponents, and `Recover`, which a single photograph does not permit.
    ///
    /// # Errors
    /// `Input`.
    pub fn check_known(self) -> Result<()> {
        let remedy = "say linear, srgb, polynomial=A,B,C or gamma=NUMBER, such as gamma=2.2";
        match self {
            Self::Recover => {
                Err(Error::input("--transfer", "one photograph does not tell how its values grow with light", remedy))
            }
            known => known.problem().map_or(Ok(()), |(_, problem)| Err(Error::input("--transfer", problem, remedy))),
        }
    }

    /// Key and problem of an invalid number.
    pub(crate) fn problem(self) -> Option<(&'static str, String)> {
        match self {
            Self::Gamma(g) if !GAMMAS.contains(&g) => Some(("transfer.gamma", format!("{g} is outside 0.1 to 10"))),
            Self::Polynomial(c) if !(0..=100).all(|k| self.slope(f64::from(k) / 100.0) > 0.0) => {
                Some(("transfer.polynomial", format!("{c:?} is no response that rises from 0 to 1")))
            }
            _ => None,
        }
    }

    /// Light (0 to 1) of an encoded value (0 to 1). Values above 1 continue the curve; negative ones give negative
    /// light (linear, sRGB) or 0 (gamma).
    pub fn decode(self, v: f32) -> f32 {
        match self {
            Self::Linear | Self::Recover => v,
            Self::Srgb if v <= 0.040_45 => v / 12.92,
            Self::Srgb => ((v + 0.055) / 1.055).powf(2.4),
            Self::Gamma(g) => v.max(0.0).powf(g as f32),
            Self::Polynomial(c) => polynomial(c, v.into()) as f32,
        }
    }

    /// Encoded value (0 to 1) of light (0 to 1): the inverse of [`decode`](Self::decode).
    pub fn encode(self, light: f64) -> f64 {
        match self {
            Self::Linear | Self::Recover => light,
            Self::Srgb if light <= 0.003_130_8 => 12.92 * light,
            Self::Srgb => 1.055 * light.powf(1.0 / 2.4) - 0.055,
            Self::Gamma(g) => light.max(0.0).powf(1.0 / g),
            Self::Polynomial(c) => {
                // Newton's method; the curve is nearly straight.
                (0..ROUNDS).fold(light, |v, _| v - (polynomial(c, v) - light) / self.slope(v))
            }
        }
    }

    /// Light of a file's sample, relative to white; NaN at the largest integer, which is saturated.
    pub fn light(self, samples: &Samples, sample: usize) -> f32 {
        let (code, white) = match samples {
            Samples::U8(v) => (f32::from(v[sample]), Depth::U8.full_scale()),
            Samples::U16(v) => (f32::from(v[sample]), Depth::U16.full_scale()),
            Samples::F32(v) => return self.decode(v[sample]),
        };
        if code >= white { f32::NAN } else { self.decode(code / white) }
    }

    /// Derivative of light with respect to the encoded value `v`.
    pub fn slope(self, v: f64) -> f64 {
        match self {
            Self::Linear | Self::Recover => 1.0,
            Self::Srgb if v <= 0.040_45 => 1.0 / 12.92,
            Self::Srgb => 2.4 / 1.055 * ((v + 0.055) / 1.055).powf(1.4),
            Self::Gamma(g) => g * v.max(1e-6).powf(g - 1.0),
            Self::Polynomial([a, b, c]) => (1.0 + v * (2.0 * a + v * (3.0 * b + v * 4.0 * c))) / (1.0 + a + b + c),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_matches_the_standard() {
        // IEC 61966-2-1: code 188 of 255 is 50.3 % light.
        assert!((Transfer::Srgb.decode(188.0 / 255.0) - 0.502_9).abs() < 1e-3);
        assert!((Transfer::Gamma(2.0).decode(0.5) - 0.25).abs() < 1e-7);
        let curved = Transfer::Polynomial([0.08, 0.01, 0.03]);
        assert!((curved.decode(1.0) - 1.0).abs() < 1e-7);
        assert_eq!(Transfer::Polynomial([-0.9, 0.0, 0.0]).problem().unwrap().0, "transfer.polynomial");
        for t in [Transfer::Linear, Transfer::Srgb, Transfer::Gamma(2.2), curved] {
            for light in [0.001, 0.2, 0.9] {
                assert!((f64::from(t.decode(t.encode(light) as f32)) - light).abs() < 1e-6);
            }
            let difference = (t.decode(0.501) - t.decode(0.499)) / 0.002;
            assert!((f64::from(difference) - t.slope(0.5)).abs() < 1e-3);
        }
    }
}
