//! Lookup table from points to the nearest points of a curve.

use super::{OUTLIER_SIGMAS, RUN, Run};
use crate::film::curve::Curve;
use nacre_base::vector_atan::{folded, sin_cos};
use nacre_base::vectors::vectorised;
use rayon::prelude::*;
use std::f32::consts::FRAC_PI_2;
use std::f64::consts::PI;

/// Nodes on the curve.
const NODES: usize = 1024;

/// Step of θ between nodes.
const STEP: f32 = std::f32::consts::PI / NODES as f32;

/// Cells of the table along each side.
const CELLS: usize = 256;

/// Difference of squared distance, in squared standard deviations, within which a second branch of the curve counts as
/// equally likely. If it is also farther along than both uncertainties, the pixel is masked.
const AMBIGUITY_DELTA: f32 = 9.0;

/// Squared distance from the position of bare metal that noise rarely exceeds, in squared standard deviations.
const MIRROR: f32 = 16.0;

/// Uncertainty in rad from which the variation of the curve within it is examined. Of 300 random films (r 0.7 to 1.5,
/// any ζ, Δn up to 12°) nine in ten slow down by at most 1.4 % within twice that.
const CURVATURE_SIGMA: f32 = 0.01;

/// Slowdown of the curve within the noise, relative to the point itself, above which no σ describes the error and the
/// pixel is masked. With 1.3, 98.8 % of the worst tenth of a film's pixels are within 3σ, with 1.25 99.1 %; 1.2 masks
/// 4.4 % of all pixels, this value 3.2 %.
const MAX_SLOWDOWN: f32 = 1.23;

/// Table from points to the nearest points of a curve.
pub(crate) struct Table {
    curve: Coefficients,
    low: [f32; 2],
    cells_per_unit: [f32; 2],
    /// Position of metal without a grating.
    mirror: Option<[f32; 2]>,
    /// Sine and cosine of 2θ at the nodes.
    turns: Vec<[f32; 2]>,
    /// Per cell the nearest node, and the nearest one of another branch (equal if there is none nearby).
    nearest: Vec<[u16; 2]>,
}

impl Table {
    pub(crate) fn new(curve: Curve) -> Self {
        let theta = |k: usize| PI * k as f64 / NODES as f64;
        let nodes: [Vec<f32>; 2] =
            std::array::from_fn(|axis| (0..NODES).map(|k| curve.at(theta(k))[axis] as f32).collect());
        let ends = |k: usize| nodes[k].iter().fold((f32::MAX, f32::MIN), |(l, h), p| (l.min(*p), h.max(*p)));
        let ((xl, xh), (yl, yh)) = (ends(0), ends(1));
        // Margin of the curve's size on every side; pixels beyond it do not follow the curve.
        let margin = 0.5 * (xh - xl).max(yh - yl).max(1e-6);
        let low = [xl - margin, yl - margin];
        let cells_per_unit = [xh - xl, yh - yl].map(|side| CELLS as f32 / (side + 2.0 * margin));
        let at = |k: usize, i: usize| low[k] + (i as f32 + 0.5) / cells_per_unit[k];
        let mut nearest = vec![[0; 2]; CELLS * CELLS];
        nearest.par_chunks_mut(CELLS).enumerate().for_each(|(row, cells)| {
            vectorised(
                #[inline(always)]
                || {
                    let (mut distances, mut least) = ([0.0; NODES + 2], [0; NODES]);
                    for (column, cell) in cells.iter_mut().enumerate() {
                        *cell = branches(&nodes, [at(0, column), at(1, row)], &mut distances, &mut least);
                    }
                },
            );
        });
        let turns = (0..NODES).map(|k| (2.0 * theta(k)).sin_cos()).map(|(s, c)| [s as f32, c as f32]).collect();
        let mirror = curve.mirror.map(|at| at.map(|v| v as f32));
        Self { curve: Coefficients::new(&curve), low, cells_per_unit, mirror, turns, nearest }
    }

    /// Orientation in rad of one point.
    #[inline]
    pub(crate) fn theta(&self, at: [f32; 2], variance: [f32; 3]) -> f32 {
        let [first, second] = self.nearest(at);
        let found = |node| self.refine(self.node(node), at, variance);
        let best = found(first);
        if first == second || self.mirror.is_some_and(|mirror| is_mirror(at, mirror, variance, best.distance2)) {
            return best.theta;
        }
        let other = found(second);
        if other.distance2 < best.distance2 { other.theta } else { best.theta }
    }

