//! Fits a closed curve to points. The residual is the distance of a point to the nearest point of the curve, in units
//! of its noise, with a robust cost (Levenberg and Marquardt with Cauchy weights).

use crate::film::cloud::CloudPoint;
use crate::film::curve::Curve;
use crate::film::normal::{CAUCHY, Lanes, Normal};
use crate::film::projection::{ClosestPoint, CurveSamples, LANE_COUNT, project, robust_scale};
use nacre_base::least_squares::{Damping, Problem, Step, levenberg_marquardt};
use nacre_base::vectors::vectorised;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Decrease of −2 ln likelihood below which the search ends; a step with a smaller expected decrease is skipped (1
/// corresponds to one standard deviation).
const CONVERGED: f64 = 0.01;

/// Damping of the fit.
const DAMPING: Damping = Damping { first: 1e-3, down: 0.2, least: 1e-9, up: 6.0, most: 1e9 };

/// Expected [mean cost](Fitted::cost) of points on the curve with their noise: `E[9 ln(1 + z²/9)]`.
pub const COST_OF_NOISE: f64 = 0.8735;

/// Prior distribution of a parameter.
#[derive(Clone, Copy)]
pub enum Prior {
    /// Flat: an angle with any value.
    Anything,
    /// Normal about 0, with this standard deviation.
    Near(f64),
    /// Cauchy about 0: half of the values are within this distance, and outliers are possible.
    Mostly(f64),
}

impl Prior {
    /// −2 ln prior of a value, up to a constant.
    fn cost(self, value: f64) -> f64 {
        match self {
            Self::Anything => 0.0,
            Self::Near(size) => (value / size).powi(2),
            Self::Mostly(size) => 2.0 * (value / size).powi(2).ln_1p(),
        }
    }

    /// Prior information at a value: the inverse of a variance.
    pub(crate) fn information(self, value: f64) -> f64 {
        match self {
            Self::Anything => 0.0,
            Self::Near(size) => size.powi(-2),
            Self::Mostly(size) => 2.0 / (size * size + value * value),
        }
    }

    /// Width of the prior; for angles half a turn.
    fn size(self) -> f64 {
        match self {
            Self::Anything => PI / 12f64.sqrt(),
            Self::Near(size) | Self::Mostly(size) => size,
        }
    }
}

/// A family of curves.
pub struct Family<'a> {
    /// The curve for given parameters.
    pub curve: &'a (dyn Fn(&[f64]) -> Curve + Sync),
    /// Prior of each parameter.
    pub priors: &'a [Prior],
    /// Largest absolute value of each parameter.
    pub limits: &'a [f64],
}

/// The best curve of a family.
#[derive(Clone)]
pub struct Fitted {
    /// Its parameters.
    pub parameters: Vec<f64>,
    /// The curve.
    pub curve: Curve,
    /// Robust −2 ln likelihood of the points, including the prior.
    pub cost: f64,
    /// −2 ln prior of the parameters.
    pub prior: f64,
    /// Inverse covariance of the parameters.
    pub information: DMatrix<f64>,
}

/// The fit of a family to points.
struct Search<'a> {
    family: &'a Family<'a>,
    points: &'a [CloudPoint],
}

/// Parameters of a search, with derived quantities.
struct Trial {
    at: Vec<f64>,
    closest_points: Vec<ClosestPoint>,
    /// Unit of distances in standard deviations: far points have full weight at first, and less as the curve
    /// approaches.
    scale: f64,
    cost: f64,
    /// Normal matrix and right side; computed when the parameters are accepted.
    normal: Option<(DMatrix<f64>, DVector<f64>)>,
}

/// The points contain no information.
struct NoInformation;

impl Search<'_> {
    fn at(&self, at: Vec<f64>) -> Trial {
        let closest_points = project(self.points, (self.family.curve)(&at));
        let scale = robust_scale(&closest_points);
        let mut trial = Trial { at, closest_points, scale, cost: f64::NAN, normal: None };
        self.complete(&mut trial);
        trial
    }

    fn complete(&self, trial: &mut Trial) {
        trial.cost = self.family.cost(&trial.closest_points, &trial.at, trial.scale);
        trial.normal = Some(self.family.normal(&trial.at, &trial.closest_points, trial.scale));
    }
}

