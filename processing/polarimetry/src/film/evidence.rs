//! How likely the points are under a curve, whatever orientations are in view.
//!
//! The distance to the nearest place of the curve is no measure between curves: one that winds through the whole cloud is
//! near to every point. The likelihood is: how far a point is from the curve, in units of its noise, and how crowded the
//! points are where it falls, so that a long curve, on which they are less crowded, pays for its length.

use crate::film::cloud::CloudPoint;
use crate::film::curve::Curve;
use crate::film::foot::{Foot, feet, scale_of};
use crate::film::normal::CAUCHY;
use std::f64::consts::{PI, TAU};
use std::sync::LazyLock;

/// Stretches of the curve whose lengths are added up.
const NODES: usize = 512;

/// Sine and cosine of 2θ half-way between them.
static BETWEEN: LazyLock<[(f64, f64); NODES]> =
    LazyLock::new(|| std::array::from_fn(|k| (2.0 * PI * (k as f64 + 0.5) / NODES as f64).sin_cos()));

/// -2 ln likelihood of the points under a curve. How crowded they are comes from their own spacing (an entropy by
/// m-spacings), so nothing is assumed about which orientations are in view; but noise along the curve keeps any place
/// from being more crowded than it can be.
pub fn misfit(points: &[CloudPoint], curve: &Curve) -> f64 {
    terms(points, curve).iter().sum()
}

/// The same point by point.
pub fn terms(points: &[CloudPoint], curve: &Curve) -> Vec<f64> {
    let feet = feet(points, *curve);
    let limit = CAUCHY * CAUCHY;
    // How many are mirrors is one more parameter, fitted.
    let mirrors = feet.iter().filter(|f| f.mirror).count() as f64 / feet.len().max(1) as f64;
    let mut terms: Vec<f64> = points
        .iter()
        .zip(&feet)
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
    for (i, crowding) in crowding(points, &feet, curve, 1.0) {
        terms[i] += 2.0 * crowding;
    }
    terms
}

/// The same for a curve that is far from fitted, with as much more noise as explains the distances.
pub(crate) fn screening(points: &[CloudPoint], feet: &[Foot], curve: &Curve) -> f64 {
    let scale = scale_of(feet);
    let crowding: f64 = crowding(points, feet, curve, scale).iter().map(|c| c.1).sum();
    2.0 * (points.len() as f64 * scale.ln() + crowding)
}

/// -ln of their density along the curve, with the numbers of the points.
fn crowding(points: &[CloudPoint], feet: &[Foot], curve: &Curve, scale: f64) -> Vec<(usize, f64)> {
    let n = feet.iter().filter(|f| !f.mirror).count();
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
    // Where each point falls, and how far its noise spreads it there.
    let place = |(point, foot): (&CloudPoint, &Foot)| {
        let place = foot.theta.rem_euclid(PI) / step;
        let k = (place as usize).min(NODES - 1);
        // The foot is the nearest place in the metric of the noise, so what is left along the curve is independent of what is
        // across it, and both variances make the determinant.
        let ([x, y], [a, b, c]) = (foot.gradient, point.covariance);
        let along = (a * c - b * b) * (x * x + y * y);
        (length[k] + (length[k + 1] - length[k]) * (place - k as f64), scale * along.sqrt())
    };
    let mut at: Vec<(usize, (f64, f64))> = points
        .iter()
        .zip(feet)
        .enumerate()
        .filter(|(_, (_, foot))| !foot.mirror)
        .map(|(i, pair)| (i, place(pair)))
        .collect();
    at.sort_by(|a, b| a.1.0.total_cmp(&b.1.0));
    let m = (n as f64).sqrt() as usize;
    (0..n)
        .map(|i| {
            let (point, (here, noise)) = at[i];
            let next = if i + m < n { at[i + m].1.0 } else { at[i + m - n].1.0 + total };
            let last = if i >= m { at[i - m].1.0 } else { at[i + n - m].1.0 - total };
            // The side on which it is more crowded, since the other one may be a gap between orientations.
            let spacing = (next - here).min(here - last) * n as f64 / m as f64;
            (point, spacing.max(TAU.sqrt() * noise).max(f64::MIN_POSITIVE).ln())
        })
        .collect()
}
