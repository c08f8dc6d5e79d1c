//! Orientation, σ and mask of every pixel under a circle or a curve.

use super::correction::Correction;
use super::curve::Curve;
use super::models::{Candidate, Model};
use super::noise::Covariance;
use super::orient::{MASK_SNR, Misfit, OrientationMaps, fold, orient};
use super::{Design, FrameNoise, StokesMaps};
use rayon::prelude::*;
use std::f32::consts::FRAC_PI_2;
use std::f64::consts::PI;

/// Places on the curve that the table leads to.
const NODES: usize = 1024;

/// Cells of the table along each side.
const CELLS: usize = 256;

/// A second place on the curve counts if it is not less likely than the first by more than this (squared standard
/// deviations), and farther along than their uncertainties: the pixel is masked then.
const RIVAL: f32 = 9.0;

/// A squared distance from the mirror's place that noise hardly reaches, in squared standard deviations.
const MIRROR: f32 = 16.0;

/// Pixels farther from the curve than so many standard deviations do not follow the model; what is beyond counts as error
/// along the curve, too.
const OFF: f32 = 3.0;

/// Orientation, σ and mask of every pixel under a model, and how many pixels are metal without a grating. As [`orient`], which it is
/// for the sinusoid.
pub(super) fn locate(
    maps: &mut StokesMaps,
    design: &Design,
    noise: &[FrameNoise],
    model: &Candidate,
    correction: Option<&Correction>,
    offset: f64,
) -> (OrientationMaps, usize) {
    let place = match (model.model, model.center) {
        (Model::Sinusoid, _) if correction.is_none() => {
            return (orient(maps, design, noise, offset), 0);
        }
        (_, Some(center)) => Place::Circle(Circle::new(center, &model.curve)),
        (_, None) => Place::Curve(Box::new(Table::new(model.curve))),
    };
    let mut sigma = std::mem::take(&mut maps.residual);
    let covariance = Covariance::new(design, noise, &maps.covariance);
    let misfit = Misfit::new(design, noise, maps);
    let mut orientation = vec![0.0_f32; maps.s0.len()];
    const BLOCK: usize = 4096;
    let blocks = orientation.par_chunks_mut(BLOCK).zip(sigma.par_chunks_mut(BLOCK)).enumerate();
    let mirrors = blocks.map(|(block, (theta, sigma))| {
        let mut mirrors = 0;
        for i in 0..theta.len() {
            let p = block * BLOCK + i;
            let (a, c, s) = (0.5 * maps.s0[p], 0.5 * maps.s1[p], 0.5 * maps.s2[p]);
            let widened = misfit.factor(a, sigma[i]);
            let variance = covariance.of_ratios(p, [a, c, s]).map(|v| v * widened);
            let point = [c / a, s / a];
            let point = correction.map_or(point, |o| o.straightened(p, point, variance));
            let Located { theta: at, sigma: found, mirror } = match &place {
                Place::Circle(circle) => circle.locate(point, variance),
                Place::Curve(table) => table.locate(point, variance),
            };
            mirrors += usize::from(mirror && a > 0.0);
            sigma[i] = found.min(FRAC_PI_2);
            let carries = found <= 0.5 / MASK_SNR && a > 0.0;
            theta[i] = if carries { fold(at + offset as f32) } else { f32::NAN };
        }
        mirrors
    });
    let mirrors = mirrors.sum();
    (OrientationMaps { width: maps.width, height: maps.height, orientation, sigma }, mirrors)
}

/// Uncertainty in rad from which the bend of the curve within it is looked at.
const BENT: f32 = 0.01;

/// Where the curve is that much slower within the noise than at the point itself, no σ describes the error, and the pixel is
/// masked.
const TOO_BENT: f32 = 1.3;

