//! Likelihood of points under a curve, for any distribution of orientations.
//!
//! The distance to the nearest point of the curve cannot compare curves: one that winds through the whole cloud is
//! close to every point. The likelihood also contains the density of points along the curve. A long curve, on which
//! points are less dense, is thus penalised for its length.

use crate::film::cloud::CloudPoint;
use crate::film::curve::Curve;
use crate::film::normal::CAUCHY;
use crate::film::projection::{ClosestPoint, project, robust_scale};
use std::f64::consts::{PI, TAU};
use std::sync::LazyLock;

/// Segments of the curve for its arc length.
const NODES: usize = 512;

/// Sine and cosine of 2θ at their midpoints.
static BETWEEN: LazyLock<[(f64, f64); NODES]> =
    LazyLock::new(|| std::array::from_fn(|k| (2.0 * PI * (k as f64 + 0.5) / NODES as f64).sin_cos()));

/// −2 ln likelihood of the points under a curve. The density along the curve comes from the spacing of the points (an
/// entropy by m-spacings), without assumptions about the distribution of orientations. The noise along the curve limits
/// the density.
pub fn misfit(points: &[CloudPoint], curve: &Curve) -> f64 {
    terms(points, curve).iter().sum()
}

/// −2 ln likelihood of each point.
pub fn terms(points: &[CloudPoint], curve: &Curve) -> Vec<f64> {
    let closest_points = project(points, *curve);
    let limit = CAUCHY * CAUCHY;
    // The fraction of mirror pixels is an additional fitted parameter.
    let mirrors = closest_points.iter().filter(|f| f.mirror).count() as f64 / closest_points.len().max(1) as f64;
    let mut terms: Vec<f64> = points
        .iter()
        .zip(&closest_points)
        .map(|(p, f)| {
            let square = f.distance * f.distance;
            if f.mirror {
                let [a, b, c] = p.covariance;
                let density = (TAU * TAU * (a * c - b * b)).ln();
                return limit * (1.0 + 2.0 * square / limit).ln() + density - 2.0 * mirrors.ln();
            }
            // The gradient's length is 1/σ across the curve.
            let [x, y] = f.gradient;
            limit * (1.0 + square / limit).ln() + (TAU / (x * x + y * y)).ln() - 2.0 * (1.0 - mirrors).ln()
        })
        .collect();
    for (i, crowding) in crowding(points, &closest_points, curve, 1.0) {
        terms[i] += 2.0 * crowding;
    }
    terms
}

/// −2 ln likelihood for a curve far from the fit, with noise increased to explain the distances.
pub(crate) fn screening(points: &[CloudPoint], closest_points: &[ClosestPoint], curve: &Curve) -> f64 {
    let scale = robust_scale(closest_points);
    let crowding: f64 = crowding(points, closest_points, curve, scale).iter().map(|c| c.1).sum();
    2.0 * (points.len() as f64 * scale.ln() + crowding)
}

/// −ln of the points' density along the curve, with their indices.
fn crowding(points: &[CloudPoint], closest_points: &[ClosestPoint], curve: &Curve, scale: f64) -> Vec<(usize, f64)> {
    let n = closest_points.iter().filter(|f| !f.mirror).count();
    if n < 4 {
        return vec![];
    }
    let mut length = vec![0.0; NODES + 1];
    let step = PI / NODES as f64;
    for k in 0..NODES {
        let (_, [x, y]) = curve.at_turn(BETWEEN[k]);
        length[k + 1] = length[k] + (x * x + y * y).sqrt() * step;
    }
    let total = length[NODES];
    // Arc-length position of each point, and its spread by noise.
    let place = |(point, closest): (&CloudPoint, &ClosestPoint)| {
        let place = closest.theta.rem_euclid(PI) / step;
        let k = (place as usize).min(NODES - 1);
        // The projection is the nearest point in the metric of the noise, so errors along and across the curve are
        // independent. The product of their variances is the determinant.
        let ([x, y], [a, b, c]) = (closest.gradient, point.covariance);
        let along = (a * c - b * b) * (x * x + y * y);
        (length[k] + (length[k + 1] - length[k]) * (place - k as f64), scale * along.sqrt())
    };
    let mut at: Vec<(usize, (f64, f64))> = points
        .iter()
        .zip(closest_points)
        .enumerate()
        .filter(|(_, (_, closest))| !closest.mirror)
        .map(|(i, pair)| (i, place(pair)))
        .collect();
    at.sort_by(|a, b| a.1.0.total_cmp(&b.1.0));
    let m = (n as f64).sqrt() as usize;
    (0..n)
        .map(|i| {
            let (point, (here, noise)) = at[i];
            let next = if i + m < n { at[i + m].1.0 } else { at[i + m - n].1.0 + total };
            let last = if i >= m { at[i - m].1.0 } else { at[i + n - m].1.0 - total };
            // The denser side, since the other one may be a gap between orientations.
            let spacing = (next - here).min(here - last) * n as f64 / m as f64;
            (point, spacing.max(TAU.sqrt() * noise).max(f64::MIN_POSITIVE).ln())
        })
        .collect()
}
