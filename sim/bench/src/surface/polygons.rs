//! Samples of polygons.

use super::{Ideal, Pattern};
use crate::random::{key, uniform};
use std::f64::consts::PI;

/// Voronoi polygons with one random seed in each cell of a grid, periodic at the sample's edge.
struct Cells {
    per_side: i64,
    side: f64,
    seed: u64,
}

impl Cells {
    /// Key of the polygon that contains a point, and its seed.
    fn find(&self, x: f64, y: f64) -> (u64, [f64; 2]) {
        let (column, row) = ((x / self.side).floor() as i64, (y / self.side).floor() as i64);
        let mut best = (f64::INFINITY, 0, [0.0; 2]);
        // From the nearest column and row outwards, so that most distant cells are skipped without hashing.
        for j in [0, -1, 1, -2, 2].map(|k| row + k) {
            for i in [0, -1, 1, -2, 2].map(|k| column + k) {
                if self.gap(i, x).powi(2) + self.gap(j, y).powi(2) >= best.0 {
                    continue;
                }
                let id =
                    key(&[self.seed, 0xce, i.rem_euclid(self.per_side) as u64, j.rem_euclid(self.per_side) as u64]);
                let middle = [i, j].map(|k| k as f64);
                let at = [0, 1].map(|a| (middle[a] + uniform(key(&[id, a as u64]))) * self.side);
                let distance = (x - at[0]).powi(2) + (y - at[1]).powi(2);
                if distance < best.0 {
                    best = (distance, id, at);
                }
            }
        }
        (best.1, best.2)
    }

    /// Distance of a coordinate from the cell of an index, along one axis, in mm.
    fn gap(&self, index: i64, value: f64) -> f64 {
        let low = index as f64 * self.side;
        (low - value).max(value - low - self.side).max(0.0)
    }
}

/// Holographic paper: polygons with one of twelve orientations each; tiles seamlessly.
pub(super) struct Paper(Cells);

impl Paper {
    pub(super) fn new(half: f64, seed: u64) -> Self {
        Self(Cells { per_side: 10, side: half / 5.0, seed })
    }
}

impl Pattern for Paper {
    fn at(&self, x: f64, y: f64) -> Ideal {
        let (id, _) = self.0.find(x, y);
        Ideal::Grating((uniform(key(&[id, 7])) * 12.0).floor() * PI / 12.0, 1.0)
    }
}

/// Independent polygons: random orientations, and relative periods uniformly distributed from 1 to 2.5.
pub(super) struct Mosaic(Cells);

impl Mosaic {
    pub(super) fn new(half: f64, seed: u64) -> Self {
        Self(Cells { per_side: 8, side: half / 4.0, seed: key(&[seed, 0x305]) })
    }
}

impl Pattern for Mosaic {
    fn at(&self, x: f64, y: f64) -> Ideal {
        let (id, _) = self.0.find(x, y);
        Ideal::Grating(PI * uniform(key(&[id, 10])), 1.0 + 1.5 * uniform(key(&[id, 11])))
    }
}

/// A round logo of polygons, each with a smooth gradient of orientations, on non-diffracting paper.
pub(super) struct Logo {
    cells: Cells,
    radius: f64,
}

impl Logo {
    pub(super) fn new(half: f64, seed: u64) -> Self {
        Self { cells: Cells { per_side: 1 << 20, side: half / 3.2, seed }, radius: half }
    }
}

impl Pattern for Logo {
    fn at(&self, x: f64, y: f64) -> Ideal {
        let r = x.hypot(y) / self.radius;
        // Two lens-shaped holes give the diffracting part inner outlines too.
        let lens = |cx: f64| (x / self.radius - cx).hypot(y / self.radius) < 0.55;
        if r > 1.0 || (lens(-0.38) != lens(0.38) && r > 0.86) {
            return Ideal::Diffuse;
        }
        if (r - 0.93).abs() < 0.07 {
            return Ideal::Grating(y.atan2(x), 1.0);
        }
        let (id, [mx, my]) = self.cells.find(x, y);
        let direction = 2.0 * PI * uniform(key(&[id, 8]));
        let along = ((x - mx) * direction.cos() + (y - my) * direction.sin()) / self.cells.side;
        Ideal::Grating(PI * uniform(key(&[id, 9])) + 0.4 * along, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn orientation(paper: &Paper, x: f64, y: f64) -> f64 {
        let Ideal::Grating(orientation, _) = paper.at(x, y) else { panic!("no grating at {x}, {y}") };
        orientation
    }

    #[test]
    fn the_paper_has_twelve_orientations_and_repeats() {
        let (half, paper) = (20.0, Paper::new(20.0, 5));
        let mut seen = std::collections::BTreeSet::new();
        for k in 0..4000_u64 {
            let [x, y] = [0, 1].map(|axis| half * (2.0 * uniform(key(&[k, axis])) - 1.0));
            let here = orientation(&paper, x, y);
            assert_eq!(here, orientation(&paper, x + 2.0 * half, y - 2.0 * half), "{x} {y}");
            seen.insert((here * 12.0 / PI).round() as i64);
        }
        assert_eq!(seen, (0..12).collect());
    }

    #[test]
    fn cells_passed_over_are_never_the_nearest() {
        let cells = Cells { per_side: 10, side: 1.0, seed: 2 };
        for k in 0..4000_u64 {
            let [x, y] = [0, 1].map(|axis| 10.0 * uniform(key(&[k, axis])));
            let (_, [mx, my]) = cells.find(x, y);
            let found = (x - mx).hypot(y - my);
            // No seed of the neighbourhood is nearer; each is found by looking up its own position.
            for step in 0..25_u64 {
                let (dx, dy) = ((step % 5) as f64 - 2.0, (step / 5) as f64 - 2.0);
                let (_, [ox, oy]) = cells.find(x + 0.4 * dx, y + 0.4 * dy);
                assert!((x - ox).hypot(y - oy) >= found - 1e-12, "{x} {y}");
            }
        }
    }
}
