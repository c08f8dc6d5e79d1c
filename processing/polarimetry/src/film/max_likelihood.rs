//! Maximises the likelihood, starting from a fit by distances. Where a curve bends within the noise, or has a close
//! second branch, the nearest point is often not the true origin of a point. The distances are then biased beyond their
//! statistical error.

use crate::film::cloud::{CloudPoint, SAMPLE, thinned};
use crate::film::curve::Curve;
use crate::film::curve_fit::{Family, Fitted};
use crate::film::npmle;
use crate::film::projection::project;
use crate::film::score::Score;
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
pub(crate) fn maximise_likelihood(family: &Family<'_>, fit: &Fitted, points: &[CloudPoint]) -> Fitted {
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
struct Trial {
    parameters: Vec<f64>,
    misfit: f64,
    score: DVector<f64>,
    information: DMatrix<f64>,
}

impl Objective<'_> {
    fn at(&self, parameters: Vec<f64>) -> Trial {
        let Self { family, points, few, scale } = *self;
        let curve = (family.curve)(&parameters);
        let by_distance = |points: &[CloudPoint]| {
            let closest_points = project(points, curve);
            let (information, score) = family.normal(&parameters, &closest_points, 1.0);
            (family.cost(&closest_points, &parameters, 1.0), score, information)
        };
        let (all, of_all, information) = by_distance(points);
        let (sample, of_sample) = if few.len() < points.len() {
            let (cost, score, _) = by_distance(few);
            (cost, score)
        } else {
            (all, of_all.clone())
        };
        let scores = npmle::score(few, &curve);
        let likelihood = scores.misfit + family.prior(&parameters);
        let score = of_all + (self.score(&parameters, &curve, &scores) - of_sample) * scale;
        Trial { misfit: all + scale * (likelihood - sample), score, information, parameters }
    }

    /// Score of the sample: the force at each support point times its displacement per parameter (Fisher's identity).
    fn score(&self, at: &[f64], curve: &Curve, scores: &Score) -> DVector<f64> {
        let mut score =
            DVector::from_iterator(at.len(), at.iter().zip(self.family.information(at)).map(|(a, by)| -a * by));
        for (k, (varied, by)) in self.family.varied(at).iter().enumerate() {
            let along = |score: [f64; 2], before: [f64; 2], after: [f64; 2]| {
                (score[0] * (after[0] - before[0]) + score[1] * (after[1] - before[1])) / by
            };
            score[k] +=
                scores.support.iter().map(|p| along(p.score, curve.at(p.theta), varied.at(p.theta))).sum::<f64>();
            if let (Some(before), Some(after)) = (curve.mirror, varied.mirror) {
                score[k] += along(scores.mirror, before, after);
            }
        }
        score
    }
}

impl Problem for Objective<'_> {
    type State = Trial;
    type Error = Infallible;

    fn cost(&self, trial: &Trial) -> f64 {
        trial.misfit
    }

    fn step(&self, from: &Trial, damping: f64) -> Result<Step<Trial>, Infallible> {
        let mut information = from.information.clone();
        // The points contain no information about the common offset: only damping limits the step in that direction.
        for k in 0..from.parameters.len() {
            information[(k, k)] += damping * information[(k, k)].max(1e-12);
        }
        let step = information.cholesky().map(|factors| factors.solve(&from.score));
        let Some(step) = step.filter(|step| step.dot(&from.score) > CONVERGED) else { return Ok(Step::End) };
        let limited = from.parameters.iter().zip(step.iter()).zip(self.family.limits);
        Ok(Step::Trial(self.at(limited.map(|((a, s), l)| (a + s).clamp(-l, *l)).collect())))
    }

    fn accept(&self, from: &Trial, to: &mut Trial) -> bool {
        from.misfit - to.misfit < CONVERGED
    }
}
