//! Analyser-angle errors, estimated from the photographs themselves.
//!
//! An analyser-angle error δ changes the intensity by δ·dI/dψ, with the same δ for all pixels but a different factor
//! for each. The fit absorbs part of this pattern. A common rotation of all angles only changes the common offset of
//! the orientations, and three parameters are fitted to the N intensities of a pixel. The remaining residuals determine
//! the errors δ jointly by least squares, as far as they are observable.
//!
//! Drift of the light changes the intensity in proportion. Both effects look the same where few orientations are in
//! view. They always do for angle errors proportional to sin 2(ψ - φ) together with light proportional to cos 2(ψ - φ).
//! These change the polarization of all light alike (boosts of the cone of [1, cos 2ψ, sin 2ψ]). Before angles are
//! corrected, both are therefore estimated jointly, each with a prior variance equal to that of its kind.

use crate::angles::sample::{AREA, Sample};
use crate::film::cloud::CloudPoint;
use crate::fit::views::View;
use crate::{Design, StokesMaps};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use std::f64::consts::PI;
use std::ops::Range;

/// Combinations of angles with less information than this fraction of the best one's (as a variance) count as
/// unobservable.
const MIN_INFORMATION: f64 = 1e-4;

/// Iterations of the weighting.
const ROUNDS: usize = 20;

/// Iterations of the angle estimate: for errors of 5° the neglected terms are of second order in one iteration, 0.4°,
/// and of fourth order in two.
const PASSES: usize = 4;

/// Step in rad below which the iteration ends.
const CONVERGED: f64 = 1e-6;

/// Iterations of the estimate of both prior variances, and their initial value: 0.5° for angles, 1 % for the light.
const PRIOR_ITERATIONS: usize = 40;
const INITIAL_VARIANCE: f64 = 1e-4;

/// Relative change of the prior variances that ends the iterations.
const PRIOR_CONVERGED: f64 = 0.01;

/// Combinations of errors with less information than this fraction of the best one's are unobservable: their
/// information is rounding error.
const EXACT: f64 = 1e-9;

/// Root mean square angle error in rad below which rereading the photographs is not worthwhile: twelve angles with
/// random errors of 0.05° cause orientation errors of 0.01°. The distortion of a circle by errors of 0.1° may already
/// be mistaken for a film.
const MIN_RMS: f64 = 0.05 * PI / 180.0;

/// Root mean square change of the light between photographs from which a warning is issued, and its minimum in standard
/// deviations. A change of 0.1 % shifts points by about the noise of a good camera's pixel.
const DRIFT: f64 = 1e-3;
const DRIFT_SIGMA: f64 = 5.0;

/// Smallest variance of the polarization over the pixels, relative to the squared light, for which angle errors and
/// light changes can be distinguished. It corresponds to a scatter of the points (S1/S0, S2/S0) of 3 %.
const VARIED: f64 = 1e-3;

/// Largest remaining standard deviation, relative to the root mean square error, for which a correction is applied.
const MAX_RELATIVE_SIGMA: f64 = 0.5;

/// Standard deviation of the analyser's angle errors in rad, about their stated values. `maps` is the fit of these
/// views, in blocks of 64 pixels. `None` for three angles, which leave no residuals, and if no combination of angles is
/// observable.
pub fn angle_sigma(views: &[&[f32]], design: &Design, maps: &StokesMaps) -> Option<f64> {
    let modes = Evidence::new(views, design, maps)?.modes()?;
    Some(scatter(&modes.amplitudes, &modes.noise).sqrt())
}

/// Analyser-angle errors of the individual views.
#[derive(Clone, Debug)]
pub struct AngleErrorEstimate {
    /// True minus stated angle per view in rad. The mean, which is unobservable, is set to 0.
    pub errors: Vec<f64>,
    /// Standard deviation of the estimated errors in rad.
    pub sigma: f64,
    /// Relative change of the light of each view. The mean, which is unobservable, is set to 0.
    pub light_changes: Vec<f64>,
    /// Standard deviation of the estimated light changes.
    pub light_sigma: f64,
}

