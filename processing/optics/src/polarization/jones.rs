//! Jones calculus: fully polarized light as two complex amplitudes (x, y) in the plane of the sample, as seen by the
//! camera.

use super::Stokes;
use num_complex::Complex;

/// Complex amplitudes of the electric field along x and y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JonesVector(pub [Complex<f64>; 2]);

/// Jones matrix of a linear optical element: `E_out = M · E_in`, row-major.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jones(pub [[Complex<f64>; 2]; 2]);

const ZERO: Complex<f64> = Complex::new(0.0, 0.0);

impl JonesVector {
    /// Linearly polarized light of unit intensity at `angle` (rad, anticlockwise from x).
    pub fn linear(angle: f64) -> Self {
        Self([Complex::from(angle.cos()), Complex::from(angle.sin())])
    }

    /// Circularly polarized light of the ideal source, `e = (1, -i)`, intensity 2 (2018 paper, Eq. 4).
    pub fn circular() -> Self {
        Self([Complex::from(1.0), Complex::new(0.0, -1.0)])
    }

    /// Coherent sum of two fields.
    pub fn plus(self, other: Self) -> Self {
        Self([self.0[0] + other.0[0], self.0[1] + other.0[1]])
    }

    /// Field multiplied by a complex amplitude.
    pub fn scaled(self, factor: Complex<f64>) -> Self {
        Self(self.0.map(|e| e * factor))
    }

    /// Stokes parameters: `S1 = |Ex|² - |Ey|²`, `S2 = 2 Re(Ex Ey*)`, `S3 = -2 Im(Ex Ey*)`.
    pub fn stokes(self) -> Stokes {
        let [x, y] = self.0;
        let cross = x * y.conj();
        Stokes {
            s0: x.norm_sqr() + y.norm_sqr(),
            s1: x.norm_sqr() - y.norm_sqr(),
            s2: 2.0 * cross.re,
            s3: -2.0 * cross.im,
        }
    }
}

impl Jones {
    /// Diagonal matrix: independent factors for x and y.
    pub fn diagonal(x: Complex<f64>, y: Complex<f64>) -> Self {
        Self([[x, ZERO], [ZERO, y]])
    }

    /// Rotation of the frame: components along axes rotated by `angle` (rad, anticlockwise).
    pub fn rotation(angle: f64) -> Self {
        let (s, c) = angle.sin_cos();
        Self([[c.into(), s.into()], [(-s).into(), c.into()]])
    }

    /// Element rotated by `angle` (rad): `R(-angle) · M · R(angle)`.
    pub fn turned(self, angle: f64) -> Self {
        Self::rotation(-angle).after(self).after(Self::rotation(angle))
    }

    /// Linear retarder with its axis at `axis` that delays the perpendicular component by `retardance` (both rad).
    ///
    /// This is `diag(1, e^{iΔ})` of the 2018 paper's Eq. 6.
    pub fn retarder(axis: f64, retardance: f64) -> Self {
        Self::diagonal(1.0.into(), Complex::from_polar(1.0, retardance)).turned(axis)
    }

    /// Ideal linear polarizer with its transmission axis at `axis` (rad).
    pub fn polarizer(axis: f64) -> Self {
        Self::diagonal(1.0.into(), ZERO).turned(axis)
    }

    /// Grating with its grating vector along `orientation` (rad): `diag(-1, R)` in its principal frame (2018 paper, Eq.
    /// 6).
    pub fn grating(orientation: f64, ratio: Complex<f64>) -> Self {
        Self::diagonal((-1.0).into(), ratio).turned(orientation)
    }

    /// Product `self · first`: light passes `first`, then `self`.
    pub fn after(self, first: Self) -> Self {
        let (a, b) = (self.0, first.0);
        Self(std::array::from_fn(|i| std::array::from_fn(|j| a[i][0] * b[0][j] + a[i][1] * b[1][j])))
    }

    /// Field behind the element.
    pub fn apply(self, field: JonesVector) -> JonesVector {
        JonesVector(self.0.map(|row| row[0] * field.0[0] + row[1] * field.0[1]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

    #[test]
    fn quarter_wave_at_45_degrees_makes_linear_light_circular() {
        let s = Jones::retarder(FRAC_PI_4, FRAC_PI_2).apply(JonesVector::linear(0.0)).stokes();
        assert!(s.s1.abs() < 1e-15 && s.s2.abs() < 1e-15 && (s.s3.abs() - 1.0).abs() < 1e-15, "{s:?}");
    }

    #[test]
    fn polarizer_obeys_malus() {
        for k in 0..36 {
            let psi = f64::from(k) * 0.1;
            let through = Jones::polarizer(psi).apply(JonesVector::linear(0.3)).stokes();
            assert!((through.s0 - (psi - 0.3).cos().powi(2)).abs() < 1e-14);
        }
    }

    /// The paper's closed form (Eq. 9): no film, grating orientation 0, light e = (1, -i).
    #[test]
    fn grating_without_film_gives_equation_9() {
        for (r, zeta) in [(1.1, 0.8), (0.3, 2.0), (40.0, -1.0)] {
            let behind = Jones::grating(0.0, Complex::from_polar(r, zeta)).apply(JonesVector::circular());
            for k in 0..20 {
                let psi = f64::from(k) * 0.17;
                let wanted = 1.0 + (r * r - 1.0) * (1.0 - (2.0 * psi).cos()) / 2.0 - r * zeta.sin() * (2.0 * psi).sin();
                let got = behind.stokes().through_analyser(psi);
                assert!((got - wanted).abs() < 1e-12 * wanted.max(1.0), "r {r} zeta {zeta} psi {psi}: {got} {wanted}");
            }
        }
    }
}
