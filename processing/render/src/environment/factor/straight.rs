//! Coordinates in which a pattern's two directions lie along the axes, and in which two passes over a sphere are exact.
//!
//! A surface at `r` with `n = ωo = r` (2017 CVMP, section 3.2) receives light from the hemisphere around r. Let `b` be
//! north at r and `e` east. A light `ωi` has the sine x = ωi·e, and lies at the angle β from r towards north, seen
//! along e. The solid angle is `dx dβ` (a sphere and its circumscribed cylinder have equal areas), so the coordinates
//! include the Jacobian 1/cos θi. A step by β along the meridian followed by a step by x across it is exact everywhere,
//! including the poles. The reason is that the meridian is a great circle perpendicular to one fixed e. A second
//! direction that is not perpendicular to the first shears β by an angle that depends on x only.

use super::super::Table;
use std::f64::consts::FRAC_PI_2;

/// Maximum number of rows of a straightened table.
const MAX_ROWS: usize = 4096;

/// Straightened coordinates of a table.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Direction of the table along the meridian, anticlockwise from its right, radians.
    pub meridian: f64,
    /// Deviation of the other direction from the perpendicular, radians.
    pub shear: f64,
    /// Largest x and β.
    pub reach: [f64; 2],
    /// Cells along x, and along β.
    pub size: [usize; 2],
}

impl Grid {
    /// Grid for a table and its two directions: the first lies across the meridian, the second along it.
    pub(super) fn new(table: &Table, [across, along]: [f64; 2]) -> Self {
        let (sin, cos) = along.sin_cos();
        let (u, v) = (across.cos() * sin - across.sin() * cos, across.cos() * cos + across.sin() * sin);
        // The opposite sense of the same line, if it points west.
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
        grid.size[1] = ((2.0 * grid.reach[1] / table.cell()).ceil() as usize).clamp(2, MAX_ROWS);
        grid
    }

    /// Direction of the table across the meridian, anticlockwise from its right, radians.
    pub fn across(&self) -> f64 {
        self.meridian - FRAC_PI_2 + self.shear
    }

    /// Centre of a column.
    pub fn x(&self, i: usize) -> f64 {
        self.reach[0] * ((2.0 * i as f64 + 1.0) / self.size[0] as f64 - 1.0)
    }

    /// Centre of a row.
    pub fn beta(&self, j: usize) -> f64 {
        self.reach[1] * ((2.0 * j as f64 + 1.0) / self.size[1] as f64 - 1.0)
    }

    /// Width and height of a cell; their product is its solid angle.
    pub fn cell(&self) -> [f64; 2] {
        [0, 1].map(|k| 2.0 * self.reach[k] / self.size[k] as f64)
    }

    /// Shear of β at x: the distance along the meridian covered by a great circle that leaves it at the shear angle.
    pub fn lean(&self, x: f64) -> f64 {
        let sine = (x / self.shear.cos()).clamp(-0.999, 0.999);
        (sine / (1.0 - sine * sine).sqrt() * self.shear.sin()).atan()
    }

    /// Half vector of the table, and cosine of the angle of incidence.
    pub(super) fn half(&self, x: f64, beta: f64) -> ([f64; 2], f64) {
        let (s, c) = self.meridian.sin_cos();
        let across = (1.0 - x * x).sqrt();
        let (sin, cos) = (beta + self.lean(x)).sin_cos();
        let y = across * sin;
        ([x * s + y * c, y * s - x * c], across * cos)
    }

    /// Position of a half vector in cells from the corner of the grid, and the cosine of the angle of incidence.
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

    /// Half vector of a cell, and (1 + ωi·ωo)² there; `None` where the table has no incident direction.
    pub(super) fn entry(&self, table: &Table, i: usize, j: usize) -> Option<([f64; 2], f64)> {
        let (x, beta) = (self.x(i), self.beta(j));
        let (h, z) = self.half(x, beta);
        let inside = (beta + self.lean(x)).abs() < FRAC_PI_2 && h.iter().all(|v| v.abs() <= table.extent);
        inside.then(|| (h, (1.0 + z).powi(2)))
    }

    /// Reflected radiance per unit of x and β for incident radiance 1, times `weight` of the half vector; column by
    /// column.
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
