//! Triangulation of faces with more than three corners: fans for convex faces, otherwise ear clipping.

use super::fault::{Decoded, Fault};
use crate::shape::mesh::has_area;
use crate::vector::V3;

/// Maximum number of comparisons in ear clipping for all faces of a mesh (about 10 s).
const MAX_WORK: u64 = 1 << 31;

/// Area, relative to the squared extent of a face, below which a corner counts as straight.
const STRAIGHT: f64 = 1e-14;

/// Outline of a face.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outline {
    /// The triangles cover the face once.
    Simple,
    /// All corners lie on a line: no triangles.
    Flat,
    /// The outline intersects itself, so the surface is ambiguous.
    Crossing,
}

/// Triangulation of the faces of one mesh, with a count of its work.
#[derive(Default)]
pub(super) struct Triangulation {
    work: u64,
}

type P2 = [f64; 2];

/// Twice the signed area of a triangle, positive anticlockwise.
fn cross(a: P2, b: P2, c: P2) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

impl Triangulation {
    /// Adds the triangles of a face of four or more corners, as indices of its corners. Degenerate triangles are
    /// omitted.
    ///
    /// # Errors
    /// If concave faces with very many corners would take too long.
    pub(super) fn face(&mut self, places: &[V3], triangles: &mut Vec<[usize; 3]>) -> Decoded<Outline> {
        let Some(points) = project(places) else {
            return Ok(if places.windows(3).any(|w| has_area([w[0], w[1], w[2]])) {
                // The parts of a symmetric figure of eight cancel.
                fan(places, triangles);
                Outline::Crossing
            } else {
                Outline::Flat
            });
        };
        let extent = extent(&points);
        let straight = STRAIGHT * extent * extent;
        if is_convex(&points, straight) {
            fan(places, triangles);
            return Ok(Outline::Simple);
        }
        let mut ring = Ring::new(&points, straight);
        ring.clip(triangles, &mut self.work)?;
        let whole = area(&points).abs();
        let parts: f64 = triangles.iter().map(|t| cross(points[t[0]], points[t[1]], points[t[2]]).abs()).sum();
        triangles.retain(|t| has_area(t.map(|k| places[k])));
        Ok(if parts > whole * (1.0 + 1e-6) { Outline::Crossing } else { Outline::Simple })
    }
}

fn fan(places: &[V3], triangles: &mut Vec<[usize; 3]>) {
    let all = (2..places.len()).map(|k| [0, k - 1, k]);
    triangles.extend(all.filter(|t| has_area(t.map(|k| places[k]))));
}

/// Projects the face onto the coordinate plane to which it is most parallel, anticlockwise; `None` for a face of zero
/// area.
fn project(places: &[V3]) -> Option<Vec<P2>> {
    // Newell's normal, from differences to the first corner.
    let from = places[0];
    let next = places.iter().skip(1).chain(&places[..1]);
    let normal: V3 = places.iter().zip(next).map(|(p, q)| (p - from).cross(&(q - from))).sum();
    let longest = places.iter().map(|p| (p - from).norm_squared()).fold(0.0, f64::max);
    if normal.norm().is_nan() || normal.norm() <= 1e-12 * longest {
        return None;
    }
    let axis = normal.iamax();
    let [mut u, mut v] = [(axis + 1) % 3, (axis + 2) % 3];
    if normal[axis] < 0.0 {
        std::mem::swap(&mut u, &mut v);
    }
    Some(places.iter().map(|p| [p[u], p[v]]).collect())
}

fn extent(points: &[P2]) -> f64 {
    let side = |k: usize| {
        let (low, high) = points.iter().fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p[k]), h.max(p[k])));
        high - low
    };
    side(0).max(side(1))
}

/// Twice the signed area.
fn area(points: &[P2]) -> f64 {
    (2..points.len()).map(|k| cross(points[0], points[k - 1], points[k])).sum()
}

