//! Synthetic photographs of gratings behind a film, computed point by point with the paper's model, for tests,
//! benchmarks and charts. The simulated bench renders more effects; here every effect is a number that can be varied.

use crate::{Design, Fit, FrameNoise, Jones, JonesVector, NoiseModel, Stokes, StokesMaps};
use nacre_base::Result;
use nacre_base::random::mix;
use num_complex::Complex;
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

/// A film on gratings of one period (2018 paper, Eq. 4-6), and the camera.
#[derive(Clone, Debug)]
pub struct Synthetic {
    /// Ratio of the grating's two polarizations, `R = r exp(iζ)`.
    pub ratio: Complex<f64>,
    /// Retardance of the film in rad (Δn of Eq. 6).
    pub retardance: f64,
    /// Azimuth of the film's axis in rad.
    pub axis: f64,
    /// Reflection at the film's front, relative to the incident light (r_p of Eq. 4).
    pub front: Complex<f64>,
    /// Excess retardance of the display's quarter-wave retarder in rad.
    pub source_error: f64,
    /// Polarization of the display's light.
    pub source: Source,
    /// Unpolarised stray light, in units of the light incident on the sample.
    pub stray: f64,
    /// Distribution of orientations.
    pub spread: Spread,
    /// Reflectance is uniformly distributed within ± this fraction.
    pub reflectance: f64,
    /// Camera noise; `None` for no noise.
    pub noise: Option<NoiseModel>,
    /// Level of the brightest point of a series: 1 is white, and higher values are clipped to white.
    pub exposure: f64,
    /// Analyser angles in rad, as given to the reconstruction.
    pub angles: Vec<f64>,
    /// Analyser-angle errors in rad; missing ones are 0.
    pub angle_errors: Vec<f64>,
}

/// Light incident on the sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Source {
    /// Circular: the display behind its retarder (2018 paper, section 5.1).
    Circular,
    /// The bare display: linear at this angle in rad.
    Linear(f64),
}

/// Distribution of orientations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Spread {
    /// Uniform over 180°.
    Even,
    /// This number of equidistant orientations, from a random start.
    Bands(usize),
    /// Uniform from 0 to this angle in rad.
    Range(f64),
}

/// Simulated photographs, and the truth.
pub struct Photographs {
    /// Linear values per frame; 1 is white.
    pub frames: Vec<Vec<f32>>,
    /// Analyser angles in rad, as given to the reconstruction.
    pub angles: Vec<f64>,
    /// The least-squares problem of these angles.
    pub design: Design,
    /// Noise per frame.
    pub noise: Vec<FrameNoise>,
    /// True orientation per pixel in rad.
    pub truth: Vec<f32>,
    /// Value from which a pixel is saturated; `None` if no pixel can be.
    pub white: Option<f32>,
    /// Mean over the pixels of the intensity's mean and amplitude over a turn of the analyser, without noise.
    pub light: (f64, f64),
}

/// Fitted photographs, and the truth.
pub struct Series {
    /// The solved fit.
    pub maps: StokesMaps,
    /// The angles.
    pub design: Design,
    /// Noise per frame.
    pub noise: Vec<FrameNoise>,
    /// True orientation per pixel in rad.
    pub truth: Vec<f32>,
}

impl Default for Synthetic {
    /// The paper's first grating without a film, twelve angles, a camera of 40,000 electrons and uniform reflectance.
    fn default() -> Self {
        Self {
            ratio: Complex::from_polar(1.1, FRAC_PI_4),
            retardance: 0.0,
            axis: 0.0,
            front: Complex::new(0.0, 0.0),
            source_error: 0.0,
            source: Source::Circular,
            stray: 0.0,
            spread: Spread::Even,
            reflectance: 0.0,
            exposure: 0.8,
            noise: Some(NoiseModel { full_scale_e: 40_000.0, read_noise_e: 8.0 }),
            angles: even_angles(12),
            angle_errors: vec![],
        }
    }
}

/// `n` equidistant angles over 180°, in rad.
pub fn even_angles(n: usize) -> Vec<f64> {
    (0..n).map(|k| PI * k as f64 / n as f64).collect()
}

impl Synthetic {
    /// Intensity of a grating of orientation `theta` (rad) behind the analyser at `psi` (rad), for light of intensity 1
    /// (2018 paper, Eq. 5).
    pub fn intensity(&self, theta: f64, psi: f64) -> f64 {
        0.5 * self.stokes(theta).through_analyser(psi)
    }

    fn field(&self, theta: f64) -> JonesVector {
        let light = match self.source {
            Source::Circular => {
                Jones::retarder(FRAC_PI_4, FRAC_PI_2 + self.source_error).apply(JonesVector::linear(0.0))
            }
            Source::Linear(angle) => JonesVector::linear(angle),
        };
        let light = light.scaled(Complex::from(2f64.sqrt()));
        let film = Jones::retarder(self.axis, self.retardance);
        let behind = film.after(Jones::grating(theta, self.ratio)).after(film).apply(light);
        behind.plus(light.scaled(self.front))
    }

    /// Stokes parameters of the light behind film and grating of orientation `theta` (rad), for light of intensity 2.
    pub fn stokes(&self, theta: f64) -> Stokes {
        self.field(theta).stokes() + Stokes::unpolarized(2.0 * self.stray)
    }

