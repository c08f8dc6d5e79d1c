//! Coordinates in which a pattern's two directions lie along the axes, and two passes over a sphere are exact.
//!
//! A surface at `r` with `n = ωo = r` (2017 CVMP, section 3.2) sees light from all over the hemisphere around r. Let `b` be north at r and
//! `e` east. A light `ωi` has the sine x = ωi·e, and lies at the angle β from r towards north, seen along e. Solid angle is `dx dβ` (a sphere
//! and the cylinder around it have the same area), so that the Jacobian 1/cos θi is in the coordinates. Going β along the meridian first and
//! then off it by x is exact everywhere, the poles included, because the meridian is a great circle at right angles to one and the same e.
//! A second direction that is not at right angles to the first shears β by an angle that depends on x only.

use super::super::Table;
use std::f64::consts::FRAC_PI_2;

/// Most rows of a straightened table.
const MOST_ROWS: usize = 4096;

/// Straightened coordinates of a table.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Direction of the table that lies along the meridian, anticlockwise from its right, radians.
    pub meridian: f64,
    /// Angle of the other direction from the right angle to it, radians.
    pub shear: f64,
    /// Largest x and β.
    pub reach: [f64; 2],
    /// Cells along x, and along β.
    pub size: [usize; 2],
}

impl Grid {
    /// For a table and its two directions, the first of which is to lie across and the second along the meridian.
    pub(super) fn new(table: &Table, [across, along]: [f64; 2]) -> Self {
        let (sin, cos) = along.sin_cos();
        let (u, v) = (across.cos() * sin - across.sin() * cos, across.cos() * cos + across.sin() * sin);
        // The same line in the other sense, if it points west.
        let shear = if u < 0.0 { (-v).atan2(-u) } else { v.atan2(u) };
        let reach = (table.extent * (sin.abs() + cos.abs())).min(0.999);
        let mut grid = Self { meridian: along, shear, reach: [reach, FRAC_PI_2], size: [table.size, 2] };
        grid.size[0] += grid.size[0] % 2;
        let far = table.extent * (sin.abs() + cos.abs());
        let angle = |i: usize| {
            let x = grid.x(i);
            (far / (1.0 - x * x).sqrt()).min(1.0).asin() + grid.lean(x).abs()
        };
        grid.reach[1] = (0..grid.size[0]).map(angle).fold(0.0, f64::max);
        grid.size[1] = ((2.0 * grid.reach[1] / table.cell()).ceil() as usize).clamp(2, MOST_ROWS);
        grid
    }

    /// Direction of the table that lies across the meridian, anticlockwise from its right, radians.
    pub fn across(&self) -> f64 {
        self.meridian - FRAC_PI_2 + self.shear
    }

    /// Middle of a column.
    pub fn x(&self, i: usize) -> f64 {
        self.reach[0] * ((2.0 * i as f64 + 1.0) / self.size[0] as f64 - 1.0)
    }

    /// Middle of a row.
    pub fn beta(&self, j: usize) -> f64 {
        self.reach[1] * ((2.0 * j as f64 + 1.0) / self.size[1] as f64 - 1.0)
    }

    /// Width and height of a cell; their product is its solid angle.
    pub fn cell(&self) -> [f64; 2] {
        [0, 1].map(|k| 2.0 * self.reach[k] / self.size[k] as f64)
    }

    /// How far β is sheared at x: a great circle that leaves the meridian at the shear's angle has come so far along it.
    pub fn lean(&self, x: f64) -> f64 {
        let sine = (x / self.shear.cos()).clamp(-0.999, 0.999);
        (sine / (1.0 - sine * sine).sqrt() * self.shear.sin()).atan()
    }

    /// Half vector of the table and cosine of the light's angle.
    pub(super) fn half(&self, x: f64, beta: f64) -> ([f64; 2], f64) {
        let (s, c) = self.meridian.sin_cos();
        let across = (1.0 - x * x).sqrt();
        let (sin, cos) = (beta + self.lean(x)).sin_cos();
        let y = across * sin;
        ([x * s + y * c, y * s - x * c], across * cos)
    }

    /// Place of a half vector in cells from the corner of the grid, and the cosine of the light's angle.
    pub(super) fn position(&self, h: [f64; 2]) -> Option<([f64; 2], f64)> {
        let (s, c) = self.meridian.sin_cos();
        let (x, y) = (h[0] * s - h[1] * c, h[0] * c + h[1] * s);
        let z = (1.0 - x * x - y * y).max(0.0).sqrt();
        let beta = y.atan2(z) - self.lean(x);
        let place = |v: f64, k: usize| {
            let at = (v / self.reach[k] + 1.0) * 0.5 * self.size[k] as f64;
            (0.0..self.size[k] as f64).contains(&at).then_some(at)
        };
        (z > 0.0).then_some(())?;
        Some(([place(x, 0)?, place(beta, 1)?], z))
    }

    /// Half vector of a cell, and the square of 1 + ωi·ωo there; none where the table has no light from.
    pub(super) fn entry(&self, table: &Table, i: usize, j: usize) -> Option<([f64; 2], f64)> {
        let (x, beta) = (self.x(i), self.beta(j));
        let (h, z) = self.half(x, beta);
        let inside = (beta + self.lean(x)).abs() < FRAC_PI_2 && h.iter().all(|v| v.abs() <= table.extent);
        inside.then(|| (h, (1.0 + z).powi(2)))
    }

    /// Radiance that a light of radiance 1 per unit of x and β adds, times `weight` of the half vector; one column after the other.
    pub(super) fn kernel(&self, table: &Table, weight: impl Fn([f64; 2]) -> f64) -> [Vec<f64>; 3] {
        let [columns, rows] = self.size;
        let mut kernel: [Vec<f64>; 3] = std::array::from_fn(|_| Vec::with_capacity(columns * rows));
        for i in 0..columns {
            for j in 0..rows {
                let (value, factor) = match self.entry(table, i, j) {
                    Some((h, square)) => (table.at(h), square * weight(h)),
                    None => ([0.0; 3], 0.0),
                };
                (0..3).for_each(|c| kernel[c].push(f64::from(value[c]) * factor));
            }
        }
        kernel
    }
}
