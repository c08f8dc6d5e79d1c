//! Synthetic environments with lamps, and lookup tables of test patterns.

use nacre_base::Result;
use nacre_render::environment::{Environment, Table};
use nacre_sim::random::{key, uniform};
use std::f64::consts::{FRAC_PI_2, TAU};
use std::sync::{Arc, Mutex, PoisonError};

/// Largest half-vector component of the lookup tables.
pub const EXTENT: f64 = 0.7;

/// Cache of the last scene: a study runs all settings on one scene before the next scene.
pub struct Last<T>(Mutex<Option<Kept<T>>>);

/// A cached scene with its key: scene number and seed.
struct Kept<T> {
    scene: usize,
    seed: u64,
    value: Arc<T>,
}

impl<T> Last<T> {
    pub fn new() -> Self {
        Self(Mutex::new(None))
    }

    /// Returns the scene of this number and seed; calls `make` only when it is not cached.
    pub fn get(&self, scene: usize, seed: u64, make: impl FnOnce() -> Result<T>) -> Result<Arc<T>> {
        let mut last = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(kept) = last.as_ref().filter(|kept| (kept.scene, kept.seed) == (scene, seed)) {
            return Ok(kept.value.clone());
        }
        let value = Arc::new(make()?);
        *last = Some(Kept { scene, seed, value: value.clone() });
        Ok(value)
    }
}

/// An environment of sky, floor and twelve Gaussian lamps of standard deviation `lamp_deg` degrees. The lamps together
/// emit as much light as the rest.
pub fn room(width: usize, lamp_deg: f64, seed: u64) -> Result<Environment> {
    let height = width / 2;
    let blank = Environment::of(width, height, vec![[0.0; 3]; width * height])?;
    let random = |k: usize| uniform(key(&[seed, k as u64]));
    let lamps: Vec<[f64; 3]> = (0..12)
        .map(|k| {
            let (z, azimuth) = (1.8 * random(2 * k) - 0.9, TAU * random(2 * k + 1));
            let across = (1.0_f64 - z * z).sqrt();
            [across * azimuth.cos(), across * azimuth.sin(), z]
        })
        .collect();
    let spread = lamp_deg.to_radians().powi(2);
    let peak = 4.0 / 12.0 * 0.4 / (2.0 * spread);
    let pixel = |i: usize| {
        let d = blank.direction((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        let mut sum = if d[2] > 0.0 { [0.4, 0.5, 0.7] } else { [0.25, 0.2, 0.15] };
        for (k, l) in lamps.iter().enumerate() {
            let off = 2.0 * (1.0 - (d[0] * l[0] + d[1] * l[1] + d[2] * l[2]));
            let bright = peak * (-0.5 * off / spread).exp();
            (0..3).for_each(|c| sum[c] += bright * (0.6 + 0.8 * random(100 + 3 * k + c)));
        }
        sum.map(|v| v as f32)
    };
    Environment::of(width, height, (0..width * height).map(pixel).collect())
}

/// Pattern of a lookup table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pattern {
    /// Spots on a lattice of two directions, degrees.
    Spots([f64; 2]),
    /// Streaks along directions, degrees.
    Streaks(&'static [f64]),
    /// Concentric rings.
    Rings,
}

impl Pattern {
    /// Directions of the pattern in radians, to be aligned with the meridian; 0 and 90° for a pattern without distinct
    /// directions.
    pub fn directions(self) -> [f64; 2] {
        match self {
            Self::Spots(pair) => pair.map(f64::to_radians),
            Self::Streaks([a, b]) => [a.to_radians(), b.to_radians()],
            Self::Streaks(_) | Self::Rings => [0.0, FRAC_PI_2],
        }
    }

    /// The lookup table of the pattern; `width` is the standard deviation of spots, streaks and rings in half-vector
    /// units.
    pub fn table(self, size: usize, width: f64) -> Result<Table> {
        Table::from_fn(size, EXTENT, |h| {
            // Diffraction angles grow with the wavelength: red lies further from the zero order than blue.
            [1.15, 1.0, 0.85].map(|stretch| self.at(h.map(|v| v / stretch), width))
        })
    }

    fn at(self, h: [f64; 2], width: f64) -> f64 {
        let bell = |off: f64| (-0.5 * (off / width).powi(2)).exp();
        let radius = h[0].hypot(h[1]);
        match self {
            Self::Spots(pair) => {
                let [[a, b], [c, d]] = pair.map(|v| [v.to_radians().cos(), v.to_radians().sin()]);
                let whole = a * d - b * c;
                // Lattice coordinates of the nearest spot. Spots beyond the neighbours contribute nothing.
                let place = [(h[0] * d - h[1] * c) / whole / 0.15, (h[1] * a - h[0] * b) / whole / 0.15];
                let mut sum = 0.0;
                for i in -1..=1 {
                    for j in -1..=1 {
                        let [m, n] = [place[0].round() + f64::from(i), place[1].round() + f64::from(j)];
                        let [x, y] = [0.15 * (m * a + n * c), 0.15 * (m * b + n * d)];
                        sum += (-0.6 * (m.abs() + n.abs())).exp() * bell(h[0] - x) * bell(h[1] - y);
                    }
                }
                sum
            }
            Self::Streaks(angles) => {
                let line = |a: &f64| bell(h[1] * a.to_radians().cos() - h[0] * a.to_radians().sin());
                angles.iter().map(line).sum::<f64>() * (-radius / 0.25).exp()
            }
            Self::Rings => bell((radius / 0.15 - (radius / 0.15).round()) * 0.15) * (-radius / 0.25).exp(),
        }
    }
}