/// Where a point belongs.
pub(super) struct Located {
    /// Orientation in rad.
    pub theta: f32,
    /// Its standard deviation in rad; infinite where another branch of the curve is as good.
    pub sigma: f32,
    /// It is no grating but metal without one; σ is infinite then.
    pub mirror: bool,
}

impl Located {
    fn grating(theta: f32, sigma: f32) -> Self {
        Self { theta, sigma, mirror: false }
    }
}

enum Place {
    Circle(Circle),
    Curve(Box<Table>),
}

struct Circle {
    center: [f32; 2],
    radius: f32,
}

impl Circle {
    fn new(center: [f64; 2], curve: &Curve) -> Self {
        let at = curve.at(0.0);
        let radius = (at[0] - center[0]).hypot(at[1] - center[1]) as f32;
        Self { center: center.map(|v| v as f32), radius }
    }

    #[inline]
    fn locate(&self, at: [f32; 2], [va, vb, vc]: [f32; 3]) -> Located {
        let (x, y) = (at[0] - self.center[0], at[1] - self.center[1]);
        let square = x * x + y * y;
        let across = (y * y * va - 2.0 * x * y * vb + x * x * vc) / square;
        let along = (x * x * va + 2.0 * x * y * vb + y * y * vc) / square;
        let off = square.sqrt() - self.radius;
        let excess = (off * off - OFF * OFF * along).max(0.0);
        Located::grating(0.5 * y.atan2(x), 0.5 * ((across + excess) / square).sqrt())
    }
}

/// Leads from a point to the nearest places of a curve.
pub(super) struct Table {
    curve: Coefficients,
    low: [f32; 2],
    cells_per_unit: [f32; 2],
    /// Where metal without a grating lies.
    mirror: Option<[f32; 2]>,
    /// Per cell the nearest node and the nearest one of another branch, which is the same when there is none near.
    nearest: Vec<[u16; 2]>,
}

impl Table {
    pub(super) fn new(curve: Curve) -> Self {
        let nodes: Vec<[f32; 2]> =
            (0..NODES).map(|k| curve.at(PI * k as f64 / NODES as f64).map(|v| v as f32)).collect();
        let ends = |k: usize| nodes.iter().fold((f32::MAX, f32::MIN), |(l, h), p| (l.min(p[k]), h.max(p[k])));
        let ((xl, xh), (yl, yh)) = (ends(0), ends(1));
        // As much again on every side; beyond that a pixel is on no curve anyway.
        let margin = 0.5 * (xh - xl).max(yh - yl).max(1e-6);
        let low = [xl - margin, yl - margin];
        let cells_per_unit = [xh - xl, yh - yl].map(|side| CELLS as f32 / (side + 2.0 * margin));
        let nearest = (0..CELLS * CELLS)
            .into_par_iter()
            .map(|cell| {
                let at = |k: usize, i: usize| low[k] + (i as f32 + 0.5) / cells_per_unit[k];
                branches(&nodes, [at(0, cell % CELLS), at(1, cell / CELLS)])
            })
            .collect();
        let mirror = curve.mirror.map(|at| at.map(|v| v as f32));
        Self { curve: Coefficients::new(&curve), low, cells_per_unit, mirror, nearest }
    }

    #[inline]
    pub(super) fn locate(&self, at: [f32; 2], variance: [f32; 3]) -> Located {
        let cell = |k: usize| ((at[k] - self.low[k]) * self.cells_per_unit[k]).clamp(0.0, (CELLS - 1) as f32) as usize;
        let [first, second] = self.nearest[cell(1) * CELLS + cell(0)];
        let best = self.refine(first, at, variance);
        if self.mirror.is_some_and(|mirror| is_mirror(at, mirror, variance, best.distance2)) {
            return Located { theta: best.theta, sigma: f32::INFINITY, mirror: true };
        }
        if first == second {
            return Located::grating(best.theta, best.sigma());
        }
        let other = self.refine(second, at, variance);
        let (best, other) = if other.distance2 < best.distance2 { (other, best) } else { (best, other) };
        let apart = (best.theta - other.theta + FRAC_PI_2).rem_euclid(2.0 * FRAC_PI_2) - FRAC_PI_2;
        let rival = other.distance2 - best.distance2 < RIVAL && apart.abs() > 3.0 * best.along.max(other.along);
        Located::grating(best.theta, if rival { f32::INFINITY } else { best.sigma() })
    }