    /// Simulates photographs of `pixels` points in one row, and fits them.
    ///
    /// # Errors
    /// If the analyser's angles do not determine an orientation.
    pub fn photograph(&self, pixels: usize, seed: u64) -> Result<Series> {
        let Photographs { frames, angles, design, noise, truth, .. } = self.render(pixels, seed)?;
        let mut fit = Fit::new(pixels, 1);
        for (psi, frame) in angles.iter().zip(&frames) {
            fit.add(*psi, |_, values, _| values.copy_from_slice(frame));
        }
        Ok(Series { maps: fit.solve(&design), design, noise, truth })
    }

    /// Simulates photographs of `pixels` points.
    ///
    /// # Errors
    /// If the analyser's angles do not determine an orientation.
    pub fn render(&self, pixels: usize, seed: u64) -> Result<Photographs> {
        let design = Design::new(&self.angles)?;
        let truth = self.orientations(pixels, seed);
        let reflectance = |i| 1.0 + self.reflectance * (2.0 * random(seed, 3, i) - 1.0);
        let light: Vec<_> = truth.iter().enumerate().map(|(i, theta)| self.stokes(*theta) * reflectance(i)).collect();
        let brightest = light.iter().map(|s| 0.5 * (s.s0 + s.s1.hypot(s.s2))).fold(f64::MIN_POSITIVE, f64::max);
        let scale = self.exposure / brightest;
        let noise = self.noise.map_or(FrameNoise { shot: 0.0, floor: 1e-14 }, |n| n.frame(1.0, 1.0, 0.0));
        let frame = |(k, psi): (usize, &f64)| -> Vec<f32> {
            let true_angle = psi + self.angle_errors.get(k).unwrap_or(&0.0);
            let point = |(i, s): (usize, &Stokes)| {
                let clean = scale * s.through_analyser(true_angle);
                let sigma = if self.noise.is_some() { (noise.shot * clean + noise.floor).sqrt() } else { 0.0 };
                (clean + sigma * normal(seed ^ (k as u64 + 9) << 40, i as u64)).min(1.0) as f32
            };
            light.par_iter().enumerate().map(point).collect()
        };
        let half = 0.5 * scale / pixels.max(1) as f64;
        Ok(Photographs {
            frames: self.angles.iter().enumerate().map(frame).collect(),
            angles: self.angles.clone(),
            design,
            noise: vec![noise; self.angles.len()],
            truth: truth.iter().map(|t| *t as f32).collect(),
            white: (self.exposure >= 0.9).then_some(1.0),
            light: (
                half * light.iter().map(|s| s.s0).sum::<f64>(),
                half * light.iter().map(|s| s.s1.hypot(s.s2)).sum::<f64>(),
            ),
        })
    }

    /// True orientations in rad.
    fn orientations(&self, pixels: usize, seed: u64) -> Vec<f64> {
        let start = PI * random(seed, 1, 0);
        let point = |i| {
            let u = random(seed, 2, i);
            match self.spread {
                Spread::Even => PI * u,
                Spread::Bands(n) => (start + PI * (u * n as f64).floor() / n as f64).rem_euclid(PI),
                Spread::Range(range) => (start + range * u).rem_euclid(PI),
            }
        };
        (0..pixels).map(point).collect()
    }
}

/// The `i`-th random number of a stream, 0 to 1.
fn random(seed: u64, stream: u64, i: usize) -> f64 {
    uniform(seed ^ stream.wrapping_mul(0x9e37_79b9_7f4a_7c15), i as u64)
}

/// A pseudo-random number from 0 to 1, determined by `seed` and `i`.
pub fn uniform(seed: u64, i: u64) -> f64 {
    // SplitMix64, applied twice so that neighbouring seeds are uncorrelated.
    let mix = |z: u64| mix(z.wrapping_add(0x9e37_79b9_7f4a_7c15));
    (mix(mix(seed) ^ i) >> 11) as f64 / (1u64 << 53) as f64
}

/// A normal deviate determined by `seed` and `i` (Box and Muller).
pub fn normal(seed: u64, i: u64) -> f64 {
    let (u, v) = (uniform(seed, 2 * i).max(1e-300), uniform(seed, 2 * i + 1));
    (-2.0 * u.ln()).sqrt() * (TAU * v).cos()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare;
    use crate::orient;

    /// Without a film the sinusoid is correct within noise, which is that of the camera.
    #[test]
    fn without_a_film_the_phase_is_the_orientation() {
        let Series { mut maps, design, noise, truth } = Synthetic::default().photograph(20_000, 3).unwrap();
        let map = orient(&mut maps, &design, &noise, 0.0);
        let found = compare(&map.orientation, &map.sigma, &truth, |_| true).unwrap();
        assert!(found.pixels > 19_900 && found.mean_deg < 0.3 && found.beyond_3_sigma < 0.005, "{found:?}");
        let clean = Synthetic { noise: None, ..Synthetic::default() };
        let Series { mut maps, design, noise, truth } = clean.photograph(2000, 3).unwrap();
        let map = orient(&mut maps, &design, &noise, 0.0);
        assert!(compare(&map.orientation, &map.sigma, &truth, |_| true).unwrap().mean_deg < 2e-4);
    }

    /// Eq. 9 in closed form.
    #[test]
    fn intensities_are_equation_9() {
        let (r, zeta) = (1.3, 0.7);
        let scene = Synthetic { ratio: Complex::from_polar(r, zeta), ..Synthetic::default() };
        for k in 0..20 {
            let psi = f64::from(k) * 0.17;
            let wanted = 1.0 + (r * r - 1.0) * (1.0 - (2.0 * psi).cos()) / 2.0 - r * zeta.sin() * (2.0 * psi).sin();
            assert!((2.0 * scene.intensity(0.0, psi) - wanted).abs() < 1e-12, "{} {wanted}", scene.intensity(0.0, psi));
        }
    }
}
