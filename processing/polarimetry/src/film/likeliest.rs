//! Maximises the likelihood, starting from a fit by distances. Where a curve bends within the noise, or has a close
//! second branch, the nearest point is often not the true origin of a point. The distances are then biased beyond their
//! statistical error.

use crate::film::cloud::{CloudPoint, SAMPLE, thinned};
use crate::film::curve::Curve;
use crate::film::curve_fit::{Family, Fitted};
use crate::film::foot::feet;
use crate::film::mixture::pulls;
use crate::film::pulls::Pulls;
use nacre_base::least_squares::{Damping, Problem, Step, levenberg_marquardt};
use nalgebra::{DMatrix, DVector};
use std::convert::Infallible;

/// Maximum number of steps.
const STEPS: usize = 10;

/// Damping of the search.
const DAMPING: Damping = Damping { first: 1e-3, down: 0.1, least: 0.0, up: 10.0, most: f64::INFINITY };

/// Decrease of −2 ln likelihood below which the search ends; a step with a smaller expected decrease is skipped. The
/// weights of the sample have an uncertainty of this order.
const CONVERGED: f64 = 2.0;

/// Maximises the likelihood over the parameters, with the distribution of orientations fitted too.
///
/// The difference between that likelihood and the distances of all points is computed on a sample. Both have nearly the
/// same sampling error, which therefore cancels (a control variate).
pub(crate) fn likeliest(family: &Family<'_>, fit: &Fitted, points: &[CloudPoint]) -> Fitted {
    let few = thinned(points, SAMPLE);
    let objective = Objective { family, points, few: &few, scale: points.len() as f64 / few.len().max(1) as f64 };
    let Ok(best) = levenberg_marquardt(&objective, objective.at(fit.parameters.clone()), DAMPING, STEPS);
    family.at(points, best.parameters).unwrap_or_else(|| fit.clone())
}

/// All points and the sample, each point of which represents `scale` points.
struct Objective<'a> {
    family: &'a Family<'a>,
    points: &'a [CloudPoint],
    few: &'a [CloudPoint],
    scale: f64,
}

/// Parameters with their −2 ln likelihood, half its negative gradient, and their information matrix.
struct Tried {
    parameters: Vec<f64>,
    score: f64,
    slope: DVector<f64>,
    information: DMatrix<f64>,
}

impl Objective<'_> {
    fn at(&self, parameters: Vec<f64>) -> Tried {
        let Self { family, points, few, scale } = *self;
        let curve = (family.curve)(&parameters);
        let by_distance = |points: &[CloudPoint]| {
            let feet = feet(points, curve);
            let (information, slope) = family.normal(&parameters, &feet, 1.0);
            (family.cost(&feet, &parameters, 1.0), slope, information)
        };
        let (all, of_all, information) = by_distance(points);
        let (sample, of_sample) = if few.len() < points.len() {
            let (cost, slope, _) = by_distance(few);
            (cost, slope)
        } else {
            (all, of_all.clone())
        };
        let pulled = pulls(few, &curve);
        let likelihood = pulled.misfit + family.prior(&parameters);
        let slope = of_all + (self.slope(&parameters, &curve, &pulled) - of_sample) * scale;
        Tried { score: all + scale * (likelihood - sample), slope, information, parameters }
    }

    /// Score of the sample: the force at each support point times its displacement per parameter (Fisher's identity).
    fn slope(&self, at: &[f64], curve: &Curve, pulled: &Pulls) -> DVector<f64> {
        let mut slope = DVector::from_iterator(at.len(), at.iter().zip(self.family.pull(at)).map(|(a, by)| -a * by));
        for (k, (moved, by)) in self.family.moved(at).iter().enumerate() {
            let along = |pull: [f64; 2], before: [f64; 2], after: [f64; 2]| {
                (pull[0] * (after[0] - before[0]) + pull[1] * (after[1] - before[1])) / by
            };
            slope[k] += pulled.places.iter().map(|p| along(p.pull, curve.at(p.theta), moved.at(p.theta))).sum::<f64>();
            if let (Some(before), Some(after)) = (curve.mirror, moved.mirror) {
                slope[k] += along(pulled.mirror, before, after);
            }
        }
        slope
    }
}

impl Problem for Objective<'_> {
    type State = Tried;
    type Error = Infallible;

    fn cost(&self, tried: &Tried) -> f64 {
        tried.score
    }

    fn step(&self, from: &Tried, damping: f64) -> Result<Step<Tried>, Infallible> {
        let mut information = from.information.clone();
        // The points contain no information about the common offset: only damping limits the step in that direction.
        for k in 0..from.parameters.len() {
            information[(k, k)] += damping * information[(k, k)].max(1e-12);
        }
        let step = information.cholesky().map(|factors| factors.solve(&from.slope));
        let Some(step) = step.filter(|step| step.dot(&from.slope) > CONVERGED) else { return Ok(Step::End) };
        let limited = from.parameters.iter().zip(step.iter()).zip(self.family.limits);
        Ok(Step::Trial(self.at(limited.map(|((a, s), l)| (a + s).clamp(-l, *l)).collect())))
    }

    fn accept(&self, from: &Tried, to: &mut Tried) -> bool {
        from.score - to.score < CONVERGED
    }
}
