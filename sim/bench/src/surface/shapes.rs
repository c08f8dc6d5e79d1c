//! Samples of stars and strokes.

use super::{Ideal, Pattern};
use crate::random::{key, uniform};
use std::f64::consts::{PI, TAU};

/// A five-pointed star.
struct Star {
    center: [f64; 2],
    radius: f64,
    turn: f64,
}

impl Star {
    /// Polar position relative to the star when the point lies inside: (radius relative to the star's, azimuth).
    fn inside(&self, x: f64, y: f64) -> Option<(f64, f64)> {
        let (dx, dy) = (x - self.center[0], y - self.center[1]);
        if dx * dx + dy * dy > self.radius * self.radius {
            return None;
        }
        let r = dx.hypot(dy) / self.radius;
        let azimuth = dy.atan2(dx) - self.turn;
        // Within a fifth of a turn the edge runs straight from the tip (radius 1) to the notch (0.382).
        let folded = (azimuth.rem_euclid(TAU / 5.0) - PI / 5.0).abs();
        let (tip, notch) = ([(PI / 5.0).cos(), (PI / 5.0).sin()], [0.382, 0.0]);
        let (ex, ey) = (tip[0] - notch[0], tip[1] - notch[1]);
        let (px, py) = (r * folded.cos() - notch[0], r * folded.sin() - notch[1]);
        (ex * py - ey * px >= 0.0).then_some((r, azimuth))
    }
}

/// Stars of different sizes. The orientation rotates around each centre; the background has one orientation.
pub(super) struct Stars(Vec<Star>);

impl Stars {
    pub(super) fn new(half: f64, seed: u64) -> Self {
        let random = |k: u64, i: u64| uniform(key(&[seed, 0x57, k, i]));
        let mut stars: Vec<Star> = vec![];
        // In decreasing size; a star that would touch an earlier one is omitted.
        for i in 0..600 {
            let radius = half * (0.34 * (1.0 - i as f64 / 600.0).powi(2) + 0.05);
            let center = [half * (2.0 * random(0, i) - 1.0), half * (2.0 * random(1, i) - 1.0)];
            let clear = |s: &Star| (s.center[0] - center[0]).hypot(s.center[1] - center[1]) > s.radius + radius;
            if stars.iter().all(clear) {
                stars.push(Star { center, radius, turn: TAU * random(2, i) });
            }
        }
        Self(stars)
    }
}

impl Pattern for Stars {
    fn at(&self, x: f64, y: f64) -> Ideal {
        let hit = self.0.iter().find_map(|s| Some((s.inside(x, y)?, s.turn)));
        match hit {
            Some(((r, azimuth), turn)) => Ideal::Grating(azimuth + turn + 0.8 * r, 1.0),
            None => Ideal::Grating(PI / 3.0, 1.0),
        }
    }
}

/// Bursts of radial strokes, rings and small stars on a background of one orientation (2018 paper, Fig. 20).
pub(super) struct Fireworks {
    bursts: Vec<Burst>,
    stars: Vec<Star>,
}

struct Burst {
    center: [f64; 2],
    radius: f64,
    strokes: f64,
    turn: f64,
}

impl Burst {
    /// Orientation of the stroke or ring that a point lies on.
    fn at(&self, x: f64, y: f64) -> Option<f64> {
        let (dx, dy) = (x - self.center[0], y - self.center[1]);
        if dx * dx + dy * dy > self.radius * self.radius {
            return None;
        }
        let r = dx.hypot(dy) / self.radius;
        let azimuth = dy.atan2(dx);
        if (r - 0.22).abs() < 0.035 {
            return Some(azimuth);
        }
        let position = (azimuth - self.turn) * self.strokes / TAU;
        let off = (position - position.round()).abs() * TAU / self.strokes * r;
        // Strokes taper towards both ends, and every second one is shorter.
        let reach = if position.round().rem_euclid(2.0) < 1.0 { 1.0 } else { 0.75 };
        let width = 0.05 * ((r - 0.3) * (reach - r)).max(0.0).sqrt() / 0.3;
        // The orientation varies along the stroke, so that light travels outwards as the sample rotates.
        (off < width).then_some(azimuth + PI * r)
    }
}

impl Fireworks {
    pub(super) fn new(half: f64, seed: u64) -> Self {
        let random = |k: u64, i: u64| uniform(key(&[seed, 0xf1, k, i]));
        let place = |k: u64, i: u64| half * (2.0 * random(k, i) - 1.0);
        let bursts = (0..16)
            .map(|i| Burst {
                center: [place(0, i), place(1, i)],
                radius: half * (0.18 + 0.4 * random(2, i)),
                strokes: 2.0 * (6.0 + (random(3, i) * 7.0).floor()),
                turn: TAU * random(4, i),
            })
            .collect();
        let stars = (0..60)
            .map(|i| Star {
                center: [place(5, i), place(6, i)],
                radius: half * (0.02 + 0.03 * random(7, i)),
                turn: TAU * random(8, i),
            })
            .collect();
        Self { bursts, stars }
    }
}

impl Pattern for Fireworks {
    fn at(&self, x: f64, y: f64) -> Ideal {
        if let Some((r, azimuth)) = self.stars.iter().find_map(|s| s.inside(x, y)) {
            return Ideal::Grating(azimuth + r, 1.0);
        }
        let stroke = self.bursts.iter().find_map(|b| b.at(x, y));
        Ideal::Grating(stroke.unwrap_or(PI / 8.0), 1.0)
    }
}