impl Problem for Search<'_> {
    type State = Trial;
    type Error = NoInformation;

    fn cost(&self, trial: &Trial) -> f64 {
        trial.cost
    }

    fn step(&self, from: &Trial, damping: f64) -> Result<Step<Trial>, NoInformation> {
        let Some((information, score)) = &from.normal else { return Ok(Step::End) };
        let mut damped = information.clone();
        for k in 0..from.at.len() {
            damped[(k, k)] += damping * information[(k, k)].max(1e-12);
        }
        // The points contain no information about the common offset: only damping limits the step in that direction.
        let Some(factors) = damped.cholesky() else {
            return if damping * DAMPING.up > DAMPING.most { Err(NoInformation) } else { Ok(Step::Singular) };
        };
        let step = factors.solve(score);
        if step.dot(score) < CONVERGED {
            return Ok(Step::End);
        }
        let limited = from.at.iter().zip(step.iter()).zip(self.family.limits);
        let at: Vec<f64> = limited.map(|((a, s), l)| (a + s).clamp(-l, *l)).collect();
        let closest_points = project(self.points, (self.family.curve)(&at));
        let cost = self.family.cost(&closest_points, &at, from.scale);
        Ok(Step::Trial(Trial { at, closest_points, scale: from.scale, cost, normal: None }))
    }

    fn accept(&self, from: &Trial, to: &mut Trial) -> bool {
        let small = from.cost - to.cost < CONVERGED;
        let tighter = robust_scale(&to.closest_points);
        let settled = tighter > 0.9 * from.scale;
        to.scale = tighter.min(from.scale);
        self.complete(to);
        small && settled
    }
}

