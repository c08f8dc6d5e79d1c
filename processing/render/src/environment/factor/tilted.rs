//! Factorisation for views off the normal.
//!
//! The paper's passes assume n = ωo = r (2017 CVMP, section 3.2). Consider a surface tilted from the mirror direction r
//! by the angle θ, with the viewer on its other side at 2θ from r. Its reflection is also a function of the light's
//! position around r alone: `S(h) (1 + ωi·ωo)²` with the half vector along the tilted surface. With the tilt the
//! pattern stretches and bends gradually, so it remains nearly separable.

use super::parts::Part;
use super::straight::Grid;
use std::f64::consts::{FRAC_PI_2, PI};

/// Largest tilt in rad: grazing surfaces reflect almost no light.
const MAX_TILT: f64 = 1.54;

/// Maximum number of cells along x, and along β.
const MAX_CELLS: [usize; 2] = [512, 1024];

/// Sampling points along a side in the search for the extent of a pattern.
const LOOKS: usize = 64;

/// Geometry of reflection at a tilted surface.
struct Tilt {
    sin: f64,
    cos: f64,
    /// Direction of the tilt, east and north.
    towards: [f64; 2],
}

impl Tilt {
    fn new([x, y]: [f64; 2]) -> Self {
        let angle = x.hypot(y);
        let (sin, cos) = angle.min(MAX_TILT).sin_cos();
        let towards = if angle > 1e-9 { [x / angle, y / angle] } else { [1.0, 0.0] };
        Self { sin, cos, towards }
    }

    /// Half vector along the surface (east, north), and `(1 + ωi·ωo)²` for a light (east, north, towards r); `None`
    /// below the surface.
    fn of(&self, [x, y, z]: [f64; 3]) -> Option<([f64; 2], f64)> {
        let Self { sin, cos, towards } = *self;
        let along = x * towards[0] + y * towards[1];
        if z * cos + along * sin <= 0.0 {
            return None;
        }
        let moved = along * cos - z * sin + sin - along;
        let (sin2, cos2) = (2.0 * sin * cos, cos * cos - sin * sin);
        let gain = (1.0 + z * cos2 + along * sin2).powi(2);
        Some(([x + moved * towards[0], y + moved * towards[1]], gain))
    }
}

impl Part {
    /// Factorises the pattern of surfaces tilted from the mirror direction towards the viewer, with the same
    /// directions. The length of `tilt` is the angle (rad), its direction is given east and north. `value` is the table
    /// at a half vector. There are at most `most` terms, and no more than a residual of `max_error` requires. Cells are
    /// at least `least_cell` (rad) wide.
    pub(crate) fn tilted(
        &self,
        tilt: [f64; 2],
        value: impl Fn([f64; 2]) -> [f64; 3],
        extent: f64,
        least_cell: f64,
        (most, max_error): (usize, f64),
    ) -> Self {
        let tilt = Tilt::new(tilt);
        let (s, c) = self.grid.meridian.sin_cos();
        let of_table = |[x, y]: [f64; 2]| [x * s + y * c, y * s - x * c];
        let inside = |light: [f64; 3]| {
            let (h, gain) = tilt.of(light)?;
            let h = of_table(h);
            h.iter().all(|v| v.abs() <= extent).then_some((h, gain))
        };
        let grid = self.reaching(least_cell, |light| inside(light).is_some());
        let [columns, rows] = grid.size;
        let mut kernel: [Vec<f64>; 3] = std::array::from_fn(|_| Vec::with_capacity(columns * rows));
        for i in 0..columns {
            let x = grid.x(i);
            for j in 0..rows {
                let (rgb, gain) =
                    inside(light(x, grid.beta(j) + grid.lean(x))).map_or(([0.0; 3], 0.0), |(h, g)| (value(h), g));
                (0..3).for_each(|k| kernel[k].push(rgb[k] * gain));
            }
        }
        Self::of_kernel(grid, kernel, most, max_error)
    }

    /// The grid that contains the whole pattern, with cells at least as wide as at present.
    fn reaching(&self, least_cell: f64, inside: impl Fn([f64; 3]) -> bool) -> Grid {
        let mut grid = self.grid.clone();
        let [dx, dy] = grid.cell().map(|cell| cell.max(least_cell));
        let mut reach = [0.0_f64; 2];
        for i in 0..LOOKS * 2 * LOOKS {
            let x = 0.999 * ((2 * (i % LOOKS) + 1) as f64 / LOOKS as f64 - 1.0);
            let beta = PI * ((2 * (i / LOOKS) + 1) as f64 / (2 * LOOKS) as f64 - 1.0);
            if inside(light(x, beta)) {
                reach = [reach[0].max(x.abs()), reach[1].max((beta - grid.lean(x)).abs())];
            }
        }
        let step = [1.998 / LOOKS as f64, PI / LOOKS as f64];
        grid.reach = [(reach[0] + step[0]).min(0.999), (reach[1] + step[1]).min(FRAC_PI_2 + MAX_TILT)];
        let cells = |k: usize, cell: f64| ((2.0 * grid.reach[k] / cell).ceil() as usize).clamp(2, MAX_CELLS[k]);
        let [x, y] = [cells(0, dx), cells(1, dy)];
        grid.size = [x + x % 2, y];
        grid
    }
}

/// Direction of a position on the sphere around the mirror direction: east, north and towards it.
fn light(x: f64, beta: f64) -> [f64; 3] {
    let across = (1.0 - x * x).sqrt();
    let (sin, cos) = beta.sin_cos();
    [x, across * sin, across * cos]
}
