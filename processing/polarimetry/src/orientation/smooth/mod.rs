//! Smoothing of the orientation map: the 2018 paper's adaptive and iterative bilateral filter (section 6.2, Fig. 16 and 18).
//!
//! Orientations are averaged as (cos 2θ, sin 2θ), so that 0° and 180° are neighbours. The weight of a neighbour is the product
//! of three: a bell of its distance (σ 3 px); a bell of its difference (σ four times the noise, at most 0.35 rad) to the
//! *median* of the pixel's 3×3 neighbourhood, so that a single wild pixel is replaced instead of kept; its reliability 1/σ².
//! Masked pixels give nothing and get nothing.
//!
//! The paper's bell is 0.35 rad wide for all pixels, and regions less than 45° apart grow into each other in ten rounds. Here
//! it is as wide as the noise asks for, so edges stay from 15 times the noise on. And where orientations slope, the window shrinks
//! until all rounds together reach over no more than the noise; otherwise a clean map would get worse.
//!
//! **σ of what comes out.** A pixel after n rounds is a weighted mean of measured pixels, and the rounds make neighbours
//! correlated, so σ does not fall as Σw²σ²/(Σw)² from round to round. The composed weights k are not kept, but their moments
//! are: mean place and covariance S follow the same weighted means as the orientations. In a Gaussian of covariance S, Σk² is
//! 1/A with A = 4π √det S; in a uniform rectangle that is 5 % less, in half a Gaussian 17 % more (8 % in σ); with 1/12 px² added
//! to S for the extent of a pixel it holds down to a single one. After the first round `v = Σw²σ²/(Σw)²` is exact, and D = v·A is
//! the variance per unit of area. A round prefers pixels by M = Σw · reliability, so later variances are the means of M·D and of
//! 1/M over A. Where the pivot decides what is averaged its noise is mixed in.
//!
//! Stated σ is within 10 % of the scatter of repeated noise after 1, 10 and 50 rounds. It is too small by up to 23 % beside
//! edges, where half of the pixels are masked, where the noise jumps threefold every 8 px, in strips of 5 px and on slopes of
//! 3° per pixel (see the tests).
//!
//! Cost: about 0.17 µs of one core per pixel and round, 0.5 µs with σ.

mod kernel;
#[cfg(test)]
mod tests;

use crate::OrientationMaps;
use crate::orientation::orient::fold;
use kernel::{Field, Filter, Round};
use nacre_base::Result;
use nacre_base::progress::Progress;
use nacre_base::statistics::median;
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Standard deviation of the weight over distance, in pixels (2018 paper, Fig. 16).
pub const SPACE_SIGMA_PX: f32 = 3.0;
/// Standard deviation of the weight over the difference of orientations: so many times the pixel's σ, within limits in rad. The
/// larger is the 2018 paper's (Fig. 16). The smaller leaves room for what σ does not hold, bumps and scratches.
const ANGLE_SIGMAS: f32 = 4.0;
const ANGLE_LIMITS: [f32; 2] = [0.02, 0.35];
/// Most rounds: by then a region without edges is one orientation.
const MOST: u32 = 1000;
/// σ holds the camera's noise only, not scratches and bumps; so no pixel counts more than so many median ones.
const MOST_RELIABLE: f32 = 4.0;

/// How often the filter is applied; 0 for not at all.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "String", into = "String")]
#[schemars(with = "String")]
pub struct Smoothing(u32);

impl Smoothing {
    /// The map as measured.
    pub const NONE: Self = Self(0);
    /// Ten rounds: removes scratches and noise, keeps what varies (2018 paper, Fig. 18c).
    pub const LIGHT: Self = Self(10);
    /// Fifty rounds: regions become even (2018 paper, Fig. 18d).
    pub const STRONG: Self = Self(50);

    /// How often the filter is applied.
    pub fn rounds(self) -> u32 {
        self.0
    }

    /// The smoothing that reaches as far in a map of which each pixel stands for `step` × `step` of these.
    pub(crate) fn coarser(self, step: usize) -> Self {
        let areas = step.saturating_mul(step).min(MOST as usize).max(1) as u32;
        if self == Self::NONE { self } else { Self((self.0 / areas).max(1)) }
    }
}

impl Default for Smoothing {
    fn default() -> Self {
        Self::LIGHT
    }
}

