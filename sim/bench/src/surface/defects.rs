//! Defects of real samples: uneven reflectance, dead and mixed dots, bumps, scratches.

use super::{Point, SampleConfig, SampleKind, Surface};
use crate::random::{hash, key, normals, uniform};

/// Largest reflectance.
const TOP: f64 = 0.95;

/// Reflectance of paper and of scratches, which also scatter light away from the camera.
const PAPER: f32 = 0.8;
const SCRATCH: f32 = 0.15;

/// Wavelength scale of bumps in mm, and number of plane waves.
const BUMP_MM: f64 = 2.0;
const WAVES: usize = 24;

/// Defects of one sample.
pub(super) struct Defects {
    seed: u64,
    dead: f64,
    mixed: f64,
    variation: f64,
    /// Phases of the reflectance variation along x and y.
    phases: [f64; 2],
    waves: Vec<Wave>,
    scratches: Vec<Scratch>,
    size: f64,
}

/// A plane wave of the surface's height: wave vector (rad/mm), phase, slope amplitude.
struct Wave {
    k: [f64; 2],
    phase: f64,
    slope: f64,
}

/// A straight scratch: a point on it, its unit normal, half width in mm.
struct Scratch {
    point: [f64; 2],
    normal: [f64; 2],
    half_width: f64,
}

impl Defects {
    pub(super) fn new(config: &SampleConfig, seed: u64) -> Self {
        let random = |kind: u64, i: u64| uniform(key(&[seed, kind, i]));
        let angle = |kind: u64, i: u64| std::f64::consts::TAU * random(kind, i);
        // A sum of many waves in random directions is a Gaussian surface; along x each adds slope²/4 to the variance.
        let slope = config.bumps_deg.to_radians().tan() * (4.0 / WAVES as f64).sqrt();
        let count = if config.bumps_deg > 0.0 { WAVES as u64 } else { 0 };
        let waves = (0..count)
            .map(|i| {
                let length = BUMP_MM * (0.6 + 0.8 * random(1, i));
                let k = std::f64::consts::TAU / length;
                // Uniformly spaced directions, so that slopes along x and y are equal even with few waves.
                let direction = std::f64::consts::PI * (i as f64 + random(2, i)) / WAVES as f64;
                Wave { k: [k * direction.cos(), k * direction.sin()], phase: angle(3, i), slope }
            })
            .collect();
        let size = config.size_mm();
        let scratches = (0..u64::from(config.scratches))
            .map(|i| {
                let (sin, cos) = angle(4, i).sin_cos();
                let at = |k| size * (random(k, i) - 0.5);
                Scratch { point: [at(5), at(6)], normal: [cos, sin], half_width: 0.01 + 0.02 * random(7, i) }
            })
            .collect();
        let uniform = SampleKind::REFERENCES.contains(&config.kind);
        let variation = if uniform { 0.0 } else { config.reflectance_variation };
        let phases = normals(key(&[seed, 9]));
        Self { seed, dead: config.dead_dots, mixed: config.mixed_dots, variation, phases, waves, scratches, size }
    }

    /// Surface of a dot. `grating(turn)` returns its grating, rotated by a random angle if the dot is mixed.
    pub(super) fn dot(&self, column: i64, row: i64, grating: impl Fn(f64) -> Surface) -> Surface {
        if self.dead == 0.0 && self.mixed == 0.0 {
            return grating(0.0);
        }
        let bits = key(&[self.seed, 8, column as u64, row as u64]);
        let fate = uniform(bits);
        if fate < self.dead {
            Surface::Mirror
        } else if fate < self.dead + self.mixed {
            grating(std::f64::consts::PI * uniform(hash(bits)))
        } else {
            grating(0.0)
        }
    }

    /// Adds scratches, reflectance and bumps.
    pub(super) fn apply(&self, surface: Surface, x: f64, y: f64) -> Point {
        let slope = self.slope(x, y);
        if surface == Surface::Nothing {
            return Point { surface, reflectance: 0.0, slope };
        }
        let scratched = self.scratches.iter().any(|s| {
            let distance = (x - s.point[0]) * s.normal[0] + (y - s.point[1]) * s.normal[1];
            distance.abs() < s.half_width
        });
        if scratched {
            return Point { surface: Surface::Diffuse, reflectance: SCRATCH, slope };
        }
        let factor = self.reflectance(x, y);
        let reflectance = if surface == Surface::Diffuse { PAPER * factor } else { factor };
        Point { surface, reflectance, slope }
    }

    /// Smooth reflectance, between (1 - v) and (1 + v) of its mean: a product of waves as long as the sample.
    fn reflectance(&self, x: f64, y: f64) -> f32 {
        let [px, py] = self.phases;
        let k = 3.0 * std::f64::consts::PI / self.size;
        let wave = (k * x + px).sin() * (k * y + py).cos();
        (TOP * (1.0 + self.variation * wave) / (1.0 + self.variation)) as f32
    }

    fn slope(&self, x: f64, y: f64) -> [f32; 2] {
        let mut slope = [0.0; 2];
        for wave in &self.waves {
            let length = wave.k[0].hypot(wave.k[1]);
            let steep = wave.slope * (wave.k[0] * x + wave.k[1] * y + wave.phase).cos();
            slope[0] += steep * wave.k[0] / length;
            slope[1] += steep * wave.k[1] / length;
        }
        slope.map(|s| s as f32)
    }
}
