//! Synthetic scenes, rendered for every shift without interpolation, so that the truth is exact.

use super::super::*;
use rayon::prelude::*;

/// Standard deviation of the point spread in pixels: a lens of 0.5, and the width of a pixel.
pub const SPREAD: f64 = 0.577;

/// Oblique rectangular tiles of one grating each, blurred by the point spread in closed form.
#[derive(Clone, Copy)]
pub struct Tiled {
    /// Pitch along both directions in pixels; the second is infinite for bands.
    pub pitch: [f64; 2],
    /// Number of orientations, evenly spaced over 180°.
    pub orientations: i64,
    /// Degree of linear polarization.
    pub modulation: f64,
    /// Reflectances are 1 - variation to 1.
    pub variation: f64,
    pub slant: f64,
}

pub const TILES: Tiled = Tiled { pitch: [24.0, 17.0], orientations: 12, modulation: 0.3, variation: 0.4, slant: 0.12 };
pub const BANDS: Tiled = Tiled { pitch: [40.0, 130.0], orientations: 5, modulation: 0.3, variation: 0.4, slant: 0.5 };

fn hash(mut z: u64) -> u64 {
    z = z.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

pub fn uniform(key: u64) -> f64 {
    ((hash(key) >> 11) as f64 + 0.5) / (1u64 << 53) as f64
}

pub fn normal(key: u64) -> f64 {
    let key = hash(key);
    (-2.0 * uniform(key).ln()).sqrt() * (std::f64::consts::TAU * uniform(key ^ 0xabcd_ef01)).cos()
}

/// Cumulative normal distribution (Abramowitz and Stegun 26.2.17, to 8e-8).
fn phi(x: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.231_641_9 * x.abs());
    let p = t * (0.319_381_53 + t * (-0.356_563_782 + t * (1.781_477_937 + t * (-1.821_255_978 + t * 1.330_274_429))));
    let tail = p * (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt();
    if x > 0.0 { 1.0 - tail } else { tail }
}

impl Tiled {
    fn orientation_of(&self, i: i64, j: i64) -> f64 {
        let n = self.orientations;
        std::f64::consts::PI * ((2 * i + 5 * j + (hash((i * 7919 + j) as u64) % 3) as i64).rem_euclid(n)) as f64
            / n as f64
    }

    fn reflectance_of(&self, i: i64, j: i64) -> f64 {
        1.0 - self.variation * uniform((i * 104_729 + j * 13 + 5) as u64)
    }

    /// Indices along an axis, with the fraction of the point spread in each.
    fn shares(u: f64, pitch: f64) -> [(i64, f64); 3] {
        if pitch.is_infinite() {
            return [(0, 1.0), (0, 0.0), (0, 0.0)];
        }
        let i = (u / pitch).floor();
        let (low, high) = (phi((i * pitch - u) / SPREAD), phi(((i + 1.0) * pitch - u) / SPREAD));
        [(i as i64, high - low), (i as i64 - 1, low), (i as i64 + 1, 1.0 - high)]
    }

    /// (A, C, S) at a point.
    pub fn at(&self, x: f64, y: f64) -> [f64; 3] {
        let (sin, cos) = self.slant.sin_cos();
        let (u, v) = (x * cos + y * sin, y * cos - x * sin);
        let mut sum = [0.0; 3];
        for (i, a) in Self::shares(u, self.pitch[0]) {
            for (j, b) in Self::shares(v, self.pitch[1]) {
                let light = 0.5 * a * b * self.reflectance_of(i, j);
                let (s2, c2) = (2.0 * self.orientation_of(i, j)).sin_cos();
                sum[0] += light;
                sum[1] += light * self.modulation * c2;
                sum[2] += light * self.modulation * s2;
            }
        }
        sum
    }

    /// Photograph shifted by (dx, dy) behind an analyser at `psi`: 40,000 e⁻ at 1 and 8 e⁻ read noise, times `noise`.
    pub fn frame(&self, size: [usize; 2], psi: f64, [dx, dy]: [f64; 2], noise: f64, seed: u64) -> Vec<f32> {
        let (s2, c2) = (2.0 * psi).sin_cos();
        let pixel = |i: usize| {
            let [a, c, s] = self.at((i % size[0]) as f64 - dx, (i / size[0]) as f64 - dy);
            let light = a + c * c2 + s * s2;
            let deviation = noise * (light / 40_000.0 + (8.0f64 / 40_000.0).powi(2)).sqrt();
            (light + deviation * normal(seed << 32 | i as u64)) as f32
        };
        (0..size[0] * size[1]).into_par_iter().map(pixel).collect()
    }
}

pub fn angles(n: usize) -> Vec<f64> {
    (0..n).map(|k| std::f64::consts::PI * k as f64 / n as f64).collect()
}

/// Shifts due to a wedge.
pub fn wedge(angles: &[f64], px: f64) -> Vec<[f64; 2]> {
    angles.iter().map(|psi| [px * (psi + 0.3).cos(), -px * (psi + 0.3).sin()]).collect()
}

pub fn rows(plane: Vec<f32>, width: usize) -> impl Fn(usize, usize, &mut [f32], &mut [u8]) + Sync {
    move |y, left, values: &mut [f32], _: &mut [u8]| {
        values.copy_from_slice(&plane[y * width + left..][..values.len()]);
    }
}

/// Root mean square error of the shifts about their mean, and the largest σ.
pub fn errors(found: &[Shift], truth: &[[f64; 2]]) -> (f64, f64) {
    let n = truth.len() as f64;
    let mean = [0, 1].map(|i| truth.iter().map(|t| t[i]).sum::<f64>() / n);
    let square = |(f, t): (&Shift, &[f64; 2])| (f.dx - t[0] + mean[0]).powi(2) + (f.dy - t[1] + mean[1]).powi(2);
    let rms = (found.iter().zip(truth).map(square).sum::<f64>() / (2.0 * n)).sqrt();
    (rms, found.iter().map(|f| f.sigma).fold(0.0, f64::max))
}

/// Registrar with frames of a scene under these shifts, one seed each.
pub fn registrar(scene: &Tiled, size: [usize; 2], psi: &[f64], shifts: &[[f64; 2]], noise: f64) -> Registrar {
    let mut registrar = Registrar::new(size[0], size[1]);
    for (k, (psi, shift)) in psi.iter().zip(shifts).enumerate() {
        registrar.add(rows(scene.frame(size, *psi, *shift, noise, k as u64), size[0]));
    }
    registrar
}
