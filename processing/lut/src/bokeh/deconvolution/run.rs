//! All iterations.

use super::{Deconvolution, Image, Method, Misfit, Noise, Psf};
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Most iterations.
pub const MAX_ITERATIONS: usize = 10_000;

/// So many iterations are tried after the best one, which may be a local minimum.
const PATIENCE: usize = 20;

/// How many iterations.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Iterations {
    /// As many as find more structure than noise, at most this number.
    #[schemars(extend("x-bare" = 500))]
    Auto(usize),
    /// So many.
    #[schemars(extend("x-nameless" = true))]
    Count(usize),
}

impl Iterations {
    /// How many photographs usually take.
    pub fn usual(self) -> usize {
        /// Accelerated iterations until they find noise only, in photographs of gratings.
        const USUAL: usize = 30;
        match self {
            Self::Count(count) => count,
            Self::Auto(most) => most.min(USUAL),
        }
    }
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
    /// Iterations that led to it.
    pub iterations: usize,
    /// Whether they ended because more would have fitted noise; true for a number that was asked for.
    pub converged: bool,
    /// Mean squared misfit over the variance of the noise, of `light` or, where a number was asked for, before the last iteration; apart
    /// from the edges.
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
    if auto {
        return likeliest(&mut run, most, progress);
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

/// Of the first iterations, at most so many, the one whose estimate is expected to predict another photograph best.
fn likeliest(run: &mut Deconvolution, most: usize, progress: &dyn Progress) -> Result<Deconvolved> {
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