impl AngleErrorEstimate {
    /// Whether rereading the photographs with corrected angles is worthwhile.
    pub(crate) fn is_worth_correcting(&self) -> bool {
        let rms = root_mean_square(&self.errors);
        rms > MIN_RMS && self.sigma < MAX_RELATIVE_SIGMA * rms
    }

    /// Root mean square change of the light, if it is significant.
    pub(crate) fn drift(&self) -> Option<f64> {
        Some(root_mean_square(&self.light_changes)).filter(|rms| *rms > DRIFT && DRIFT_SIGMA * self.light_sigma < *rms)
    }
}

/// Estimates the errors of analyser angles (rad) from views in blocks of 64 pixels. `stated` is their stated standard
/// deviation; `fit` solves the views for other angles. `None` if no correction is worthwhile.
pub fn angle_errors(
    views: &[&[f32]],
    angles: &[f64],
    stated: Option<f64>,
    fit: impl Fn(&[f64], &Design) -> StokesMaps,
) -> Option<AngleErrorEstimate> {
    estimate(views, angles, stated, fit).filter(AngleErrorEstimate::is_worth_correcting)
}

/// As [`angle_errors`], also for errors that are not worth a correction. `None` if nothing is observable.
pub(super) fn estimate(
    views: &[&[f32]],
    angles: &[f64],
    stated: Option<f64>,
    fit: impl Fn(&[f64], &Design) -> StokesMaps,
) -> Option<AngleErrorEstimate> {
    if stated.is_some_and(|s| s <= 0.0) {
        return None;
    }
    let n = angles.len();
    if !is_varied(views, angles, &fit)? {
        return None;
    }
    let mut errors: DVector<f64> = DVector::zeros(n);
    let mut last = None;
    for _ in 0..PASSES {
        let moved: Vec<f64> = angles.iter().zip(&errors).map(|(a, e)| a + e).collect();
        let design = Design::new(&moved).ok()?;
        let (found, covariance) =
            Evidence::new(views, &design, &fit(&moved, &design))?.max_posterior(&errors, stated)?;
        let step = found.rows(ANGLE * n, n).into_owned();
        errors += &step;
        last = Some((found, covariance));
        if step.norm() < CONVERGED || root_mean_square(errors.as_slice()) < 0.5 * MIN_RMS {
            break;
        }
    }
    let (found, covariance) = last?;
    // A common rotation is unobservable and irrelevant, as is a common change of the light.
    let centred = |all: DVector<f64>| all.add_scalar(-all.mean()).iter().copied().collect();
    let sigma = |kind: usize| {
        let own = covariance.view((kind * n, kind * n), (n, n));
        ((own.trace() - own.sum() / n as f64) / (n - 1) as f64).max(0.0).sqrt()
    };
    let light_changes = centred(found.rows(LIGHT * n, n).into_owned());
    Some(AngleErrorEstimate { errors: centred(errors), sigma: sigma(ANGLE), light_changes, light_sigma: sigma(LIGHT) })
}

/// Whether polarization varies over the pixels. Otherwise angle errors and light changes cannot be distinguished.
fn is_varied(views: &[&[f32]], angles: &[f64], fit: impl Fn(&[f64], &Design) -> StokesMaps) -> Option<bool> {
    let design = Design::new(angles).ok()?;
    let moments = Evidence::new(views, &design, &fit(angles, &design))?.all().moments;
    let mut eigenvalues: Vec<f64> = moments.symmetric_eigenvalues().iter().copied().collect();
    eigenvalues.sort_by(f64::total_cmp);
    Some(eigenvalues[1] > VARIED * eigenvalues[2])
}

fn root_mean_square(errors: &[f64]) -> f64 {
    (errors.iter().map(|e| e * e).sum::<f64>() / errors.len().max(1) as f64).sqrt()
}