impl FromStr for Smoothing {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        match text {
            "none" => Ok(Self::NONE),
            "light" => Ok(Self::LIGHT),
            "strong" => Ok(Self::STRONG),
            _ => {
                let rounds = text.parse().ok().filter(|n| *n <= MOST).map(Self);
                rounds.ok_or_else(|| format!("found {text:?}; give none, light, strong or a number up to {MOST}"))
            }
        }
    }
}

impl TryFrom<String> for Smoothing {
    type Error = String;

    fn try_from(text: String) -> std::result::Result<Self, String> {
        text.parse()
    }
}

impl From<Smoothing> for String {
    fn from(smoothing: Smoothing) -> Self {
        smoothing.to_string()
    }
}

impl fmt::Display for Smoothing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::NONE => f.write_str("none"),
            Self::LIGHT => f.write_str("light"),
            Self::STRONG => f.write_str("strong"),
            Self(rounds) => write!(f, "{rounds}"),
        }
    }
}

/// The orientations (rad, NaN where masked) of a smoothed map, for pictures: without σ, which takes half of [`smooth`]'s time
/// and most of its memory. Needs 28 bytes per pixel meanwhile.
///
/// # Errors
/// `Cancelled`.
pub fn smoothed_orientation(map: &OrientationMaps, smoothing: Smoothing, progress: &dyn Progress) -> Result<Vec<f32>> {
    if smoothing == Smoothing::NONE {
        return Ok(map.orientation.clone());
    }
    let field = filtered::<{ kernel::VALUES }>(map, smoothing, 1.0, progress)?;
    Ok(field.pixels().map(|[c, s, weight, ..]| orientation(c, s, weight)).collect())
}

/// The smoothed map with its σ (rad). The mask stays as it is. `correlated` is how much larger the variance of a mean over
/// many pixels is than the pixels' σ say (1 for independent ones), because photographs were resampled. Needs 92 bytes per pixel
/// meanwhile.
///
/// # Errors
/// `Cancelled`.
pub fn smooth(
    map: &OrientationMaps,
    smoothing: Smoothing,
    correlated: f64,
    progress: &dyn Progress,
) -> Result<OrientationMaps> {
    let (width, height) = (map.width, map.height);
    if smoothing == Smoothing::NONE {
        return Ok(OrientationMaps { width, height, orientation: map.orientation.clone(), sigma: map.sigma.clone() });
    }
    let field = filtered::<{ kernel::TRACKED }>(map, smoothing, correlated as f32, progress)?;
    let found = field.pixels().zip(&map.sigma).map(|(pixel, before)| {
        let sigma = if pixel[2] > 0.0 { kernel::sigma(&pixel) } else { *before };
        (orientation(pixel[0], pixel[1], pixel[2]), sigma)
    });
    let (orientation, sigma) = found.unzip();
    Ok(OrientationMaps { width, height, orientation, sigma })
}

fn orientation(c: f32, s: f32, weight: f32) -> f32 {
    if weight > 0.0 { fold(0.5 * s.atan2(c)) } else { f32::NAN }
}

fn filtered<const PLANES: usize>(
    map: &OrientationMaps,
    smoothing: Smoothing,
    correlated: f32,
    progress: &dyn Progress,
) -> Result<Field<PLANES>> {
    let (reliability, median) = reliabilities(map);
    let filter = Filter::new(median, ANGLE_SIGMAS, ANGLE_LIMITS, smoothing.rounds());
    let mut now = Field::<PLANES>::new(map, &reliability);
    drop(reliability);
    let mut next = Field::<PLANES>::like(&now);
    progress.stage("smoothing", smoothing.rounds().into());
    for number in 0..smoothing.rounds() {
        filter.apply(&now, &mut next, Round { number, correlated }, progress);
        progress.check()?;
        std::mem::swap(&mut now, &mut next);
        progress.step();
    }
    Ok(now)
}

/// 1/σ² relative to the median pixel, 0 where masked; and that pixel's σ.
fn reliabilities(map: &OrientationMaps) -> (Vec<f32>, f32) {
    let valid = |i: &usize| map.orientation[*i].is_finite();
    let mut sigmas: Vec<f32> = (0..map.sigma.len()).filter(valid).step_by(13).map(|i| map.sigma[i]).collect();
    let median = median(&mut sigmas).unwrap_or(1.0);
    let square = median.max(f32::MIN_POSITIVE.sqrt()).powi(2);
    let reliability = |(theta, sigma): (&f32, &f32)| {
        let relative = square / sigma.powi(2).max(square / MOST_RELIABLE);
        if theta.is_finite() { relative } else { 0.0 }
    };
    (map.orientation.par_iter().zip(&map.sigma).map(reliability).collect(), median)
}
