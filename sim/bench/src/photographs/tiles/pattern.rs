//! Pattern of one tile: polygons, each with one direction of grooves.

use crate::random::{key, uniform};
use nacre_base::{Error, Result};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Voronoi polygons of scattered points, separated by gaps without grooves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Pattern {
    /// Number of polygons in a tile.
    pub polygons: usize,
    /// Number of directions, uniformly spaced over 180°; polygons use them in turn.
    pub directions: u32,
    /// First direction in degrees, anticlockwise from the right.
    pub first_deg: f64,
    /// Rotation of the direction from the left to the right edge of a tile in degrees, also within polygons.
    pub swirl_deg: f64,
    /// Largest random error of a polygon's direction in degrees.
    pub jitter_deg: f64,
    /// Width of the gaps in mm.
    pub gap_mm: f64,
    /// Periods of the grooves.
    pub periods: Periods,
    /// Peak-to-peak depth of the sinusoidal grooves in µm.
    pub depth_um: f64,
    /// Fraction of every polygon's area with grooves perpendicular to the others, mixed below the resolution.
    pub crossed: f64,
}

/// Periods of the polygons, in µm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Periods {
    /// One period for all polygons.
    Uniform(f64),
    /// Polygons use these periods in turn.
    Mixed(Vec<f64>),
    /// Linear from the left to the right edge of a tile.
    Graded([f64; 2]),
}

impl Default for Pattern {
    /// Pattern of the 2018 paper's simulated test (section 7.1): 600 lines per mm.
    fn default() -> Self {
        Self {
            polygons: 24,
            directions: 8,
            first_deg: 7.0,
            swirl_deg: 0.0,
            jitter_deg: 0.0,
            gap_mm: 0.3,
            periods: Periods::Uniform(1.66),
            depth_um: 0.1,
            crossed: 0.0,
        }
    }
}

/// Grooves at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grooves {
    /// Index of the polygon.
    pub polygon: usize,
    /// Direction of the grating vector in rad, `[0, π)`, anticlockwise from the right.
    pub orientation: f64,
    /// Period in µm.
    pub period_um: f64,
    /// Distance to the polygon's edge, in mm.
    pub edge_mm: f64,
}

/// The polygons of a tile.
pub(super) struct Tile {
    middles: Vec<[f64; 2]>,
    size_mm: [f64; 2],
    pattern: Pattern,
    seed: u64,
}

impl Pattern {
    /// Checks all numbers.
    pub(super) fn check(&self) -> Result<()> {
        let bad = |name: &str, expected: &str| Err(Error::input(name, "is out of range", expected));
        if !(1..=400).contains(&self.polygons) || !(1..=360).contains(&self.directions) {
            return bad("pattern.polygons, pattern.directions", "give 1 to 400 polygons and 1 to 360 directions");
        }
        let periods = self.periods.all();
        if !(1..=100).contains(&periods.len()) || periods.iter().any(|p| !(0.2..=100.0).contains(p)) {
            return bad("pattern.periods", "give 0.2 to 100 µm, at most 100 of them");
        }
        if !(0.0..=10.0).contains(&self.depth_um) || !(0.0..=1.0).contains(&self.crossed) {
            return bad("pattern.depth_um, pattern.crossed", "give a depth of 0 to 10 µm and a share of 0 to 1");
        }
        let angles = [self.first_deg, self.swirl_deg, self.jitter_deg];
        if !(0.0..=100.0).contains(&self.gap_mm) || !angles.iter().all(|a| (-360.0..=360.0).contains(a)) {
            let expected = "give 0 to 100 mm and -360 to 360°";
            return bad("pattern.gap_mm, pattern.first_deg, pattern.swirl_deg, pattern.jitter_deg", expected);
        }
        Ok(())
    }

    /// Longest period, which has the most orders.
    pub(super) fn longest_um(&self) -> f64 {
        self.periods.all().iter().copied().fold(0.0, f64::max)
    }

    /// Shortest period, whose orders are dispersed most by the band.
    pub(super) fn shortest_um(&self) -> f64 {
        self.periods.all().iter().copied().fold(f64::MAX, f64::min)
    }
}

impl Periods {
    fn all(&self) -> &[f64] {
        match self {
            Self::Uniform(one) => std::slice::from_ref(one),
            Self::Mixed(all) => all,
            Self::Graded(two) => two,
        }
    }
}

impl Tile {
    /// Polygons around the points of a jittered grid, so that none is tiny.
    pub(super) fn new(pattern: &Pattern, size_mm: [f64; 2], seed: u64) -> Self {
        let across = ((pattern.polygons as f64 * size_mm[0] / size_mm[1]).sqrt().round() as usize).max(1);
        let down = pattern.polygons.div_ceil(across);
        let middle = |k: usize| {
            let jitter = |axis: u64| 0.7 * (uniform(key(&[seed, 77, k as u64, axis])) - 0.5);
            let cell = [k % across, k / across].map(|c| c as f64 + 0.5);
            [(cell[0] + jitter(0)) * size_mm[0] / across as f64, (cell[1] + jitter(1)) * size_mm[1] / down as f64]
        };
        Self { middles: (0..pattern.polygons).map(middle).collect(), size_mm, pattern: pattern.clone(), seed }
    }

    /// Grooves at a point in mm from the tile's left and top edge; `None` in gaps and outside.
    pub(super) fn at(&self, place: [f64; 2]) -> Option<Grooves> {
        if (0..2).any(|k| !(0.0..self.size_mm[k]).contains(&place[k])) {
            return None;
        }
        let square = |m: &[f64; 2]| (m[0] - place[0]).powi(2) + (m[1] - place[1]).powi(2);
        let nearest = |not: Option<usize>| {
            let all = self.middles.iter().enumerate().filter(|(k, _)| Some(*k) != not);
            all.map(|(k, m)| (k, square(m))).min_by(|a, b| a.1.total_cmp(&b.1))
        };
        let (polygon, own) = nearest(None)?;
        let border = (0..2).map(|k| place[k].min(self.size_mm[k] - place[k])).fold(f64::MAX, f64::min);
        // The edge lies half-way to the next centre.
        let between = |k: usize, m: &[f64; 2]| {
            let [dx, dy] = [0, 1].map(|axis| m[axis] - self.middles[polygon][axis]);
            let apart = dx.hypot(dy);
            if k == polygon || apart == 0.0 { f64::MAX } else { 0.5 * (square(m) - own) / apart }
        };
        let inner = self.middles.iter().enumerate().map(|(k, m)| between(k, m)).fold(border, f64::min);
        let edge_mm = inner - 0.5 * self.pattern.gap_mm;
        let step = PI / f64::from(self.pattern.directions);
        // In turn, with a step such that neighbours in a row do not differ by one.
        let turn = (polygon * 5 + polygon / 8) as f64;
        let period_um = match &self.pattern.periods {
            Periods::Uniform(one) => *one,
            Periods::Mixed(all) => all[polygon % all.len()],
            Periods::Graded([from, to]) => from + (to - from) * place[0] / self.size_mm[0],
        };
        let jitter = self.pattern.jitter_deg * (2.0 * uniform(key(&[self.seed, 78, polygon as u64])) - 1.0);
        let swirl = self.pattern.swirl_deg * (place[0] / self.size_mm[0] - 0.5);
        let orientation = ((self.pattern.first_deg + jitter + swirl).to_radians() + turn * step).rem_euclid(PI);
        (edge_mm > 0.0).then_some(Grooves { polygon, orientation, period_um, edge_mm })
    }
}