/// Variance of amplitudes in excess of their noise, weighted by precision.
fn scatter(amplitudes: &[f64], noise: &[f64]) -> f64 {
    let n = amplitudes.len() as f64;
    let mut variance = amplitudes.iter().map(|a| a * a).sum::<f64>() / n;
    for _ in 0..ROUNDS {
        let (mut weights, mut sum) = (f64::MIN_POSITIVE, 0.0);
        for (a, noise) in amplitudes.iter().zip(noise) {
            let weight = (variance + noise).max(1e-30).powi(-2);
            weights += weight;
            sum += weight * (a * a - noise);
        }
        variance = (sum / weights).max(0.0);
    }
    variance
}

/// Mean squared displacement of points caused by random angle errors of this standard deviation (rad), relative to the
/// noise variance of the points. A common rotation of all angles, which only offsets all orientations, is excluded.
pub(crate) fn distorted(points: &[CloudPoint], maps: &StokesMaps, design: &Design, sigma: f64) -> f64 {
    let columns: Vec<_> = design.rows.iter().map(|x| design.inverse * x).collect();
    let of_point = |point: &CloudPoint| {
        let [x, y] = point.at;
        let light = f64::from(maps.s0[point.pixel]);
        let [c, s] = [maps.s1[point.pixel], maps.s2[point.pixel]].map(|v| f64::from(v) / light);
        let moves: Vec<[f64; 2]> = (columns.iter().zip(&design.rows))
            .map(|(m, row)| [m[1] - x * m[0], m[2] - y * m[0]].map(|by| 2.0 * (s * row[1] - c * row[2]) * by))
            .collect();
        let mean = [0, 1].map(|i| moves.iter().map(|m| m[i]).sum::<f64>() / moves.len() as f64);
        let [a, b, d] = point.weights();
        let square = |m: &[f64; 2]| {
            let [u, v] = [0, 1].map(|i| m[i] - mean[i]);
            a * u * u + 2.0 * b * u * v + d * v * v
        };
        0.5 * moves.iter().map(square).sum::<f64>()
    };
    sigma * sigma * points.iter().map(of_point).sum::<f64>() / points.len().max(1) as f64
}

/// Residual matrix of the fit: identity minus hat matrix.
fn residual_matrix(design: &Design) -> DMatrix<f64> {
    let n = design.frames();
    DMatrix::from_fn(n, n, |k, l| f64::from(u8::from(k == l)) - design.rows[k].dot(&(design.inverse * design.rows[l])))
}

/// Observable combinations of angles: their amplitudes in rad, and the variances of these.
struct Modes {
    amplitudes: Vec<f64>,
    noise: Vec<f64>,
}

/// Information of the residuals about angles and about the light of the views.
struct Evidence {
    /// Intensity derivatives of each view.
    directions: Vec<[Vector3<f64>; 2]>,
    residual_matrix: DMatrix<f64>,
    blocks: Vec<BlockScore>,
}

impl Evidence {
    /// `None` if the fit has no residual degrees of freedom.
    fn new(views: &[&[f32]], design: &Design, maps: &StokesMaps) -> Option<Self> {
        if design.freedom() == 0 {
            return None;
        }
        let directions: Vec<_> = design.rows.iter().map(directions).collect();
        let blocks = (0..maps.s0.len() / AREA).map(|b| b * AREA..(b + 1) * AREA);
        let blocks = blocks.map(|block| BlockScore::new(views, design, &directions, maps, block)).collect();
        Some(Self { directions, residual_matrix: residual_matrix(design), blocks })
    }

    fn all(&self) -> BlockScore {
        let mut all = BlockScore::none(self.directions.len());
        self.blocks.iter().for_each(|w| all.add(w));
        all
    }

