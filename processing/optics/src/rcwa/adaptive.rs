//! The cheapest setting that meets a requested error.

use super::{Grating, Light, Order, Orders, Polarization, coordinates, slices};
use nacre_base::{Error, Result};
use std::f64::consts::TAU;

/// Harmonics beyond the depth in radians to begin with, and how many more each try takes.
const FIRST: usize = 3;
const MORE: usize = 2;
/// Most harmonics of either method: beyond, rounding grows faster than the error falls.
const MOST: usize = 36;

/// A method with its knobs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Coordinates that follow the surface.
    Coordinates {
        /// Coupled waves are `2·harmonics + 1`.
        harmonics: usize,
    },
    /// Staircase.
    Slices {
        /// Coupled waves are `2·harmonics + 1`.
        harmonics: usize,
        /// Number of slices.
        count: usize,
    },
}

/// Orders with the setting that gave them.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// All propagating orders.
    pub orders: Orders,
    /// The setting that was used.
    pub method: Method,
    /// Largest change of a reflected amplitude from the next cheaper setting: an upper bound while the error at least
    /// halves from one to the next.
    pub predicted_error: f64,
}

impl Solution {
    /// A reflected order; no light when it does not propagate.
    pub fn reflected(&self, m: i32) -> Order {
        self.orders.reflected(m)
    }
}

impl Method {
    /// Runs the method.
    ///
    /// # Errors
    /// As [`coordinates`] and [`slices`].
    pub fn run(self, grating: &Grating, light: &Light, polarization: Polarization) -> Result<Orders> {
        match self {
            Self::Coordinates { harmonics } => coordinates(grating, light, polarization, harmonics),
            Self::Slices { harmonics, count } => slices(grating, light, polarization, harmonics, count),
        }
    }
}

/// Diffraction with amplitudes good to `max_error` (absolute; the incident amplitude is 1).
///
/// Settings are tried from the cheapest on: the coordinate method with ever more harmonics, because on a smooth
/// profile its error falls exponentially; then, for profiles too steep for it, the staircase. In TM on metal the
/// staircase is not asked: its error is some percent, falls unevenly, and so cannot be predicted (its corners carry
/// fields that the smooth surface has not).
///
/// # Errors
/// Numbers that are not physical; an error that no setting reaches, with the best one that was.
pub fn solve(grating: &Grating, light: &Light, polarization: Polarization, max_error: f64) -> Result<Solution> {
    super::check(grating, light)?;
    // A phase screen of this depth (rad) has that many orders that matter, and a few more.
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

/// The first solution that is good enough, or the smallest error predicted.
enum Found {
    Enough(Solution),
    Best(f64),
}

fn climb(settings: impl Iterator<Item = Method>, max_error: f64, run: impl Fn(Method) -> Result<Orders>) -> Found {
    let (mut last, mut best): (Option<Orders>, f64) = (None, f64::INFINITY);
    for method in settings {
        // A setting that fails is no answer; the next may be one.
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

/// Largest difference of a reflected amplitude.
fn change(a: &Orders, b: &Orders) -> f64 {
    b.reflected.iter().map(|o| (o.amplitude - a.reflected(o.m).amplitude).norm()).fold(0.0, f64::max)
}