/// Whether all corners turn left, once around.
fn is_convex(points: &[P2], straight: f64) -> bool {
    let n = points.len();
    let left = (0..n).all(|k| cross(points[k], points[(k + 1) % n], points[(k + 2) % n]) >= -straight);
    // Along x a convex outline reverses twice; spikes and stars reverse more often.
    let steps = (0..n).map(|k| points[(k + 1) % n][0] - points[k][0]).filter(|d| *d != 0.0);
    let signs: Vec<bool> = steps.map(|d| d > 0.0).collect();
    let turns = (0..signs.len()).filter(|k| signs[*k] != signs[(k + 1) % signs.len()]).count();
    left && turns == 2
}

/// Corners of the part of a face that has not been clipped yet.
struct Ring<'a> {
    points: &'a [P2],
    before: Vec<usize>,
    after: Vec<usize>,
    straight: f64,
    /// Corners may coincide, as where a cut leads to a hole.
    touching: bool,
}

impl<'a> Ring<'a> {
    fn new(points: &'a [P2], straight: f64) -> Self {
        let n = points.len();
        let mut sorted = points.to_vec();
        sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        let touching = sorted.windows(2).any(|w| w[0] == w[1]);
        let before = (0..n).map(|k| (k + n - 1) % n).collect();
        let after = (0..n).map(|k| (k + 1) % n).collect();
        Self { points, before, after, straight, touching }
    }

    /// Clips ears until three corners remain. Without an ear the outline intersects itself, and any convex corner is
    /// clipped.
    fn clip(&mut self, triangles: &mut Vec<[usize; 3]>, work: &mut u64) -> Decoded<()> {
        let mut left = self.points.len();
        let (mut at, mut tried) = (0, 0);
        while left > 3 {
            let [a, b, c] = [self.before[at], at, self.after[at]];
            let turn = cross(self.points[a], self.points[b], self.points[c]);
            let straight = turn.abs() <= self.straight;
            // A full round without an ear: coincident corners are allowed in the second round, intersections in the
            // third.
            let round = tried / left;
            let ear = turn > self.straight && (round >= 2 || self.is_ear([a, b, c], round == 0, left, work)?);
            if straight || ear || round >= 3 {
                if !straight {
                    triangles.push([a, b, c]);
                }
                self.after[a] = c;
                self.before[c] = a;
                left -= 1;
                tried = 0;
                // Every other corner, so that long outlines do not become fans of slivers.
                at = self.after[c];
            } else {
                tried += 1;
                at = c;
            }
        }
        triangles.push([self.before[at], at, self.after[at]]);
        Ok(())
    }

    /// Whether no part of the outline lies within the triangle of a convex corner, nor on its edges if `strict`.
    fn is_ear(&self, [a, b, c]: [usize; 3], strict: bool, left: usize, work: &mut u64) -> Decoded<bool> {
        *work += left as u64;
        if *work > MAX_WORK {
            let problem =
                format!("has concave faces of up to {} corners that take too long to split", self.points.len());
            return Err(Fault::refused(problem, "export the mesh with triangles"));
        }
        let corners = [a, b, c].map(|k| self.points[k]);
        let [p, q, r] = corners;
        let least = if strict { -self.straight } else { self.straight };
        let mut k = self.after[c];
        while k != a {
            let point = self.points[k];
            let inside = cross(p, q, point) >= least && cross(q, r, point) >= least && cross(r, p, point) >= least;
            if inside && !corners.contains(&point) {
                return Ok(false);
            }
            k = self.after[k];
        }
        Ok(!self.touching || !self.crosses([a, c]))
    }

    /// Whether an edge of the outline intersects the line between two corners.
    fn crosses(&self, [a, c]: [usize; 2]) -> bool {
        let [p, r] = [self.points[a], self.points[c]];
        let mut k = self.after[c];
        while k != a {
            let [s, t] = [self.points[k], self.points[self.after[k]]];
            if cross(p, r, s) * cross(p, r, t) < 0.0 && cross(s, t, p) * cross(s, t, r) < 0.0 {
                return true;
            }
            k = self.after[k];
        }
        false
    }
}
