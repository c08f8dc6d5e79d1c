//! Stokes parameters of fully or partially polarized light.

use std::ops::{Add, Mul};

/// Stokes parameters. x is image right, y image up; angles are anticlockwise as seen by the camera.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stokes {
    /// Total intensity.
    pub s0: f64,
    /// Intensity along x minus intensity along y.
    pub s1: f64,
    /// Intensity along +45° minus intensity along -45°.
    pub s2: f64,
    /// Circular component.
    pub s3: f64,
}

impl Stokes {
    /// Unpolarized light.
    pub fn unpolarized(intensity: f64) -> Self {
        Self { s0: intensity, ..Self::default() }
    }

    /// Intensity behind an ideal analyser at `psi` (rad): `(S0 + S1 cos 2ψ + S2 sin 2ψ) / 2`.
    pub fn through_analyser(self, psi: f64) -> f64 {
        0.5 * (self.s0 + self.s1 * (2.0 * psi).cos() + self.s2 * (2.0 * psi).sin())
    }

    /// Angle of linear polarization in `[0, π)`.
    pub fn aolp(self) -> f64 {
        (0.5 * self.s2.atan2(self.s1)).rem_euclid(std::f64::consts::PI)
    }

    /// Degree of linear polarization, 0 to 1; 0 without light.
    pub fn dolp(self) -> f64 {
        if self.s0 > 0.0 { self.s1.hypot(self.s2) / self.s0 } else { 0.0 }
    }
}

impl Add for Stokes {
    type Output = Self;
    /// Incoherent sum.
    fn add(self, o: Self) -> Self {
        Self { s0: self.s0 + o.s0, s1: self.s1 + o.s1, s2: self.s2 + o.s2, s3: self.s3 + o.s3 }
    }
}

impl Mul<f64> for Stokes {
    type Output = Self;
    fn mul(self, k: f64) -> Self {
        Self { s0: self.s0 * k, s1: self.s1 * k, s2: self.s2 * k, s3: self.s3 * k }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn aolp_and_dolp_of_known_light() {
        let s = Stokes { s0: 2.0, s1: 0.0, s2: 1.0, s3: 0.0 };
        assert!((s.aolp().to_degrees() - 45.0).abs() < 1e-12 && (s.dolp() - 0.5).abs() < 1e-12);
        assert_eq!(Stokes::default().dolp(), 0.0);
    }
}
