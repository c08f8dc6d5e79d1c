//! Mapping from pixels of the reference to pixels of the sample.

use nalgebra::{Matrix3, Vector3};

/// Exponents of the terms of the smooth displacement: all of degree two and three. Lower ones belong to the homography.
const TERMS: [[i32; 2]; 7] = [[2, 0], [1, 1], [0, 2], [3, 0], [2, 1], [1, 2], [0, 3]];

/// Kind of registration, from the most rigid one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Freedom {
    /// Shift, turn and scale.
    Similarity,
    /// Homography: a plane seen from another direction.
    Homography,
    /// Homography and a smooth displacement: an uneven sheet.
    Smooth,
}

/// A homography in coordinates that run from -1 to 1 over the reference, followed by a smooth displacement.
#[derive(Clone, Debug, PartialEq)]
pub struct Transform {
    homography: Matrix3<f64>,
    bend: [[f64; 2]; TERMS.len()],
    /// Middle of reference and sample, and pixels per unit.
    middles: [[f64; 2]; 2],
    half: f64,
}

impl Transform {
    /// A turn (rad, anticlockwise as seen), scale and shift (pixels of the sample) about the middles of both.
    pub fn similarity(sizes: [[usize; 2]; 2], turn: f64, scale: f64, shift: [f64; 2]) -> Self {
        let middles = sizes.map(|s| s.map(|n| 0.5 * (n as f64 - 1.0)));
        let half = 0.5 * sizes[0][0].max(sizes[0][1]) as f64;
        // Rows point down, so an anticlockwise turn has the opposite sign.
        let (sin, cos) = (-turn).sin_cos();
        let homography = Matrix3::new(
            scale * cos,
            -scale * sin,
            shift[0] / half,
            scale * sin,
            scale * cos,
            shift[1] / half,
            0.0,
            0.0,
            1.0,
        );
        Self { homography, bend: [[0.0; 2]; TERMS.len()], middles, half }
    }

    /// Coordinates from -1 to 1 over the longer side of the reference.
    pub fn unit(&self, x: f64, y: f64) -> [f64; 2] {
        [(x - self.middles[0][0]) / self.half, (y - self.middles[0][1]) / self.half]
    }

    /// Position in the sample of a pixel of the reference.
    pub fn at(&self, x: f64, y: f64) -> [f64; 2] {
        let [u, v] = self.unit(x, y);
        let projected = self.homography * Vector3::new(u, v, 1.0);
        let mut place = [projected[0] / projected[2], projected[1] / projected[2]];
        for (term, bend) in TERMS.iter().zip(&self.bend) {
            let value = u.powi(term[0]) * v.powi(term[1]);
            place.iter_mut().zip(bend).for_each(|(p, b)| *p += b * value);
        }
        [0, 1].map(|k| self.middles[1][k] + self.half * place[k])
    }

    /// Displacements in the sample, in pixels, per unit of each parameter at a pixel of the reference.
    pub fn derivatives(&self, freedom: Freedom, x: f64, y: f64, all: &mut Vec<[f64; 2]>) {
        let at = self.at(x, y);
        let [u, v] = [0, 1].map(|k| (at[k] - self.middles[1][k]) / self.half);
        all.clear();
        all.extend([[1.0, 0.0], [0.0, 1.0], [-v, u], [u, v]]);
        if freedom >= Freedom::Homography {
            all.extend([[u, -v], [v, u], [-u * u, -u * v], [-u * v, -v * v]]);
        }
        if freedom >= Freedom::Smooth {
            let [u, v] = self.unit(x, y);
            let values = TERMS.map(|term| u.powi(term[0]) * v.powi(term[1]));
            all.extend(values.iter().flat_map(|value| [[*value, 0.0], [0.0, *value]]));
        }
        all.iter_mut().for_each(|d| *d = d.map(|v| self.half * v));
    }

    /// Changes the parameters by a step.
    pub fn step(&mut self, by: &[f64]) {
        let get = |k: usize| by.get(k).copied().unwrap_or(0.0);
        let change = Matrix3::new(
            1.0 + get(3) + get(4),
            get(5) - get(2),
            get(0),
            get(2) + get(5),
            1.0 + get(3) - get(4),
            get(1),
            get(6),
            get(7),
            1.0,
        );
        self.homography = change * self.homography;
        self.homography /= self.homography[(2, 2)];
        for (k, bend) in self.bend.iter_mut().enumerate() {
            *bend = [bend[0] + get(8 + 2 * k), bend[1] + get(9 + 2 * k)];
        }
    }

    /// Turn in rad (anticlockwise as seen) and scale at the middle of the reference.
    pub fn turn_and_scale(&self) -> [f64; 2] {
        let [x, y] = self.middles[0];
        let (a, b, c, d) = (self.at(x + 1.0, y), self.at(x - 1.0, y), self.at(x, y + 1.0), self.at(x, y - 1.0));
        let (along, across) = (0.5 * (a[0] - b[0] + c[1] - d[1]), 0.5 * (a[1] - b[1] - c[0] + d[0]));
        [-across.atan2(along), 0.5 * along.hypot(across)]
    }

    /// Shift of the middle in pixels, right and down.
    pub fn shift(&self) -> [f64; 2] {
        let [x, y] = self.middles[0];
        let at = self.at(x, y);
        [at[0] - self.middles[1][0], at[1] - self.middles[1][1]]
    }

    /// Largest displacement by the smooth part at the corners and edges, in pixels.
    pub fn bend_px(&self) -> f64 {
        let at = |u: f64, v: f64| {
            let sum = TERMS.iter().zip(&self.bend).fold([0.0; 2], |s, (term, bend)| {
                let value = u.powi(term[0]) * v.powi(term[1]);
                [s[0] + bend[0] * value, s[1] + bend[1] * value]
            });
            self.half * sum[0].hypot(sum[1])
        };
        let ends = [-1.0, 0.0, 1.0];
        ends.iter().flat_map(|u| ends.iter().map(|v| at(*u, *v))).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_match_steps() {
        let mut transform = Transform::similarity([[200, 150], [220, 150]], 0.05, 1.02, [4.0, -3.0]);
        transform.step(&[0.0, 0.0, 0.0, 0.0, 0.01, -0.02, 0.03, 0.01]);
        let mut all = vec![];
        transform.derivatives(Freedom::Smooth, 40.0, 110.0, &mut all);
        for k in 0..all.len() {
            let mut by = vec![0.0; all.len()];
            by[k] = 1e-5;
            let mut moved = transform.clone();
            moved.step(&by);
            let (a, b) = (transform.at(40.0, 110.0), moved.at(40.0, 110.0));
            for c in 0..2 {
                assert!(((b[c] - a[c]) / 1e-5 - all[k][c]).abs() < 0.05, "{k} {c}: {a:?} {b:?} {:?}", all[k]);
            }
        }
    }

    #[test]
    fn turn_and_scale_are_those_of_the_similarity() {
        let transform = Transform::similarity([[200, 150], [200, 150]], 0.3, 0.9, [4.0, -3.0]);
        let [turn, scale] = transform.turn_and_scale();
        assert!((turn - 0.3).abs() < 1e-9 && (scale - 0.9).abs() < 1e-9, "{turn} {scale}");
        let shift = transform.shift();
        assert!((shift[0] - 4.0).abs() < 1e-9 && (shift[1] + 3.0).abs() < 1e-9);
    }
}
