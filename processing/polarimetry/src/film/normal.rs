//! Sums of a least-squares step over several points in parallel lanes, which the compiler vectorises.

use crate::film::curve::{Curve, PARAMETERS};
use crate::film::projection::{ClosestPoint, LANE_COUNT};

/// Scale of the Cauchy weights in standard deviations: the weight of larger distances decreases.
pub const CAUCHY: f64 = 3.0;

/// Maximum number of parameters of a family: those of a film.
const MOST: usize = PARAMETERS;

/// A few projections in parallel lanes; missing ones have zero weight.
pub(crate) struct Lanes {
    turn: [[f64; LANE_COUNT]; 2],
    gradient: [[f64; LANE_COUNT]; 2],
    distance: [f64; LANE_COUNT],
    weight: [f64; LANE_COUNT],
    mirror: [bool; LANE_COUNT],
}

impl Lanes {
    #[inline(always)]
    pub(crate) fn new(closest_points: &[ClosestPoint], scale: f64) -> Self {
        let none = [0.0; LANE_COUNT];
        let mut lanes = Self {
            turn: [none, [1.0; LANE_COUNT]],
            gradient: [none; 2],
            distance: none,
            weight: none,
            mirror: [false; LANE_COUNT],
        };
        for (i, closest) in closest_points.iter().enumerate().take(LANE_COUNT) {
            (lanes.turn[0][i], lanes.turn[1][i]) = closest.turn;
            (lanes.gradient[0][i], lanes.gradient[1][i]) = (closest.gradient[0], closest.gradient[1]);
            (lanes.distance[i], lanes.mirror[i]) = (closest.distance, closest.mirror);
            lanes.weight[i] = 1.0 / (1.0 + (closest.distance / (CAUCHY * scale)).powi(2)) / (scale * scale);
        }
        lanes
    }

    /// Positions of the projections on a curve.
    #[inline(always)]
    fn positions(&self, curve: &Curve) -> [[f64; LANE_COUNT]; 2] {
        let [mut x, mut y] = [[0.0; LANE_COUNT]; 2];
        for i in 0..LANE_COUNT {
            let (at, _) = curve.at_turn((self.turn[0][i], self.turn[1][i]));
            (x[i], y[i]) = (at[0], at[1]);
        }
        if let Some([mx, my]) = curve.mirror {
            for i in 0..LANE_COUNT {
                (x[i], y[i]) = if self.mirror[i] { (mx, my) } else { (x[i], y[i]) };
            }
        }
        [x, y]
    }
}

/// Sums of the lower triangle of the normal matrix and of the right side, lane by lane.
pub(crate) struct Normal {
    pub(crate) matrix: [[[f64; LANE_COUNT]; MOST]; MOST],
    pub(crate) right: [[f64; LANE_COUNT]; MOST],
}

impl Default for Normal {
    fn default() -> Self {
        let row = [[0.0; LANE_COUNT]; MOST];
        Self { matrix: [row; MOST], right: row }
    }
}

impl Normal {
    #[inline(always)]
    pub(crate) fn add(&mut self, closest_points: &Lanes, middle: &Curve, moved: &[(Curve, f64)]) {
        let [qx, qy] = closest_points.positions(middle);
        let [gx, gy] = &closest_points.gradient;
        let mut rows = [[0.0; LANE_COUNT]; MOST];
        for (row, (curve, step)) in rows.iter_mut().zip(moved) {
            let [px, py] = closest_points.positions(curve);
            for k in 0..LANE_COUNT {
                row[k] = (gx[k] * (px[k] - qx[k]) + gy[k] * (py[k] - qy[k])) / step;
            }
        }
        let sums = self.matrix.iter_mut().zip(&mut self.right);
        for (i, (sums, right)) in sums.enumerate().take(moved.len()) {
            let mut weighted = closest_points.weight;
            weighted.iter_mut().zip(&rows[i]).for_each(|(w, entry)| *w *= entry);
            let add = |sum: &mut [f64; LANE_COUNT], by: &[f64; LANE_COUNT]| {
                sum.iter_mut().zip(weighted.iter().zip(by)).for_each(|(sum, (w, by))| *sum += w * by);
            };
            sums.iter_mut().zip(&rows).take(i + 1).for_each(|(sum, row)| add(sum, row));
            add(right, &closest_points.distance);
        }
    }
}
