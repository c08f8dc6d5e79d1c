//! How far the analyser missed its angles, from the photographs themselves.
//!
//! An analyser that stands δ from where it is said to be changes the intensity by δ·dI/dψ, in every pixel in its own way but by one δ. Part
//! of that pattern the fit takes up: turning all angles together changes nothing but the gauge, and of N angles three numbers per pixel are
//! fitted. What is left over is explained by all δ together, by least squares, as far as they can be told.
//!
//! Light that drifts changes the intensity in proportion. That looks the same where few orientations are in view, and always where errors go
//! with sin 2(ψ - φ) and light with cos 2(ψ - φ), as these together change all light's polarization alike (boosts of the cone of [1, cos 2ψ,
//! sin 2ψ]). So before angles are put right, both are told together, each expected to be as large as the rest of its kind is.

use crate::angles::sample::{AREA, Sample};
use crate::film::cloud::CloudPoint;
use crate::fit::views::View;
use crate::{Design, StokesMaps};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use std::f64::consts::PI;
use std::ops::Range;

/// Combinations of angles that change the residuals by less than this share of what the best does (as a variance) cannot be told.
const TOLD: f64 = 1e-4;

/// Rounds of weighting.
const ROUNDS: usize = 20;

/// Rounds of finding angles: what is neglected of errors of 5° in one is of second order, 0.4°, and of fourth in two.
const PASSES: usize = 4;

/// A step of less than this, in rad, is the last.
const CONVERGED: f64 = 1e-6;

/// Rounds of finding how large errors of angles and of light are, and what is taken for it first: half a degree, and one per cent.
const LEARNED: usize = 40;
const AT_FIRST: f64 = 1e-4;

/// Relative change of these that ends the rounds.
const SETTLED: f64 = 0.01;

/// Combinations of errors that answer by less than this share of what the best does are those that nothing can tell, and rounding.
const EXACT: f64 = 1e-9;

/// Angles that are off by no more than this (root mean square, in rad) are not worth reading the photographs again: twelve that are off by
/// 0.05° at random make orientations 0.01° wrong. What 0.1° make of a circle may already be a film.
const WORTH: f64 = 0.05 * PI / 180.0;

/// Change of the light between photographs that is worth a warning (root mean square), and in standard deviations: 0.1 % moves points about as far as
/// the noise of a good camera's pixel.
const DRIFT: f64 = 1e-3;
const DRIFT_SIGMA: f64 = 5.0;

/// Least variance of the polarization over the pixels, relative to the square of the light, from which angles and light can be told apart: points
/// (S1/S0, S2/S0) that scatter by 3 %.
const VARIED: f64 = 1e-3;

/// And nor are they where no more than this share of it can be told.
const KNOWN: f64 = 0.5;

/// Standard deviation of the analyser's angles in rad about where they are said to be; `maps` is the fit of these views, in blocks of
/// 64 pixels. None for three angles, which fit everything, and where no combination of angles can be told.
pub fn angle_sigma(views: &[&[f32]], design: &Design, maps: &StokesMaps) -> Option<f64> {
    let modes = Evidence::new(views, design, maps)?.modes()?;
    Some(scatter(&modes.amplitudes, &modes.noise).sqrt())
}

/// By how much the analyser missed its angles, one by one.
#[derive(Clone, Debug)]
pub struct Misses {
    /// Where it stood less where it is said to have stood, per view, in rad; their mean, which cannot be told, is 0.
    pub errors: Vec<f64>,
    /// Standard deviation in rad that is left of them.
    pub left: f64,
    /// Relative change of the light of each view; their mean, which cannot be told, is 0.
    pub lights: Vec<f64>,
    /// Standard deviation that is left of them.
    pub lights_left: f64,
}

impl Misses {
    /// Whether corrected angles are worth reading the photographs again.
    pub(crate) fn is_worth_correcting(&self) -> bool {
        let rms = root_mean_square(&self.errors);
        rms > WORTH && self.left < KNOWN * rms
    }

    /// Whether the light of the photographs differs beyond doubt: its root mean square.
    pub(crate) fn drift(&self) -> Option<f64> {
        Some(root_mean_square(&self.lights)).filter(|rms| *rms > DRIFT && DRIFT_SIGMA * self.lights_left < *rms)
    }
}

/// Finds by how much the analyser missed these angles, in rad, from views in blocks of 64 pixels. `stated` is the standard deviation
/// that they are said to have, `fit` solves the views with others. None where there is nothing worth putting right.
pub fn misses(
    views: &[&[f32]],
    angles: &[f64],
    stated: Option<f64>,
    fit: impl Fn(&[f64], &Design) -> StokesMaps,
) -> Option<Misses> {
    estimate(views, angles, stated, fit).filter(Misses::is_worth_correcting)
}

