//! How far the analyser missed its angles, from the photographs themselves.
//!
//! An analyser that stands δ from where it is said to be changes the intensity by δ·dI/dψ, in every pixel in its own way but by one
//! δ. Part of that pattern the fit takes up: turning all angles together changes nothing but the gauge, and of N angles three
//! numbers per pixel are fitted. What is left over is explained by all δ together, by least squares, as far as they can be told.

use super::cloud::CloudPoint;
use super::sample::AREA;
use super::{Design, StokesMaps};
use nalgebra::{DMatrix, DVector};

/// Combinations of angles that change the residuals by less than this share of what the best does (as a variance) cannot be told.
const TOLD: f64 = 1e-4;

/// Rounds of weighting.
const ROUNDS: usize = 20;

/// Standard deviation of the analyser's angles in rad about where they are said to be; `maps` is the fit of these views, in blocks of [`AREA`] pixels. None
/// for three angles, which fit everything, and where no combination of angles can be told.
pub(crate) fn angle_sigma(views: &[&[f32]], design: &Design, maps: &StokesMaps) -> Option<f64> {
    if design.freedom() == 0 {
        return None;
    }
    let left_over = left_over(design);
    let witnesses: Vec<Witness> = (0..maps.s0.len() / AREA).map(|b| Witness::new(views, design, maps, b)).collect();
    let mut all = Witness::none(design.frames());
    witnesses.iter().for_each(|w| all.add(w));
    let modes = all.curvature(design, &left_over).symmetric_eigen();
    let largest = modes.eigenvalues.max();
    let told: Vec<usize> = (0..design.frames()).filter(|j| modes.eigenvalues[*j] > TOLD * largest).collect();
    if told.is_empty() || largest <= 0.0 {
        return None;
    }
    let amplitude = |j: usize| modes.eigenvectors.column(j).dot(&all.slope) / modes.eigenvalues[j];
    let amplitudes: Vec<f64> = told.iter().map(|j| amplitude(*j)).collect();
    let errors = told
        .iter()
        .zip(&amplitudes)
        .fold(DVector::zeros(design.frames()), |sum: DVector<f64>, (j, a)| sum + modes.eigenvectors.column(*j) * *a);
    // Blocks are the witnesses (Huber 1967): what their evidence scatters by holds noise, edges and whatever else.
    let mut noise = vec![0.0; told.len()];
    for witness in &witnesses {
        let off = &witness.slope - witness.curvature(design, &left_over) * &errors;
        for (sum, j) in noise.iter_mut().zip(&told) {
            *sum += (modes.eigenvectors.column(*j).dot(&off) / modes.eigenvalues[*j]).powi(2);
        }
    }
    Some(scatter(&amplitudes, &noise).sqrt())
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
pub(super) fn distorted(points: &[CloudPoint], maps: &StokesMaps, design: &Design, sigma: f64) -> f64 {
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

/// What some pixels say about the angles.
struct Witness {
    /// Σ of C², CS and S².
    squares: [f64; 3],
    /// Σ of residual times dI/dψ, per view.
    slope: DVector<f64>,
}

impl Witness {
    fn none(views: usize) -> Self {
        Self { squares: [0.0; 3], slope: DVector::zeros(views) }
    }

    fn new(views: &[&[f32]], design: &Design, maps: &StokesMaps, block: usize) -> Self {
        let mut new = Self::none(design.frames());
        for i in block * AREA..(block + 1) * AREA {
            let [a, c, s] = [maps.s0[i], maps.s1[i], maps.s2[i]].map(|v| 0.5 * f64::from(v));
            if !a.is_finite() {
                continue;
            }
            let [cc, cs, ss] = &mut new.squares;
            (*cc, *cs, *ss) = (*cc + c * c, *cs + c * s, *ss + s * s);
            for ((slope, view), x) in new.slope.iter_mut().zip(views).zip(&design.rows) {
                let residual = f64::from(view[i]) - (a + c * x[1] + s * x[2]);
                *slope += 2.0 * (s * x[1] - c * x[2]) * residual;
            }
        }
        new
    }

    fn add(&mut self, other: &Self) {
        (0..3).for_each(|k| self.squares[k] += other.squares[k]);
        self.slope += &other.slope;
    }

    /// How the slopes answer to errors of the angles.
    fn curvature(&self, design: &Design, left_over: &DMatrix<f64>) -> DMatrix<f64> {
        let [cc, cs, ss] = self.squares;
        let n = design.frames();
        DMatrix::from_fn(n, n, |k, l| {
            let (p, q) = (design.rows[k], design.rows[l]);
            let both = ss * p[1] * q[1] - cs * (p[1] * q[2] + p[2] * q[1]) + cc * p[2] * q[2];
            4.0 * left_over[(k, l)] * both
        })
    }
}