    /// Projects the first `count` points of a run.
    pub(super) fn project_run(&self, run: &mut Run, count: usize) {
        let mut first = ClosestPoints::new();
        let mut seconds = ClosestPoints::new();
        let mut which = [0_u16; RUN];
        let mut rivals = 0;
        for i in 0..count {
            let at = [run.x[i], run.y[i]];
            let [near, other] = self.nearest(at);
            first.begin(i, self.node(near));
            if other != near {
                seconds.begin(rivals, self.node(other));
                which[rivals] = i as u16;
                rivals += 1;
            }
        }
        vectorised(
            #[inline(always)]
            || {
                let [va, vb, vc] = &run.variance;
                self.refine_all(&mut first, count, [&run.x, &run.y], [va, vb, vc]);
                let picked = |plane: &[f32; RUN]| -> [f32; RUN] { which.map(|i| plane[usize::from(i) % RUN]) };
                if rivals > 0 {
                    let ([x, y], variance) = ([&run.x, &run.y].map(picked), run.variance.each_ref().map(picked));
                    self.refine_all(&mut seconds, rivals, [&x, &y], variance.each_ref());
                }
                run.theta[..count].copy_from_slice(&first.theta[..count]);
                run.mirror[..count].fill(0);
                for i in 0..count {
                    run.sigma[i] = first.sigma(i);
                }
                for (k, i) in which[..rivals].iter().map(|i| usize::from(*i)).enumerate() {
                    (run.theta[i], run.sigma[i]) = likelier_branch(&first, i, &seconds, k);
                }
                let Some(mirror) = self.mirror else { return };
                for i in 0..count {
                    let variance = run.variance.each_ref().map(|v| v[i]);
                    if is_mirror([run.x[i], run.y[i]], mirror, variance, first.distance2[i]) {
                        (run.theta[i], run.sigma[i], run.mirror[i]) = (first.theta[i], f32::INFINITY, 1);
                    }
                }
            },
        );
    }

    /// The two start nodes.
    #[inline(always)]
    fn nearest(&self, at: [f32; 2]) -> [u16; 2] {
        let cell = |k: usize| ((at[k] - self.low[k]) * self.cells_per_unit[k]).clamp(0.0, (CELLS - 1) as f32) as usize;
        self.nearest[cell(1) * CELLS + cell(0)]
    }

    /// θ, and sine and cosine of 2θ.
    #[inline(always)]
    fn node(&self, node: u16) -> [f32; 3] {
        let [sin, cos] = self.turns[usize::from(node)];
        [STEP * f32::from(node), sin, cos]
    }

    #[inline(always)]
    fn refine_all(
        &self,
        closest_points: &mut ClosestPoints,
        count: usize,
        [x, y]: [&[f32; RUN]; 2],
        [va, vb, vc]: [&[f32; RUN]; 3],
    ) {
        let count = count.min(RUN);
        for i in 0..count {
            let from = [closest_points.theta[i], closest_points.sin[i], closest_points.cos[i]];
            let closest = self.refine(from, [x[i], y[i]], [va[i], vb[i], vc[i]]);
            (closest_points.theta[i], closest_points.along[i], closest_points.excess[i], closest_points.distance2[i]) =
                (closest.theta, closest.along, closest.excess, closest.distance2);
        }
        if closest_points.along[..count].iter().any(|along| *along > CURVATURE_SIGMA) {
            for i in 0..count {
                let (theta, along) = (closest_points.theta[i], closest_points.along[i]);
                let curved_sigma = self.curved_sigma(theta, along, [va[i], vb[i], vc[i]]);
                closest_points.along[i] = if along > CURVATURE_SIGMA { curved_sigma } else { along };
            }
        }
    }

