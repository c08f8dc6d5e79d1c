//! Samples of discs.

use super::{Ideal, Pattern};
use crate::random::{key, uniform};

/// Ten sectors around the centre, in each of which the orientation rotates by 180°, and four smaller such centres at
/// the corners (2018 paper, Fig. 12 and 16).
pub(super) struct Kinematic {
    pub(super) half: f64,
}

impl Pattern for Kinematic {
    fn at(&self, x: f64, y: f64) -> Ideal {
        let inner = 0.82 * self.half;
        let (cx, cy) = if x.hypot(y) < inner { (0.0, 0.0) } else { (self.half.copysign(x), self.half.copysign(y)) };
        // Orientations have a period of 180°, so five of their turns make ten sectors.
        Ideal::Grating(5.0 * (y - cy).atan2(x - cx), 1.0)
    }
}

/// Overlapping circles of several sizes with concentric or constant orientations (2018 paper, Fig. 17).
pub(super) struct Circles {
    /// Centre, radius, orientation, concentric; the topmost first.
    circles: Vec<([f64; 2], f64, f64, bool)>,
}

impl Circles {
    pub(super) fn new(half: f64, seed: u64) -> Self {
        let random = |k: u64, i: u64| uniform(key(&[seed, 0xc1, k, i]));
        let circles = (0..70)
            .map(|i| {
                let center = [half * (2.2 * random(0, i) - 1.1), half * (2.2 * random(1, i) - 1.1)];
                // Small circles are on top, so that none is hidden.
                let radius = half * (0.06 + 0.36 * (i as f64 / 69.0).powf(1.5));
                (center, radius, std::f64::consts::PI * random(2, i), random(3, i) < 0.5)
            })
            .collect();
        Self { circles }
    }
}

impl Pattern for Circles {
    fn at(&self, x: f64, y: f64) -> Ideal {
        for ([cx, cy], radius, orientation, concentric) in &self.circles {
            let (dx, dy) = (x - cx, y - cy);
            if dx * dx + dy * dy < radius * radius {
                let turn = if *concentric { dy.atan2(dx) } else { 0.0 };
                return Ideal::Grating(orientation + turn, 1.0);
            }
        }
        Ideal::Grating(0.25 * std::f64::consts::PI, 1.0)
    }
}

/// A compact disc scaled to its diameter: its tracks are tangential, so it diffracts radially.
pub(super) struct Cd {
    pub(super) half: f64,
}

impl Pattern for Cd {
    fn at(&self, x: f64, y: f64) -> Ideal {
        // Radii of a standard disc of 120 mm, as fractions of 60 mm; the program area ends at the visible rim.
        match x.hypot(y) / self.half {
            r if !(0.125..1.0).contains(&r) => Ideal::Nothing,
            r if r < 0.36 => Ideal::Diffuse,
            r if !(0.40..0.98).contains(&r) => Ideal::Mirror,
            _ => Ideal::Grating(y.atan2(x), 1.0),
        }
    }
}
