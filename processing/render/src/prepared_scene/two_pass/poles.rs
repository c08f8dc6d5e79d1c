//! Poles of filtered environments: common points of the meridians of some surface points.

use super::LookupPoint;
use crate::vector::V3;
use nalgebra::Matrix3;
use std::f64::consts::TAU;

/// Largest fraction of points that lie closer to the great circle of the poles than its clearance.
const NEAR: f64 = 0.05;

/// Largest distance of the meridians from a single pole, relative to the spacing of several poles.
const MISSED: f64 = 0.1;

/// Poles of filtered environments.
pub(super) struct Poles {
    axes: [V3; 2],
    /// Poles at equal spacing around the great circle of the two axes, or the first axis alone.
    needed: Vec<bool>,
}

impl Poles {
    /// Poles for some points. A single pole is used if all meridians pass it within a tenth of the spacing of `count`
    /// poles. Otherwise it is the subset of `count` poles around a great circle that the points need.
    pub(super) fn new(points: &[LookupPoint], count: usize) -> Self {
        let one = common(points);
        let off = points.iter().map(|point| angle(point, one).abs()).fold(0.0, f64::max);
        if points.is_empty() || off <= MISSED * TAU / count as f64 {
            return Self { axes: [one, one], needed: vec![!points.is_empty()] };
        }
        let mut poles = Self { axes: circle(points), needed: vec![false; count] };
        for point in points {
            for (k, weight) in poles.around(point) {
                poles.needed[k] |= weight > 0.0;
            }
        }
        // Points between the examined ones may need the adjacent poles.
        let some = poles.needed.clone();
        poles.needed = (0..count).map(|k| some[k] || some[(k + 1) % count] || some[(k + count - 1) % count]).collect();
        poles
    }

    pub(super) fn len(&self) -> usize {
        self.needed.len()
    }

    pub(super) fn needs(&self, k: usize) -> bool {
        self.needed[k]
    }

    pub(super) fn needed(&self) -> usize {
        self.needed.iter().filter(|n| **n).count()
    }

    pub(super) fn get(&self, k: usize) -> V3 {
        let (sin, cos) = (TAU * k as f64 / self.needed.len() as f64).sin_cos();
        self.axes[0] * cos + if self.needed.len() > 1 { self.axes[1] * sin } else { V3::zeros() }
    }

    /// The two poles next to a point's meridian, with their weights.
    pub(super) fn around(&self, point: &LookupPoint) -> [(usize, f64); 2] {
        let count = self.needed.len();
        if count == 1 {
            return [(0, 1.0), (0, 0.0)];
        }
        let [a, b] = self.axes;
        let crossing = point.mirror.cross(&point.north).cross(&a.cross(&b));
        // A meridian along the great circle intersects it everywhere.
        let crossing = if crossing.norm() > 1e-9 { crossing } else { point.north };
        let crossing = if crossing.dot(&point.north) < 0.0 { -crossing } else { crossing };
        let place = (crossing.dot(&b).atan2(crossing.dot(&a)) / TAU).rem_euclid(1.0) * count as f64;
        let first = place as usize % count;
        let pair = [first, (first + 1) % count];
        let [left, right] = pair.map(|k| angle(point, self.get(k)).abs());
        let share = if left + right > 0.0 { left / (left + right) } else { 0.0 };
        [(pair[0], 1.0 - share), (pair[1], share)]
    }
}

/// Angle at a point from its meridian to a pole, rad.
fn angle(point: &LookupPoint, pole: V3) -> f64 {
    pole.dot(&point.mirror.cross(&point.north)).atan2(pole.dot(&point.north))
}

/// The pole closest to the meridians of all points (least squares).
fn common(points: &[LookupPoint]) -> V3 {
    let mut sum = Matrix3::zeros();
    let mut north = V3::zeros();
    for point in points {
        let across = point.mirror.cross(&point.north);
        sum += across * across.transpose();
        north += point.north;
    }
    let eigen = sum.symmetric_eigen();
    let pole: V3 = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    if pole.dot(&north) < 0.0 { -pole } else { pole }
}

/// Axes of the great circle farthest from the mirror directions of some points: near it, poles would be close to the
/// points.
fn circle(points: &[LookupPoint]) -> [V3; 2] {
    let mut sum = Matrix3::zeros();
    let mut mean = V3::zeros();
    for point in points {
        sum += point.mirror * point.mirror.transpose();
        mean += point.mirror;
    }
    let vectors = sum.symmetric_eigen().eigenvectors;
    let own = (0..3).map(|k| vectors.column(k).into_owned());
    let candidates = own.chain([V3::x(), V3::y(), V3::z(), mean]).filter_map(|v: V3| v.try_normalize(1e-9));
    let clearance = |normal: &V3| {
        let mut sines: Vec<f64> = points.iter().map(|point| point.mirror.dot(normal).abs()).collect();
        sines.sort_by(f64::total_cmp);
        sines[(NEAR * sines.len() as f64) as usize]
    };
    let best = candidates.max_by(|a, b| clearance(a).total_cmp(&clearance(b)));
    let normal = best.unwrap_or_else(V3::z);
    let first = if normal.x.abs() < 0.9 { V3::x() } else { V3::y() };
    let first = (first - normal * normal.dot(&first)).normalize();
    [first, normal.cross(&first)]
}