    /// Refines the projection near a node (θ, sine and cosine of 2θ), in the metric of the noise.
    #[inline(always)]
    fn refine(&self, [mut theta, mut sin, mut cos]: [f32; 3], at: [f32; 2], [va, vb, vc]: [f32; 3]) -> ClosestPoint {
        let [wa, wb, wc] = weights([va, vb, vc]);
        let (mut x, mut y, mut speed, mut t) = (0.0, 0.0, 0.0, [0.0; 2]);
        for round in 0..3 {
            let (q, tangent) = self.curve.with_tangent(sin, cos);
            (x, y, t) = (at[0] - q[0], at[1] - q[1], tangent);
            let (wx, wy) = (wa * t[0] + wb * t[1], wb * t[0] + wc * t[1]);
            speed = wx * t[0] + wy * t[1];
            if round < 2 {
                let on = ((wx * x + wy * y) / speed).clamp(-8.0 * STEP, 8.0 * STEP);
                let on = if speed > 0.0 { on } else { 0.0 };
                theta += on;
                [sin, cos] = rotated([sin, cos], 2.0 * on);
            }
        }
        let length2 = t[0] * t[0] + t[1] * t[1];
        // Along the normal, whose variance is that across the curve.
        let (nx, ny) = (-t[1], t[0]);
        let across = (va * nx * nx + 2.0 * vb * nx * ny + vc * ny * ny) / length2;
        let off2 = (nx * x + ny * y) * (nx * x + ny * y) / length2;
        ClosestPoint {
            theta,
            along: speed.sqrt().recip(),
            excess: (off2 - OUTLIER_SIGMAS * OUTLIER_SIGMAS * across).max(0.0) / length2,
            distance2: wa * x * x + 2.0 * wb * x * y + wc * y * y,
        }
    }

    /// σ along the curve where it turns or slows down within the noise, so that the displacement of a point per rad is
    /// smaller than at the point itself.
    #[inline(always)]
    fn curved_sigma(&self, theta: f32, along: f32, variance: [f32; 3]) -> f32 {
        let [wa, wb, wc] = weights(variance);
        let [sin, cos] = sin_cos(2.0 * theta);
        let here = self.curve.at(sin, cos);
        let weighted = |theta: f32| {
            let [sin, cos] = sin_cos(2.0 * theta);
            let q = self.curve.at(sin, cos);
            let (x, y) = (q[0] - here[0], q[1] - here[1]);
            (wa * x * x + 2.0 * wb * x * y + wc * y * y).sqrt()
        };
        let least = weighted(theta + 2.0 * along).min(weighted(theta - 2.0 * along));
        let slower = (2.0 / least).max(1.0);
        if slower > MAX_SLOWDOWN { f32::INFINITY } else { along * (0.6 + 0.4 * slower) }
    }
}

/// Projection of a point onto the curve.
struct ClosestPoint {
    theta: f32,
    /// σ along the curve in rad.
    along: f32,
    /// Additional variance for the distance from the curve.
    excess: f32,
    distance2: f32,
}

/// Projections of a run; `theta`, `sin` and `cos` initially hold the start nodes.
struct ClosestPoints {
    theta: [f32; RUN],
    sin: [f32; RUN],
    cos: [f32; RUN],
    along: [f32; RUN],
    excess: [f32; RUN],
    distance2: [f32; RUN],
}

impl ClosestPoints {
    fn new() -> Self {
        let plane = [0.0; RUN];
        Self { theta: plane, sin: plane, cos: plane, along: plane, excess: plane, distance2: plane }
    }

    #[inline(always)]
    fn begin(&mut self, i: usize, [theta, sin, cos]: [f32; 3]) {
        (self.theta[i], self.sin[i], self.cos[i]) = (theta, sin, cos);
    }

    #[inline(always)]
    fn sigma(&self, i: usize) -> f32 {
        (self.along[i] * self.along[i] + self.excess[i]).sqrt()
    }
}

/// Orientation and σ of the nearer projection; σ is infinite if both are about equally likely.
#[inline(always)]
fn likelier_branch(first: &ClosestPoints, i: usize, second: &ClosestPoints, k: usize) -> (f32, f32) {
    let apart = folded(folded(first.theta[i] - second.theta[k]) + FRAC_PI_2) - FRAC_PI_2;
    // A point at which the curve is too bent for a σ is still a competing branch.
    let (less, more) = (first.along[i].min(second.along[k]), first.along[i].max(second.along[k]));
    let along = if more.is_finite() { more } else { less };
    let lead = second.distance2[k] - first.distance2[i];
    let (theta, sigma) = if lead < 0.0 { (second.theta[k], second.sigma(k)) } else { (first.theta[i], first.sigma(i)) };
    let rival = lead.abs() < AMBIGUITY_DELTA && apart.abs() > 3.0 * along;
    (theta, if rival { f32::INFINITY } else { sigma })
}

/// Whether a point is more likely metal without a grating than a grating at this distance from the curve.
#[inline(always)]
fn is_mirror(at: [f32; 2], mirror: [f32; 2], variance: [f32; 3], from_curve2: f32) -> bool {
    let from_mirror2 = distance2(at, mirror, variance);
    from_mirror2 < from_curve2 || (from_mirror2 < MIRROR && from_mirror2 - from_curve2 < AMBIGUITY_DELTA)
}

