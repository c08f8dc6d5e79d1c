//! Samples with varying period.

use super::{Ideal, Pattern};
use crate::random::{hash, key, uniform};
use std::f64::consts::PI;

/// The same surface everywhere.
pub(super) struct Uniform(pub(super) Ideal);

impl Pattern for Uniform {
    fn at(&self, _: f64, _: f64) -> Ideal {
        self.0
    }
}

/// A reference polarizer: a round one in a black mount, which leaves a margin of a twentieth of the sample.
pub(super) struct Polarizer {
    pub(super) half: f64,
}

impl Pattern for Polarizer {
    fn at(&self, x: f64, y: f64) -> Ideal {
        if x.hypot(y) < 0.9 * self.half { Ideal::Bare { polarized: true } } else { Ideal::Nothing }
    }
}

/// A currency emblem: an oval medallion on paper (2018 paper, Fig. 19). It has near-horizontal bands of different
/// orientations at the top, a crown in the middle, and fine concentric rings of longer periods.
pub(super) struct Emblem {
    pub(super) half: f64,
}

impl Pattern for Emblem {
    fn at(&self, x: f64, y: f64) -> Ideal {
        let (u, v) = (x / self.half, y / self.half);
        if (u / 0.8).hypot(v) > 1.0 {
            return Ideal::Diffuse;
        }
        let (r, azimuth) = (u.hypot(v + 0.2), (v + 0.2).atan2(u));
        if let Some(orientation) = crown(u, v + 0.2) {
            return Ideal::Grating(orientation, 1.0);
        }
        // Rings 0.25 mm apart on a 20 mm emblem, every other one with a longer period.
        if r < 0.66 {
            let ring = (r / 0.025).floor();
            let period = if ring % 2.0 == 0.0 { 2.0 } else { 1.4 };
            return Ideal::Grating(azimuth, period);
        }
        if v > 0.25 {
            // The bands are slightly inclined, so that their edges cross pixel rows.
            let band = ((v + 0.06 * u) / 0.085).floor();
            return Ideal::Grating(band * 0.37 * PI, 1.0);
        }
        Ideal::Grating(0.5 * PI + 0.5 * azimuth, 1.0)
    }
}

/// Orientation inside a crown around the origin, about 0.8 wide: a band with jewels, and five points with balls.
fn crown(u: f64, v: f64) -> Option<f64> {
    // The crown widens upwards, so the scale of `across`, from -1 to 1, depends on the height.
    let across = u / (0.3 + 0.22 * (v + 0.26));
    if !(-1.2..=1.2).contains(&across) || !(-0.26..=0.4).contains(&v) {
        return None;
    }
    let tip = (2.0 * across).round().clamp(-2.0, 2.0) / 2.0;
    let height = 0.27 - 0.07 * tip * tip;
    if ((across - tip) * 0.4).hypot(v - height) < 0.045 {
        return Some(0.15 * PI);
    }
    if across.abs() > 1.0 {
        return None;
    }
    if v < -0.13 {
        let jewel = ((2.0 * across - (2.0 * across).round()) * 0.15).hypot(v + 0.195) < 0.04;
        return Some(if jewel { 0.85 * PI } else { 0.6 * PI });
    }
    // Green of the colour wheel, with a slight gradient.
    (v < height - 1.1 * (across - tip).abs()).then_some((0.33 + 0.1 * v) * PI)
}

/// Random squares with uniform orientation. The relative period grows with the orientation from 0.8 to 1.6, so that a
/// flash makes a spiral (2018 paper, section 4.5 and Fig. 7b).
pub(super) struct Stochastic {
    pub(super) square: f64,
    pub(super) seed: u64,
}

impl Pattern for Stochastic {
    fn at(&self, x: f64, y: f64) -> Ideal {
        let cell = |v: f64| (v / self.square).floor() as i64 as u64;
        let id = key(&[self.seed, 0x50, cell(x), cell(y)]);
        let turn = uniform(id);
        let jitter = 0.02 * (2.0 * uniform(hash(id)) - 1.0);
        Ideal::Grating(PI * turn, (0.8 + 0.8 * turn) * (1.0 + jitter))
    }
}
