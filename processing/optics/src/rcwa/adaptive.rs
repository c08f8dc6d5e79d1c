//! Choice of the cheapest setting that meets a requested error.

use super::{Grating, Light, Order, Orders, Polarization, coordinates, slices};
use nacre_base::{Error, Result};
use std::f64::consts::TAU;

/// Initial number of harmonics beyond the phase depth in rad, and increment per step.
const FIRST: usize = 3;
const MORE: usize = 2;
/// Largest number of harmonics of either method. Beyond, rounding errors grow faster than truncation errors fall.
const MOST: usize = 36;

/// Solver and its numerical settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Coordinate (Chandezon) method.
    Coordinates {
        /// Number of harmonics; `2·harmonics + 1` waves are coupled.
        harmonics: usize,
    },
    /// Rigorous coupled-wave analysis of a staircase.
    Slices {
        /// Number of harmonics; `2·harmonics + 1` waves are coupled.
        harmonics: usize,
        /// Number of slices.
        count: usize,
    },
}

/// Diffraction orders with the setting by which they were computed.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// All propagating orders.
    pub orders: Orders,
    /// Solver and settings.
    pub method: Method,
    /// Predicted error: the largest change of a reflected amplitude from the next cheaper setting. It is an upper bound
    /// while each step at least halves the error.
    pub predicted_error: f64,
}

impl Solution {
    /// Reflected order `m`; zero amplitude if it does not propagate.
    pub fn reflected(&self, m: i32) -> Order {
        self.orders.reflected(m)
    }
}

impl Method {
    /// Solves the diffraction problem with this setting.
    ///
    /// # Errors
    /// As [`coordinates()`] and [`slices()`].
    pub fn run(self, grating: &Grating, light: &Light, polarization: Polarization) -> Result<Orders> {
        match self {
            Self::Coordinates { harmonics } => coordinates(grating, light, polarization, harmonics),
            Self::Slices { harmonics, count } => slices(grating, light, polarization, harmonics, count),
        }
    }
}

/// Solves for amplitudes with errors of at most `max_error` (absolute; the incident amplitude is 1).
///
/// The coordinate method is tried first, with an increasing number of harmonics: its error falls exponentially for a
/// smooth profile. The staircase follows for profiles that are too steep. It is not used for TM on metal, where its
/// error of several per cent falls unevenly and cannot be predicted. There its corners carry fields that the smooth
/// surface does not have.
///
/// # Errors
/// `Input` for unphysical parameters, or if no setting reaches `max_error`; the message states the smallest error.
pub fn solve(grating: &Grating, light: &Light, polarization: Polarization, max_error: f64) -> Result<Solution> {
    super::check(grating, light)?;
    // Number of significant orders of a phase screen of this depth (rad).
    let depth = TAU * grating.above * grating.depth_um * 1000.0 / light.wavelength_nm;
    let first = FIRST + (depth.ceil() as usize).min(MOST - FIRST - MORE);
    let run = |method: Method| method.run(grating, light, polarization);
    let smooth = (first..=MOST).step_by(MORE).map(|harmonics| Method::Coordinates { harmonics });
    let mut best = match climb(smooth, max_error, run) {
        Found::Enough(solution) => return Ok(solution),
        Found::Best(best) => best,
    };
    let metal = (grating.below * grating.below).re < 0.0;
    if !(metal && polarization == Polarization::Tm) {
        let doubled = (0..4).map(|k| Method::Slices { harmonics: (first + 4 * k).min(MOST), count: 12 << k });
        match climb(doubled, max_error, run) {
            Found::Enough(solution) => return Ok(solution),
            Found::Best(other) => best = best.min(other),
        }
    }
    Err(Error::input(
        "grating",
        format!("its diffraction was found to {best:.1e}, not to {max_error:.1e}"),
        "ask for a larger error, or a shallower grating",
    ))
}

/// First solution that meets the error, or the smallest predicted error.
enum Found {
    Enough(Solution),
    Best(f64),
}

fn climb(settings: impl Iterator<Item = Method>, max_error: f64, run: impl Fn(Method) -> Result<Orders>) -> Found {
    let (mut last, mut best): (Option<Orders>, f64) = (None, f64::INFINITY);
    for method in settings {
        // A setting that fails is skipped; the next one may succeed.
        let Ok(orders) = run(method) else { continue };
        let predicted_error = last.as_ref().map_or(f64::INFINITY, |last| change(last, &orders));
        if predicted_error <= max_error {
            return Found::Enough(Solution { orders, method, predicted_error });
        }
        best = best.min(predicted_error);
        last = Some(orders);
    }
    Found::Best(best)
}

/// Largest difference of the reflected amplitudes.
fn change(a: &Orders, b: &Orders) -> f64 {
    b.reflected.iter().map(|o| (o.amplitude - a.reflected(o.m).amplitude).norm()).fold(0.0, f64::max)
}