    /// The nearest place near a node, in the metric of the noise.
    #[inline]
    fn refine(&self, node: u16, at: [f32; 2], [va, vb, vc]: [f32; 3]) -> Found {
        const STEP: f32 = std::f32::consts::PI / NODES as f32;
        let determinant = va * vc - vb * vb;
        let (wa, wb, wc) = (vc / determinant, -vb / determinant, va / determinant);
        let mut theta = STEP * f32::from(node);
        let (mut x, mut y, mut speed, mut t) = (0.0, 0.0, 0.0, [0.0; 2]);
        for round in 0..3 {
            let (q, tangent) = self.curve.with_tangent(theta);
            (x, y, t) = (at[0] - q[0], at[1] - q[1], tangent);
            let (wx, wy) = (wa * t[0] + wb * t[1], wb * t[0] + wc * t[1]);
            speed = wx * t[0] + wy * t[1];
            if round < 2 && speed > 0.0 {
                theta += ((wx * x + wy * y) / speed).clamp(-8.0 * STEP, 8.0 * STEP);
            }
        }
        let length2 = t[0] * t[0] + t[1] * t[1];
        let distance2 = wa * x * x + 2.0 * wb * x * y + wc * y * y;
        // Along the normal, whose variance is that across the curve.
        let (nx, ny) = (-t[1], t[0]);
        let across = (va * nx * nx + 2.0 * vb * nx * ny + vc * ny * ny) / length2;
        let off = (nx * x + ny * y) / length2.sqrt();
        let excess = (off * off - OFF * OFF * across).max(0.0) / length2;
        let along = speed.sqrt().recip();
        let weighted = |theta: f32| {
            let (q, _) = self.curve.with_tangent(theta);
            let (x, y) = (q[0] - at[0] + x, q[1] - at[1] + y);
            (wa * x * x + 2.0 * wb * x * y + wc * y * y).sqrt()
        };
        // Where the curve turns or slows down within the noise, the point moves less than its speed here promises.
        let least = || weighted(theta + 2.0 * along).min(weighted(theta - 2.0 * along));
        let slower = if along > BENT { (2.0 / least()).max(1.0) } else { 1.0 };
        let along = if slower > TOO_BENT { f32::INFINITY } else { along * (0.5 + 0.5 * slower) };
        Found { theta, along, excess, distance2 }
    }
}

/// Whether a point may be metal without a grating rather than a grating so far from the curve.
#[inline]
fn is_mirror(at: [f32; 2], mirror: [f32; 2], variance: [f32; 3], from_curve2: f32) -> bool {
    let from_mirror2 = distance2(at, mirror, variance);
    from_mirror2 < from_curve2 || (from_mirror2 < MIRROR && from_mirror2 - from_curve2 < RIVAL)
}

/// Squared distance of two points in standard deviations.
#[inline]
pub(super) fn distance2(p: [f32; 2], q: [f32; 2], [va, vb, vc]: [f32; 3]) -> f32 {
    let (x, y) = (p[0] - q[0], p[1] - q[1]);
    (vc * x * x - 2.0 * vb * x * y + va * y * y) / (va * vc - vb * vb)
}

struct Found {
    theta: f32,
    /// σ along the curve in rad.
    along: f32,
    /// Variance for being off the curve.
    excess: f32,
    distance2: f32,
}

impl Found {
    #[inline]
    fn sigma(&self) -> f32 {
        (self.along * self.along + self.excess).sqrt()
    }
}