    /// The observable combinations of angles for known light.
    fn modes(&self) -> Option<Modes> {
        let all = self.all();
        let eigen = self.information(&all, ANGLE, ANGLE).symmetric_eigen();
        let largest = eigen.eigenvalues.max();
        let observable: Vec<usize> =
            (0..eigen.eigenvalues.len()).filter(|j| eigen.eigenvalues[*j] > MIN_INFORMATION * largest).collect();
        if observable.is_empty() || largest <= 0.0 {
            return None;
        }
        let vectors: Vec<DVector<f64>> =
            observable.iter().map(|j| eigen.eigenvectors.column(*j).into_owned()).collect();
        let values: Vec<f64> = observable.iter().map(|j| eigen.eigenvalues[*j]).collect();
        let amplitude = |(v, value): (&DVector<f64>, &f64)| v.dot(&all.scores[ANGLE]) / value;
        let amplitudes: Vec<f64> = vectors.iter().zip(&values).map(amplitude).collect();
        let none = DVector::zeros(self.directions.len());
        let errors = vectors.iter().zip(&amplitudes).fold(none, |sum, (v, a)| sum + v * *a);
        // Variance from independent blocks (Huber 1967): the scatter of their scores includes noise, edges and all
        // other disturbances.
        let mut noise = vec![0.0; observable.len()];
        for block in &self.blocks {
            let off = &block.scores[ANGLE] - self.information(block, ANGLE, ANGLE) * &errors;
            for ((noise, v), value) in noise.iter_mut().zip(&vectors).zip(&values) {
                *noise += (v.dot(&off) / value).powi(2);
            }
        }
        Some(Modes { amplitudes, noise })
    }

    /// Posterior mean and covariance of further angle errors and light changes, in this order, after angles were
    /// already corrected by `moved`. The prior variances are estimated from the residuals (empirical Bayes, by
    /// expectation maximisation); the stated variance of angles takes precedence.
    fn max_posterior(&self, moved: &DVector<f64>, stated: Option<f64>) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let (all, n) = (self.all(), moved.len());
        let (information, mut score) = (self.both(&all), both_scores(&all));
        // Unobservable combinations have a score of rounding errors only, which is removed.
        let eigen = information.clone().symmetric_eigen();
        let least = EXACT * eigen.eigenvalues.max();
        for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
            if *value < least {
                score -= vector * vector.dot(&score);
            }
        }
        let mut expected = [stated.map_or(INITIAL_VARIANCE, |s| s * s), INITIAL_VARIANCE];
        let mut found = DVector::zeros(2 * n);
        let mut covariance = DMatrix::zeros(2 * n, 2 * n);
        // The noise of the scores is re-estimated once most of the signal is explained.
        for _ in 0..2 {
            let off = |w: &BlockScore| (both_scores(w) - self.both(w) * &found).norm_squared();
            let noise = (self.blocks.iter().map(off).sum::<f64>() / information.trace()).max(f64::MIN_POSITIVE);
            for _ in 0..PRIOR_ITERATIONS {
                let precision = DVector::from_fn(2 * n, |k, _| noise / expected[k / n].max(f64::MIN_POSITIVE));
                let mut shrunk = score.clone();
                (0..n).for_each(|k| shrunk[k] -= precision[k] * moved[k]);
                let inverse = (&information + DMatrix::from_diagonal(&precision)).cholesky()?.inverse();
                found = &inverse * shrunk;
                covariance = inverse * noise;
                let variance = |kind: usize| {
                    let of_view = |k: usize| {
                        let error = found[kind * n + k] + if kind == ANGLE { moved[k] } else { 0.0 };
                        error * error + covariance[(kind * n + k, kind * n + k)]
                    };
                    (0..n).map(of_view).sum::<f64>() / n as f64
                };
                let before = expected;
                expected = [stated.map_or_else(|| variance(ANGLE), |s| s * s), variance(LIGHT)];
                if before.iter().zip(&expected).all(|(b, e)| (e / b - 1.0).abs() < PRIOR_CONVERGED) {
                    break;
                }
            }
        }
        Some((found, covariance))
    }

    /// Information matrix of both kinds of errors.
    fn both(&self, block: &BlockScore) -> DMatrix<f64> {
        let n = self.directions.len();
        let mut both = DMatrix::zeros(2 * n, 2 * n);
        for (of, to) in [(ANGLE, ANGLE), (ANGLE, LIGHT), (LIGHT, ANGLE), (LIGHT, LIGHT)] {
            both.view_mut((of * n, to * n), (n, n)).copy_from(&self.information(block, of, to));
        }
        both
    }

    /// Block of the information matrix between one kind of error and another.
    fn information(&self, block: &BlockScore, of: usize, to: usize) -> DMatrix<f64> {
        let moved: Vec<_> = self.directions.iter().map(|d| block.moments * d[to]).collect();
        let n = moved.len();
        DMatrix::from_fn(n, n, |k, l| self.residual_matrix[(k, l)] * self.directions[k][of].dot(&moved[l]))
    }
}

