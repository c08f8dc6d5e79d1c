//! How likely the points are under a curve, whatever orientations are in view.
//!
//! The distance to the nearest place of the curve is no measure between curves: one that winds through the whole cloud is
//! near to every point. The likelihood is: how far a point is from the curve, in units of its noise, and how crowded the
//! points are where it falls, so that a long curve, on which they are less crowded, pays for its length.

use super::cloud::CloudPoint;
use super::curve::Curve;
use super::curve_fit::{CAUCHY, Foot, Path, scale_of};
use std::f64::consts::{PI, TAU};

/// Stretches of the curve whose lengths are added up.
const NODES: usize = 512;

/// -2 ln likelihood of the points under a curve. How crowded they are comes from their own spacing (an entropy by
/// m-spacings), so nothing is assumed about which orientations are in view; but noise along the curve keeps any place
/// from being more crowded than it can be.
pub fn misfit(points: &[CloudPoint], curve: &Curve) -> f64 {
    let path = Path::new(*curve);
    let feet: Vec<Foot> = points.iter().map(|p| path.foot(p)).collect();
    let across: f64 = feet
        .iter()
        .map(|f| {
            // The gradient's length is 1/σ across the curve.
            let [x, y] = f.gradient;
            let limit = CAUCHY * CAUCHY;
            limit * (1.0 + f.distance * f.distance / limit).ln() + (TAU / (x * x + y * y)).ln()
        })
        .sum();
    across + 2.0 * crowding(points, &feet, curve, 1.0)
}

/// The same for a curve that is far from fitted, with as much more noise as explains the distances.
pub fn screening(points: &[CloudPoint], curve: &Curve) -> f64 {
    let path = Path::new(*curve);
    let feet: Vec<Foot> = points.iter().map(|p| path.foot(p)).collect();
    let scale = scale_of(&feet);
    2.0 * (points.len() as f64 * scale.ln() + crowding(points, &feet, curve, scale))
}

/// Sum over the points of -ln of their density along the curve.
fn crowding(points: &[CloudPoint], feet: &[Foot], curve: &Curve, scale: f64) -> f64 {
    let n = feet.len();
    if n < 4 {
        return 0.0;
    }
    let mut length = vec![0.0; NODES + 1];
    let step = PI / NODES as f64;
    for k in 0..NODES {
        let (_, t) = curve.with_tangent((k as f64 + 0.5) * step);
        length[k + 1] = length[k] + t[0].hypot(t[1]) * step;
    }
    let total = length[NODES];
    // Where each point falls, and how far its noise spreads it there.
    let place = |(point, foot): (&CloudPoint, &Foot)| {
        let place = foot.theta.rem_euclid(PI) / step;
        let k = (place as usize).min(NODES - 1);
        let (x, y) = (foot.gradient[1], foot.gradient[0]);
        let [a, b, c] = point.covariance;
        let along = (a * x * x - 2.0 * b * x * y + c * y * y) / (x * x + y * y);
        (length[k] + (length[k + 1] - length[k]) * (place - k as f64), scale * along.sqrt())
    };
    let mut at: Vec<(f64, f64)> = points.iter().zip(feet).map(place).collect();
    at.sort_by(|a, b| a.0.total_cmp(&b.0));
    let m = (n as f64).sqrt() as usize;
    (0..n)
        .map(|i| {
            let (here, noise) = at[i];
            let next = if i + m < n { at[i + m].0 } else { at[i + m - n].0 + total };
            let last = if i >= m { at[i - m].0 } else { at[i + n - m].0 - total };
            // The side on which it is more crowded, since the other one may be a gap between orientations.
            let spacing = (next - here).min(here - last) * n as f64 / m as f64;
            spacing.max(TAU.sqrt() * noise).max(f64::MIN_POSITIVE).ln()
        })
        .sum()
}
