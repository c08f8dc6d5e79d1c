//! Iteration with a stopping rule.

use super::{Deconvolution, Image, Method, Misfit, Noise, Psf};
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Maximum number of iterations.
pub const MAX_ITERATIONS: usize = 10_000;

/// Iterations tried beyond the best one so far, since the best may be a local minimum of the cost.
const PATIENCE: usize = 20;

/// Number of iterations.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Iterations {
    /// Stops when iterations fit more noise than structure, at the latest after this number.
    #[schemars(extend("x-bare" = 500))]
    Auto(usize),
    /// A fixed number.
    #[schemars(extend("x-nameless" = true))]
    Count(usize),
}

impl Iterations {
    /// Typical number for a photograph, used to predict computation time.
    pub fn usual(self) -> usize {
        /// Accelerated iterations that photographs of gratings typically need until only noise remains.
        const USUAL: usize = 30;
        match self {
            Self::Count(count) => count,
            Self::Auto(most) => most.min(USUAL),
        }
    }
}

impl Default for Iterations {
    /// Accelerated iterations converge long before this limit.
    fn default() -> Self {
        Self::Auto(500)
    }
}

/// A deconvolved photograph.
#[derive(Clone, Debug)]
pub struct Deconvolved {
    /// Light, as many values as the photograph has.
    pub light: Vec<f32>,
    /// Number of iterations that led to `light`.
    pub iterations: usize,
    /// True if the stopping rule ended the iterations; always true for a fixed number.
    pub converged: bool,
    /// Mean squared residual over noise variance, without the edges. For `light`, or for a fixed number of iterations
    /// before the last one.
    pub misfit: f64,
    /// Expected value of `misfit` for pure noise.
    pub expected: f64,
}

/// Deconvolves a photograph.
///
/// # Errors
/// `Input` as for [`Deconvolution::new`], and for an invalid number of iterations; `Cancelled`.
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
    if auto {
        return best_estimate(&mut run, most, progress);
    }
    let mut last = None;
    while run.iterations() < most {
        progress.check()?;
        last = Some(run.compare());
        run.update();
        progress.step();
    }
    let (misfit, expected) = last.map_or((0.0, 0.0), |last| (last.found, last.expected));
    Ok(Deconvolved { light: run.light(), iterations: most, converged: true, misfit, expected })
}

/// Among at most `most` iterations, returns the estimate with the lowest expected prediction error.
fn best_estimate(run: &mut Deconvolution, most: usize, progress: &dyn Progress) -> Result<Deconvolved> {
    let mut least = f64::INFINITY;
    let mut best = Deconvolved { light: vec![], iterations: 0, converged: false, misfit: 0.0, expected: 0.0 };
    run.compare();
    while run.iterations() < most {
        progress.check()?;
        run.update();
        let Misfit { found: misfit, expected, cost } = run.compare();
        let iterations = run.iterations();
        if cost < least || best.light.is_empty() {
            least = cost;
            best = Deconvolved { light: run.light(), iterations, converged: false, misfit, expected };
        } else if iterations >= best.iterations + PATIENCE {
            best.converged = true;
            break;
        }
        progress.step();
    }
    Ok(best)
}
