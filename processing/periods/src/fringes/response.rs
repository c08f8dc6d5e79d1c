//! Nonlinearity of the panel: emitted light as a function of the requested light.

use schemars::JsonSchema;
use serde::Serialize;
use std::f64::consts::TAU;

/// Power law of the panel's light. The exponent differs from 1 if the panel's gamma was not corrected exactly.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Response {
    /// Exponent.
    pub power: f64,
    /// True if measured from frames of uniform light, otherwise assumed.
    pub measured: bool,
    /// Largest deviation of uniform frames from the power law, relative to white.
    pub misfit: f64,
}

impl Default for Response {
    fn default() -> Self {
        Self { power: 1.0, measured: false, misfit: 0.0 }
    }
}

impl Response {
    /// From frames of uniform light: (phase in cycles, mean light). The requested light is (1 + cos 2π phase) / 2 of
    /// white.
    pub fn from_even(frames: &[(f64, f64)]) -> Self {
        let requested = |phase: f64| 0.5 + 0.5 * (TAU * phase).cos();
        let Some(white) = frames.iter().filter(|f| requested(f.0) > 0.999).map(|f| f.1).reduce(f64::max) else {
            return Self::default();
        };
        let levels: Vec<(f64, f64)> = frames
            .iter()
            .map(|(phase, light)| (requested(*phase), light / white))
            .filter(|(requested, light)| (0.02..0.98).contains(requested) && *light > 1e-3 && *light < 1.2)
            .collect();
        if levels.is_empty() {
            return Self::default();
        }
        // Least squares of ln light = power · ln requested; bright levels have more weight.
        let (mut above, mut below) = (0.0, 0.0);
        for (requested, light) in &levels {
            above += requested.ln() * light.ln() * light;
            below += requested.ln().powi(2) * light;
        }
        let power = above / below;
        let misfit = levels.iter().map(|(a, l)| (a.powf(power) - l).abs()).fold(0.0, f64::max);
        Self { power, measured: true, misfit }
    }

    /// Amplitude of harmonic `n` of fringes: `4 <light cos nφ>`, which is 1 for n = 1 and a linear panel.
    pub fn harmonic(&self, n: u32) -> f64 {
        const STEPS: u32 = 4096;
        let term = |i: u32| {
            let angle = TAU * (f64::from(i) + 0.5) / f64::from(STEPS);
            (0.5 + 0.5 * angle.cos()).powf(self.power) * (f64::from(n) * angle).cos()
        };
        4.0 * (0..STEPS).map(term).sum::<f64>() / f64::from(STEPS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_power_is_read_off_even_frames() {
        let frame = |phase: f64, power: f64| (phase, 0.7 * (0.5 + 0.5 * (TAU * phase).cos()).powf(power));
        for power in [0.8, 1.0, 1.15] {
            let frames: Vec<_> = [0.0, 0.25, 1.0 / 3.0].into_iter().map(|p| frame(p, power)).collect();
            let found = Response::from_even(&frames);
            assert!(found.measured && (found.power - power).abs() < 1e-9 && found.misfit < 1e-9, "{found:?}");
        }
        assert!(!Response::from_even(&[(0.25, 0.3)]).measured);
        let perfect = Response::default();
        assert!((perfect.harmonic(1) - 1.0).abs() < 1e-9 && perfect.harmonic(2).abs() < 1e-9);
        // (1 + cos φ)² / 4 = (1.5 + 2 cos φ + 0.5 cos 2φ) / 4.
        let square = Response { power: 2.0, ..perfect };
        assert!((square.harmonic(1) - 1.0).abs() < 1e-9 && (square.harmonic(2) - 0.25).abs() < 1e-9);
    }
}