impl Family<'_> {
    /// Fits from a start; `None` if the points contain no information.
    pub fn fit(&self, points: &[CloudPoint], start: &[f64], iterations: usize) -> Option<Fitted> {
        let search = Search { family: self, points };
        let found = levenberg_marquardt(&search, search.at(start.to_vec()), DAMPING, iterations).ok()?;
        self.fitted(found.at, &found.closest_points)
    }

    /// Properties of a fit that ends at these parameters; `None` if the points contain no information.
    pub(crate) fn at(&self, points: &[CloudPoint], parameters: Vec<f64>) -> Option<Fitted> {
        let closest_points = project(points, (self.curve)(&parameters));
        self.fitted(parameters, &closest_points)
    }

    fn fitted(&self, parameters: Vec<f64>, closest_points: &[ClosestPoint]) -> Option<Fitted> {
        let information = self.normal(&parameters, closest_points, 1.0).0;
        let (curve, prior) = ((self.curve)(&parameters), self.prior(&parameters));
        let cost = self.cost(closest_points, &parameters, 1.0);
        cost.is_finite().then_some(Fitted { parameters, curve, cost, prior, information })
    }

    /// Robust cost with distances in units of `scale` standard deviations.
    pub(crate) fn cost(&self, closest_points: &[ClosestPoint], at: &[f64], scale: f64) -> f64 {
        let limit = (CAUCHY * scale).powi(2);
        // The logarithm of a product, which takes as long as that of one number.
        let of = |closest_points: &[ClosestPoint]| {
            closest_points.iter().map(|f| 1.0 + f.distance * f.distance / limit).product::<f64>()
        };
        let one = |f: &ClosestPoint| (1.0 + f.distance * f.distance / limit).ln();
        let few = |closest_points: &[ClosestPoint]| {
            Some(of(closest_points))
                .filter(|p| p.is_finite())
                .map_or_else(|| closest_points.iter().map(one).sum(), f64::ln)
        };
        let misfit = limit * closest_points.chunks(8).map(few).sum::<f64>();
        misfit / (scale * scale) + self.prior(at)
    }

    /// −2 ln prior of the parameters.
    pub(crate) fn prior(&self, at: &[f64]) -> f64 {
        at.iter().zip(self.priors).map(|(a, e)| e.cost(*a)).sum()
    }

    /// Prior information of each parameter.
    pub(crate) fn information(&self, at: &[f64]) -> Vec<f64> {
        at.iter().zip(self.priors).map(|(a, e)| e.information(*a)).collect()
    }

    /// Normal matrix and right side of a step.
    pub(crate) fn normal(
        &self,
        at: &[f64],
        closest_points: &[ClosestPoint],
        scale: f64,
    ) -> (DMatrix<f64>, DVector<f64>) {
        let n = at.len();
        let varied = self.varied(at);
        let middle = (self.curve)(at);
        let information = self.information(at);
        let mut right = DVector::from_iterator(n, at.iter().zip(&information).map(|(a, by)| -a * by));
        let mut matrix = DMatrix::from_diagonal(&information.into());
        let of_block = |closest_points: &[ClosestPoint]| {
            let mut sums = Normal::default();
            vectorised(
                #[inline(always)]
                || {
                    for closest_points in closest_points.chunks(LANE_COUNT) {
                        sums.add(&Lanes::new(closest_points, scale), &middle, &varied);
                    }
                },
            );
            sums
        };
        // Blocks of fixed size, added in order: the result does not depend on timing.
        let blocks: Vec<_> = closest_points.par_chunks(2048).map(of_block).collect();
        for block in blocks {
            for i in 0..n {
                right[i] += block.right[i].iter().sum::<f64>();
                for j in 0..=i {
                    matrix[(i, j)] += block.matrix[i][j].iter().sum::<f64>();
                }
            }
        }
        for i in 0..n {
            for j in i + 1..n {
                matrix[(i, j)] = matrix[(j, i)];
            }
        }
        (matrix, right)
    }

    /// The curve for a small change of each parameter, and the size of that change.
    pub(crate) fn varied(&self, at: &[f64]) -> Vec<(Curve, f64)> {
        const STEP: f64 = 1e-6;
        (0..at.len())
            .map(|k| {
                let mut varied = at.to_vec();
                varied[k] += STEP;
                ((self.curve)(&varied), STEP)
            })
            .collect()
    }

    /// Information gain about the parameters from points with `widened` times their noise variance: Laplace's factor as
    /// −2 ln of the posterior volume over the prior volume.
    pub fn information_gain(&self, fitted: &Fitted, widened: f64) -> f64 {
        let sizes: Vec<f64> = self.priors.iter().map(|e| e.size()).collect();
        let (n, information) = (sizes.len(), self.information(&fitted.parameters));
        let scaled = DMatrix::from_fn(n, n, |i, j| {
            let prior = if i == j { information[i] } else { 0.0 };
            let information_gain = (fitted.information[(i, j)] - prior) / widened * sizes[i] * sizes[j];
            information_gain + if i == j { 1.0 } else { 0.0 }
        });
        scaled.symmetric_eigen().eigenvalues.iter().map(|v| v.max(1.0).ln()).sum()
    }

    /// Root mean square orientation error of `points` in rad caused by the uncertainty of the parameters, without the
    /// common offset; `widened` multiplies the variance of the points.
    pub fn spread(&self, fitted: &Fitted, points: &[CloudPoint], widened: f64) -> f64 {
        let n = fitted.parameters.len();
        let curve_samples = CurveSamples::new(fitted.curve);
        let varied = self.varied(&fitted.parameters);
        let rows: Vec<DVector<f64>> = points
            .iter()
            .map(|point| {
                let theta = curve_samples.closest_point(point).theta;
                let (q, t) = fitted.curve.with_tangent(theta);
                let [a, b, c] = point.weights();
                let (wx, wy) = (a * t[0] + b * t[1], b * t[0] + c * t[1]);
                let speed = (wx * t[0] + wy * t[1]).max(f64::MIN_POSITIVE);
                DVector::from_iterator(
                    n,
                    varied.iter().map(|(curve, step)| {
                        let p = curve.at(theta);
                        -(wx * (p[0] - q[0]) + wy * (p[1] - q[1])) / speed / step
                    }),
                )
            })
            .collect();
        let mean = rows.iter().fold(DVector::zeros(n), |sum, row| sum + row) / rows.len().max(1) as f64;
        // Directions without information correspond to the common offset, which rotates all orientations alike.
        let eigen = fitted.information.clone().symmetric_eigen();
        let floor = 1e-12 * eigen.eigenvalues.max();
        let mut total = 0.0;
        for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
            let variance = widened / value.max(floor);
            // The linearisation is not valid beyond this variance.
            let variance = variance.min(1.0);
            let square =
                rows.iter().map(|row| (row - &mean).dot(&vector).powi(2)).sum::<f64>() / rows.len().max(1) as f64;
            total += variance * square;
        }
        total.sqrt()
    }
}
