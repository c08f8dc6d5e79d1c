//! All iterations.

use super::{Deconvolution, Image, Method, Misfit, Noise, Psf};
use crate::progress::Progress;
use crate::{Error, Result};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Most iterations.
pub const MAX_ITERATIONS: usize = 10_000;

/// How many iterations.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Iterations {
    /// Until another one would fit more noise than structure, at most so many.
    Auto(usize),
    /// So many.
    Count(usize),
}

impl Default for Iterations {
    /// Accelerated ones have long ended by then.
    fn default() -> Self {
        Self::Auto(500)
    }
}

/// A deconvolved photograph.
#[derive(Clone, Debug)]
pub struct Deconvolved {
    /// Light, as many values as the photograph has.
    pub light: Vec<f32>,
    /// Iterations that were done.
    pub iterations: usize,
    /// Whether they ended because another one would have fitted noise; true for a number that was asked for.
    pub converged: bool,
    /// Mean squared misfit over the variance of the noise, before the last iteration.
    pub misfit: f64,
    /// What noise alone would leave of it.
    pub expected: f64,
}

/// Deconvolves a photograph.
///
/// # Errors
/// `Input` as for [`Deconvolution::new`], and for a number of iterations that makes no sense; `Cancelled`.
pub fn deconvolve(
    image: &Image,
    psf: &Psf,
    noise: Option<Noise>,
    method: &Method,
    iterations: Iterations,
    progress: &dyn Progress,
) -> Result<Deconvolved> {
    let (Iterations::Auto(most) | Iterations::Count(most)) = iterations;
    if !(1..=MAX_ITERATIONS).contains(&most) {
        let problem = format!("is {most}; expected 1 to {MAX_ITERATIONS}");
        return Err(Error::input("number of iterations", problem, "give auto, or 10 to 100"));
    }
    let auto = matches!(iterations, Iterations::Auto(_));
    if auto && noise.is_none() {
        return Err(Error::input("iterations", "auto needs the noise", "give it, or a number of iterations"));
    }
    let mut run = Deconvolution::new(image, psf, noise, method)?;
    progress.stage("deconvolving", most as u64);
    let none = Misfit { found: f64::INFINITY, expected: 1.0, cost: f64::INFINITY };
    let mut last = none;
    let mut converged = !auto;
    while run.iterations() < most {
        progress.check()?;
        let now = run.compare();
        if auto && now.cost >= last.cost {
            // An extrapolation may have gone too far.
            if run.settle() {
                last = none;
                continue;
            }
            converged = true;
            break;
        }
        run.update();
        last = now;
        progress.step();
    }
    let Misfit { found: misfit, expected, .. } = last;
    Ok(Deconvolved { light: run.light(), iterations: run.iterations(), converged, misfit, expected })
}