/// The nearest node and the nearest one that other ones, farther away, lie between.
fn branches(nodes: &[[f32; 2]], at: [f32; 2]) -> [u16; 2] {
    let distance = |k: usize| {
        let (x, y) = (nodes[k][0] - at[0], nodes[k][1] - at[1]);
        x * x + y * y
    };
    let distances: Vec<f32> = (0..NODES).map(distance).collect();
    let least = |k: &usize| {
        let (before, after) = (distances[(k + NODES - 1) % NODES], distances[(k + 1) % NODES]);
        distances[*k] <= before && distances[*k] < after
    };
    let mut minima: Vec<usize> = (0..NODES).filter(least).collect();
    minima.sort_by(|a, b| distances[*a].total_cmp(&distances[*b]));
    let first = minima.first().copied().unwrap_or(0) as u16;
    [first, minima.get(1).map_or(first, |k| *k as u16)]
}

/// A curve in single precision.
struct Coefficients([[f32; 5]; 3]);

impl Coefficients {
    fn new(curve: &Curve) -> Self {
        let all = curve.coefficients();
        // Relative to the mean of S0, so that nothing is too small.
        Self(all.map(|row| row.map(|v| (v / all[0][0]) as f32)))
    }

    #[inline]
    fn with_tangent(&self, theta: f32) -> ([f32; 2], [f32; 2]) {
        let (s, c) = (2.0 * theta).sin_cos();
        let (s2, c2) = (2.0 * s * c, c * c - s * s);
        let value = |k: &[f32; 5]| k[0] + k[1] * c + k[2] * s + k[3] * c2 + k[4] * s2;
        let slope = |k: &[f32; 5]| 2.0 * (k[2] * c - k[1] * s) + 4.0 * (k[4] * c2 - k[3] * s2);
        let [s0, s1, s2] = self.0.each_ref().map(value);
        let [d0, d1, d2] = self.0.each_ref().map(slope);
        let (x, y) = (s1 / s0, s2 / s0);
        ([x, y], [(d1 - x * d0) / s0, (d2 - y * d0) / s0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::polarimetry::{Fit, synthetic::even_angles};

    /// Metal without a grating is masked and counted, gratings are neither, and darkness is no metal.
    #[test]
    fn metal_without_a_grating_is_counted() {
        let mut curve = Curve::circle([0.05, 0.02], 0.3);
        curve.mirror = Some([0.05, 0.02]);
        let (model, center) = (Model::Curve, None);
        let model = Candidate {
            model,
            extended: &[],
            parameters: 4,
            curve,
            center,
            prior: 0.0,
            told: None,
            cost: 0.0,
            uncertain: 0.0,
            film: None,
        };
        let angles = even_angles(6);
        let design = Design::new(&angles).unwrap();
        let noise = [FrameNoise { shot: 0.0, floor: 1e-6 }; 6];
        let pixels = 60;
        let mut fit = Fit::new(pixels, 1);
        for psi in &angles {
            fit.add(*psi, |_, values, _| {
                for (i, value) in values.iter_mut().enumerate() {
                    let [x, y] = if i % 3 == 0 { [0.05, 0.02] } else { curve.at(PI * i as f64 / pixels as f64) };
                    let light = if i % 3 == 1 { 0.0 } else { 0.5 };
                    *value = (light * (1.0 + x * (2.0 * psi).cos() + y * (2.0 * psi).sin())) as f32;
                }
            });
        }
        let (map, mirrors) = locate(&mut fit.solve(&design), &design, &noise, &model, None, 0.0);
        assert_eq!(mirrors, pixels / 3);
        for (i, theta) in map.orientation.iter().enumerate() {
            let wanted = PI * i as f64 / pixels as f64;
            let off = crate::polarimetry::angle_difference(f64::from(*theta), wanted).abs();
            assert!(if i % 3 == 2 { off < 0.01 } else { theta.is_nan() }, "{i}: {theta}");
        }
    }
}