/// The same, also where no correction is worth it. None where nothing can be told.
pub(super) fn estimate(
    views: &[&[f32]],
    angles: &[f64],
    stated: Option<f64>,
    fit: impl Fn(&[f64], &Design) -> StokesMaps,
) -> Option<Misses> {
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
        let (found, covariance) = Evidence::new(views, &design, &fit(&moved, &design))?.likeliest(&errors, stated)?;
        let step = found.rows(ANGLE * n, n).into_owned();
        errors += &step;
        last = Some((found, covariance));
        if step.norm() < CONVERGED || root_mean_square(errors.as_slice()) < 0.5 * WORTH {
            break;
        }
    }
    let (found, covariance) = last?;
    // A common turn cannot be told, and does not matter; nor does a common change of the light.
    let centred = |all: DVector<f64>| all.add_scalar(-all.mean()).iter().copied().collect();
    let left = |kind: usize| {
        let own = covariance.view((kind * n, kind * n), (n, n));
        ((own.trace() - own.sum() / n as f64) / (n - 1) as f64).max(0.0).sqrt()
    };
    let lights = centred(found.rows(LIGHT * n, n).into_owned());
    Some(Misses { errors: centred(errors), left: left(ANGLE), lights, lights_left: left(LIGHT) })
}

/// Whether polarization varies over the pixels: where it does not, errors of angles and changes of the light look the same.
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

/// Variance of amplitudes beyond that of their noise, each weighted as it is known.
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

/// By how much wrong angles of this standard deviation in rad move a point, as a variance over that of its noise, mean of these points of maps.
/// Turning all angles together, which changes orientations alike, is no part of it.
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

/// What a fit leaves of a set of intensities.
fn left_over(design: &Design) -> DMatrix<f64> {
    let n = design.frames();
    DMatrix::from_fn(n, n, |k, l| f64::from(u8::from(k == l)) - design.rows[k].dot(&(design.inverse * design.rows[l])))
}

/// Combinations of angles that can be told: how much of each there is, in rad, and the variance that it is known to.
struct Modes {
    amplitudes: Vec<f64>,
    noise: Vec<f64>,
}

/// What residuals say about angles, and about the light of the views.
struct Evidence {
    /// Of each view.
    directions: Vec<[Vector3<f64>; 2]>,
    left_over: DMatrix<f64>,
    witnesses: Vec<Witness>,
}

impl Evidence {
    /// None where the fit leaves nothing.
    fn new(views: &[&[f32]], design: &Design, maps: &StokesMaps) -> Option<Self> {
        if design.freedom() == 0 {
            return None;
        }
        let directions: Vec<_> = design.rows.iter().map(directions).collect();
        let blocks = (0..maps.s0.len() / AREA).map(|b| b * AREA..(b + 1) * AREA);
        let witnesses = blocks.map(|block| Witness::new(views, design, &directions, maps, block)).collect();
        Some(Self { directions, left_over: left_over(design), witnesses })
    }

    fn all(&self) -> Witness {
        let mut all = Witness::none(self.directions.len());
        self.witnesses.iter().for_each(|w| all.add(w));
        all
    }

    /// The combinations of angles that can be told, as if the light were known.
    fn modes(&self) -> Option<Modes> {
        let all = self.all();
        let eigen = self.curvature(&all, ANGLE, ANGLE).symmetric_eigen();
        let largest = eigen.eigenvalues.max();
        let told: Vec<usize> =
            (0..eigen.eigenvalues.len()).filter(|j| eigen.eigenvalues[*j] > TOLD * largest).collect();
        if told.is_empty() || largest <= 0.0 {
            return None;
        }
        let vectors: Vec<DVector<f64>> = told.iter().map(|j| eigen.eigenvectors.column(*j).into_owned()).collect();
        let values: Vec<f64> = told.iter().map(|j| eigen.eigenvalues[*j]).collect();
        let amplitude = |(v, value): (&DVector<f64>, &f64)| v.dot(&all.slopes[ANGLE]) / value;
        let amplitudes: Vec<f64> = vectors.iter().zip(&values).map(amplitude).collect();
        let none = DVector::zeros(self.directions.len());
        let errors = vectors.iter().zip(&amplitudes).fold(none, |sum, (v, a)| sum + v * *a);
        // Blocks are the witnesses (Huber 1967): what their evidence scatters by holds noise, edges and whatever else.
        let mut noise = vec![0.0; told.len()];
        for witness in &self.witnesses {
            let off = &witness.slopes[ANGLE] - self.curvature(witness, ANGLE, ANGLE) * &errors;
            for ((noise, v), value) in noise.iter_mut().zip(&vectors).zip(&values) {
                *noise += (v.dot(&off) / value).powi(2);
            }
        }
        Some(Modes { amplitudes, noise })
    }