/// Indices of the two kinds of errors: analyser angle and light.
const ANGLE: usize = 0;
const LIGHT: usize = 1;

/// Derivative of a view's intensity with respect to either error, as a row vector for (A, C, S).
fn directions(row: &Vector3<f64>) -> [Vector3<f64>; 2] {
    [Vector3::new(0.0, -2.0 * row[2], 2.0 * row[1]), *row]
}

fn both_scores(block: &BlockScore) -> DVector<f64> {
    let [angles, light_changes] = &block.scores;
    DVector::from_iterator(angles.len() + light_changes.len(), angles.iter().chain(light_changes.iter()).copied())
}

/// Sums over the pixels of a block.
struct BlockScore {
    /// Σ of squares and products of A, C and S.
    moments: Matrix3<f64>,
    /// Score per view: Σ of residual times the derivative with respect to either error.
    scores: [DVector<f64>; 2],
}

impl BlockScore {
    fn none(views: usize) -> Self {
        Self { moments: Matrix3::zeros(), scores: [0, 1].map(|_| DVector::zeros(views)) }
    }

    fn new(
        views: &[&[f32]],
        design: &Design,
        directions: &[[Vector3<f64>; 2]],
        maps: &StokesMaps,
        block: Range<usize>,
    ) -> Self {
        let mut new = Self::none(design.frames());
        for i in block {
            let fitted = Vector3::from([maps.s0[i], maps.s1[i], maps.s2[i]].map(|v| 0.5 * f64::from(v)));
            if !fitted[0].is_finite() {
                continue;
            }
            new.moments += fitted * fitted.transpose();
            for (k, ((view, row), directions)) in views.iter().zip(&design.rows).zip(directions).enumerate() {
                let residual = f64::from(view[i]) - fitted.dot(row);
                for (score, direction) in new.scores.iter_mut().zip(directions) {
                    score[k] += fitted.dot(direction) * residual;
                }
            }
        }
        new
    }

    fn add(&mut self, other: &Self) {
        self.moments += other.moments;
        self.scores.iter_mut().zip(&other.scores).for_each(|(all, other)| *all += other);
    }
}

impl Sample {
    /// Angle errors of the views, and changes of their light; `None` if some views were not kept.
    pub(crate) fn angle_errors(&self, views: &[View], stated: Option<f64>) -> Option<AngleErrorEstimate> {
        // The analysers of a sensor view neighbouring points, and edges would look like angle errors.
        if self.views() != views.len() || views.iter().any(|v| v.block > 1) {
            return None;
        }
        let angles: Vec<f64> = views.iter().map(|v| v.angle).collect();
        let blocks: Vec<usize> = (0..self.blocks()).collect();
        let fit = |angles: &[f64], design: &Design| {
            self.solve(&blocks, &angles.iter().copied().enumerate().collect::<Vec<_>>(), design)
        };
        estimate(&self.all(), &angles, stated, fit)
    }
}
