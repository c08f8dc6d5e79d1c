//! Sums of a least-squares step over several points in parallel lanes, which the compiler vectorises.

use crate::film::curve::{Curve, PARAMETERS};
use crate::film::foot::{Foot, SIDE_BY_SIDE};

/// Scale of the Cauchy weights in standard deviations: the weight of larger distances decreases.
pub const CAUCHY: f64 = 3.0;

/// Maximum number of parameters of a family: those of a film.
const MOST: usize = PARAMETERS;

/// A few projections in parallel lanes; missing ones have zero weight.
pub(crate) struct Lanes {
    turn: [[f64; SIDE_BY_SIDE]; 2],
    gradient: [[f64; SIDE_BY_SIDE]; 2],
    distance: [f64; SIDE_BY_SIDE],
    weight: [f64; SIDE_BY_SIDE],
    mirror: [bool; SIDE_BY_SIDE],
}

impl Lanes {
    #[inline(always)]
    pub(crate) fn new(feet: &[Foot], scale: f64) -> Self {
        let none = [0.0; SIDE_BY_SIDE];
        let mut lanes = Self {
            turn: [none, [1.0; SIDE_BY_SIDE]],
            gradient: [none; 2],
            distance: none,
            weight: none,
            mirror: [false; SIDE_BY_SIDE],
        };
        for (i, foot) in feet.iter().enumerate().take(SIDE_BY_SIDE) {
            (lanes.turn[0][i], lanes.turn[1][i]) = foot.turn;
            (lanes.gradient[0][i], lanes.gradient[1][i]) = (foot.gradient[0], foot.gradient[1]);
            (lanes.distance[i], lanes.mirror[i]) = (foot.distance, foot.mirror);
            lanes.weight[i] = 1.0 / (1.0 + (foot.distance / (CAUCHY * scale)).powi(2)) / (scale * scale);
        }
        lanes
    }

    /// Positions of the projections on a curve.
    #[inline(always)]
    fn places(&self, curve: &Curve) -> [[f64; SIDE_BY_SIDE]; 2] {
        let [mut x, mut y] = [[0.0; SIDE_BY_SIDE]; 2];
        for i in 0..SIDE_BY_SIDE {
            let (at, _) = curve.at_turn((self.turn[0][i], self.turn[1][i]));
            (x[i], y[i]) = (at[0], at[1]);
        }
        if let Some([mx, my]) = curve.mirror {
            for i in 0..SIDE_BY_SIDE {
                (x[i], y[i]) = if self.mirror[i] { (mx, my) } else { (x[i], y[i]) };
            }
        }
        [x, y]
    }
}

/// Sums of the lower triangle of the normal matrix and of the right side, lane by lane.
pub(crate) struct Normal {
    pub(crate) matrix: [[[f64; SIDE_BY_SIDE]; MOST]; MOST],
    pub(crate) right: [[f64; SIDE_BY_SIDE]; MOST],
}

impl Default for Normal {
    fn default() -> Self {
        let row = [[0.0; SIDE_BY_SIDE]; MOST];
        Self { matrix: [row; MOST], right: row }
    }
}

impl Normal {
    #[inline(always)]
    pub(crate) fn add(&mut self, feet: &Lanes, middle: &Curve, moved: &[(Curve, f64)]) {
        let [qx, qy] = feet.places(middle);
        let [gx, gy] = &feet.gradient;
        let mut rows = [[0.0; SIDE_BY_SIDE]; MOST];
        for (row, (curve, step)) in rows.iter_mut().zip(moved) {
            let [px, py] = feet.places(curve);
            for k in 0..SIDE_BY_SIDE {
                row[k] = (gx[k] * (px[k] - qx[k]) + gy[k] * (py[k] - qy[k])) / step;
            }
        }
        let sums = self.matrix.iter_mut().zip(&mut self.right);
        for (i, (sums, right)) in sums.enumerate().take(moved.len()) {
            let mut weighted = feet.weight;
            weighted.iter_mut().zip(&rows[i]).for_each(|(w, entry)| *w *= entry);
            let add = |sum: &mut [f64; SIDE_BY_SIDE], by: &[f64; SIDE_BY_SIDE]| {
                sum.iter_mut().zip(weighted.iter().zip(by)).for_each(|(sum, (w, by))| *sum += w * by);
            };
            sums.iter_mut().zip(&rows).take(i + 1).for_each(|(sum, row)| add(sum, row));
            add(right, &feet.distance);
        }
    }
}