/// Squared distance of two points in standard deviations.
#[inline(always)]
pub(crate) fn distance2(p: [f32; 2], q: [f32; 2], [va, vb, vc]: [f32; 3]) -> f32 {
    let (x, y) = (p[0] - q[0], p[1] - q[1]);
    (vc * x * x - 2.0 * vb * x * y + va * y * y) / (va * vc - vb * vb)
}

/// The inverse of a covariance.
#[inline(always)]
fn weights([va, vb, vc]: [f32; 3]) -> [f32; 3] {
    let determinant = va * vc - vb * vb;
    [vc / determinant, -vb / determinant, va / determinant]
}

/// Sine and cosine of an angle increased by at most 0.05 rad.
#[inline(always)]
fn rotated([s, c]: [f32; 2], by: f32) -> [f32; 2] {
    let square = by * by;
    let sin = by * (1.0 - square * (1.0 / 6.0) * (1.0 - square * (1.0 / 20.0)));
    let cos = 1.0 - 0.5 * square * (1.0 - square * (1.0 / 12.0));
    [s * cos + c * sin, c * cos - s * sin]
}

/// The nearest node, and the nearest one separated from it by farther nodes. `distances` begins with the last node's
/// and ends with the first one's; `least` marks minima.
#[inline(always)]
fn branches(
    [xs, ys]: &[Vec<f32>; 2],
    at: [f32; 2],
    distances: &mut [f32; NODES + 2],
    least: &mut [u8; NODES],
) -> [u16; 2] {
    for (d, (nx, ny)) in distances[1..=NODES].iter_mut().zip(xs.iter().zip(ys)) {
        let (x, y) = (nx - at[0], ny - at[1]);
        *d = x * x + y * y;
    }
    (distances[0], distances[NODES + 1]) = (distances[NODES], distances[1]);
    for (k, least) in least.iter_mut().enumerate() {
        *least = u8::from((distances[k + 1] <= distances[k]) & (distances[k + 1] < distances[k + 2]));
    }
    let (mut first, mut second) = ((f32::INFINITY, 0), (f32::INFINITY, None));
    for (group, eight) in least.as_chunks::<8>().0.iter().enumerate() {
        if u64::from_ne_bytes(*eight) == 0 {
            continue;
        }
        for k in (8 * group..8 * group + 8).filter(|k| least[*k] != 0) {
            let found = (distances[k + 1], k as u16);
            if found.0 < first.0 {
                second = (first.0, first.0.is_finite().then_some(first.1));
                first = found;
            } else if found.0 < second.0 {
                second = (found.0, Some(found.1));
            }
        }
    }
    [first.1, second.1.unwrap_or(first.1)]
}

/// A curve in single precision.
struct Coefficients([[f32; 5]; 3]);

impl Coefficients {
    fn new(curve: &Curve) -> Self {
        let all = curve.coefficients();
        // Normalised by the mean of S0, to avoid underflow.
        Self(all.map(|row| row.map(|v| (v / all[0][0]) as f32)))
    }

    /// The point for this sine and cosine of 2θ.
    #[inline(always)]
    fn at(&self, s: f32, c: f32) -> [f32; 2] {
        let (s2, c2) = (2.0 * s * c, c * c - s * s);
        let [s0, s1, s2] = self.0.each_ref().map(|k| k[0] + k[1] * c + k[2] * s + k[3] * c2 + k[4] * s2);
        [s1 / s0, s2 / s0]
    }

    /// The point and its derivative with respect to θ.
    #[inline(always)]
    fn with_tangent(&self, s: f32, c: f32) -> ([f32; 2], [f32; 2]) {
        let (s2, c2) = (2.0 * s * c, c * c - s * s);
        let value = |k: &[f32; 5]| k[0] + k[1] * c + k[2] * s + k[3] * c2 + k[4] * s2;
        let slope = |k: &[f32; 5]| 2.0 * (k[2] * c - k[1] * s) + 4.0 * (k[4] * c2 - k[3] * s2);
        let [s0, s1, s2] = self.0.each_ref().map(value);
        let [d0, d1, d2] = self.0.each_ref().map(slope);
        let (per, x, y) = (1.0 / s0, s1 / s0, s2 / s0);
        ([x, y], [(d1 - x * d0) * per, (d2 - y * d0) * per])
    }
}