    /// The likeliest further errors of angles and changes of the light, one after the other, with their covariance, where angles were moved by so much already. How large either is comes from the residuals (empirical Bayes, by expectation and maximisation), that of angles from
    /// what is stated, if anything is.
    fn likeliest(&self, moved: &DVector<f64>, stated: Option<f64>) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let (all, n) = (self.all(), moved.len());
        let (curvature, mut slope) = (self.both(&all), both_slopes(&all));
        // What cannot be told has no slope but that of rounding.
        let eigen = curvature.clone().symmetric_eigen();
        let least = EXACT * eigen.eigenvalues.max();
        for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
            if *value < least {
                slope -= vector * vector.dot(&slope);
            }
        }
        let mut expected = [stated.map_or(AT_FIRST, |s| s * s), AT_FIRST];
        let mut found = DVector::zeros(2 * n);
        let mut covariance = DMatrix::zeros(2 * n, 2 * n);
        // What noise slopes have is known once most of it is explained.
        for _ in 0..2 {
            let off = |w: &Witness| (both_slopes(w) - self.both(w) * &found).norm_squared();
            let noise = (self.witnesses.iter().map(off).sum::<f64>() / curvature.trace()).max(f64::MIN_POSITIVE);
            for _ in 0..LEARNED {
                let pull = DVector::from_fn(2 * n, |k, _| noise / expected[k / n].max(f64::MIN_POSITIVE));
                let mut pulled = slope.clone();
                (0..n).for_each(|k| pulled[k] -= pull[k] * moved[k]);
                let inverse = (&curvature + DMatrix::from_diagonal(&pull)).cholesky()?.inverse();
                found = &inverse * pulled;
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
                if before.iter().zip(&expected).all(|(b, e)| (e / b - 1.0).abs() < SETTLED) {
                    break;
                }
            }
        }
        Some((found, covariance))
    }

    /// How the slopes of both kinds answer to errors of both.
    fn both(&self, witness: &Witness) -> DMatrix<f64> {
        let n = self.directions.len();
        let mut both = DMatrix::zeros(2 * n, 2 * n);
        for (of, to) in [(ANGLE, ANGLE), (ANGLE, LIGHT), (LIGHT, ANGLE), (LIGHT, LIGHT)] {
            both.view_mut((of * n, to * n), (n, n)).copy_from(&self.curvature(witness, of, to));
        }
        both
    }

    /// How the slopes of one kind answer to errors of another.
    fn curvature(&self, witness: &Witness, of: usize, to: usize) -> DMatrix<f64> {
        let moved: Vec<_> = self.directions.iter().map(|d| witness.moments * d[to]).collect();
        let n = moved.len();
        DMatrix::from_fn(n, n, |k, l| self.left_over[(k, l)] * self.directions[k][of].dot(&moved[l]))
    }
}

/// An error of the analyser's angle, and one of the light.
const ANGLE: usize = 0;
const LIGHT: usize = 1;

/// Change of a view's intensity per error of either kind, as a factor of (A, C, S).
fn directions(row: &Vector3<f64>) -> [Vector3<f64>; 2] {
    [Vector3::new(0.0, -2.0 * row[2], 2.0 * row[1]), *row]
}

fn both_slopes(witness: &Witness) -> DVector<f64> {
    let [angles, lights] = &witness.slopes;
    DVector::from_iterator(angles.len() + lights.len(), angles.iter().chain(lights.iter()).copied())
}

/// What some pixels say.
struct Witness {
    /// Σ of squares and products of A, C and S.
    moments: Matrix3<f64>,
    /// Σ of residual times the change per error of either kind, per view.
    slopes: [DVector<f64>; 2],
}

impl Witness {
    fn none(views: usize) -> Self {
        Self { moments: Matrix3::zeros(), slopes: [0, 1].map(|_| DVector::zeros(views)) }
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
                for (slope, direction) in new.slopes.iter_mut().zip(directions) {
                    slope[k] += fitted.dot(direction) * residual;
                }
            }
        }
        new
    }

    fn add(&mut self, other: &Self) {
        self.moments += other.moments;
        self.slopes.iter_mut().zip(&other.slopes).for_each(|(all, other)| *all += other);
    }
}

impl Sample {
    /// Errors of the views' angles, and changes of their light; not told where some views were not kept.
    pub(crate) fn misses(&self, views: &[View], stated: Option<f64>) -> Option<Misses> {
        // The analysers of a sensor look at places beside each other, which edges make look like wrong angles.
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
