//! Samples whose period varies as well.

use super::{Ideal, Pattern};
use crate::random::{hash, key, uniform};
use std::f64::consts::PI;

/// A currency emblem: an oval medallion on paper; at its top near-horizontal bands of different orientations, a rosette
/// in the middle, fine concentric rings of longer periods around it (2018 paper, Fig. 19).
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
        let petal = 0.36 + 0.1 * (8.0 * azimuth).cos();
        if r < petal {
            return Ideal::Grating(4.0 * azimuth + 2.0 * r, 1.0);
        }
        // Rings 0.25 mm apart on a 20 mm emblem, every other one with a longer period.
        if r < 0.66 {
            let ring = (r / 0.025).floor();
            let period = if ring % 2.0 == 0.0 { 2.0 } else { 1.4 };
            return Ideal::Grating(azimuth, period);
        }
        if v > 0.25 {
            // The bands lean a little, so that their edges cross pixel rows.
            let band = ((v + 0.06 * u) / 0.085).floor();
            return Ideal::Grating(band * 0.37 * PI, 1.0);
        }
        Ideal::Grating(0.5 * PI + 0.5 * azimuth, 1.0)
    }
}

/// Random squares. Orientation is uniform and the period grows with it from 0.8 to 1.6 of the sample's, so that a flash
/// makes a spiral (2018 paper, section 4.5 and Fig. 7b).
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
