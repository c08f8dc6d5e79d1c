//! Rigorous diffraction by gratings: Maxwell's equations without the scalar or thin-grating assumption.
//!
//! The surface is `h(x) = d/2 · cos(2πx/Λ)` with the peak-to-peak depth d. Below is metal or a dielectric, above is air
//! or film. Light comes from above in the plane perpendicular to the grooves (no conical incidence). Two independent
//! methods share one set of types:
//!
//! - [`slices()`]: rigorous coupled-wave analysis of a staircase. In each slice, the Fourier series of the permittivity
//!   couples plane waves, with Li's factorisation rules for TM (Li 1996). A recursion of the admittance joins the
//!   slices. It contains decaying exponentials only, so it is stable at any depth. In TM, staircases in metal converge
//!   slowly.
//! - [`coordinates()`]: the coordinate-transformation (Chandezon) method. It has no stairs and converges exponentially
//!   for smooth profiles.
//!
//! [`solve`] uses the cheapest setting whose predicted error meets the requested one. [`conductor()`] solves any smooth
//! cross-section of a perfect conductor, as a reference for scalar theory.
//!
//! Conventions: fields vary as `exp(-iωt)`, so absorbing media have a positive imaginary index and a delay is a
//! positive phase. Amplitudes refer to the mean plane of the surface.
//!
//! ```
//! use nacre_optics::rcwa::{ALUMINIUM, Grating, Light, Polarization, solve};
//!
//! let foil = Grating { period_um: 1.0, depth_um: 0.1, above: 1.0, below: ALUMINIUM };
//! let light = Light { wavelength_nm: 560.0, angle: 0.0 };
//! let specular = solve(&foil, &light, Polarization::Te, 1e-4)?.reflected(0);
//! assert!((specular.efficiency - 0.513).abs() < 0.003);
//! # Ok::<(), nacre_base::Error>(())
//! ```

mod adaptive;
mod conductor;
mod coordinates;
mod eigen;
mod ratio;
mod slices;
#[cfg(test)]
mod tests;

use nacre_base::{Error, Result};
use num_complex::Complex;
use std::f64::consts::{FRAC_PI_2, TAU};

pub use adaptive::{Method, Solution, solve};
pub use conductor::conductor;
pub use coordinates::coordinates;
pub use ratio::{RatioTable, contrast, phase_offset, ratio};
pub use slices::slices;

/// Refractive index of evaporated aluminium near 560 nm (2018 paper, below Fig. 14), for `exp(-iωt)`.
pub const ALUMINIUM: Complex<f64> = Complex::new(1.0003, 6.5044);

const I: Complex<f64> = Complex::new(0.0, 1.0);
const ONE: Complex<f64> = Complex::new(1.0, 0.0);
const ZERO: Complex<f64> = Complex::new(0.0, 0.0);

/// Sinusoidal grating between two media.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grating {
    /// Period in µm.
    pub period_um: f64,
    /// Peak-to-peak depth in µm.
    pub depth_um: f64,
    /// Refractive index above the surface, on the side of the incident light.
    pub above: f64,
    /// Complex refractive index below; its imaginary part is not negative.
    pub below: Complex<f64>,
}

/// Incident plane wave, perpendicular to the grooves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Vacuum wavelength in nm.
    pub wavelength_nm: f64,
    /// Angle of incidence in the upper medium, in rad.
    pub angle: f64,
}

/// Polarization: the field along the grooves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Polarization {
    /// TE (s): the electric field is along the grooves.
    Te,
    /// TM (p): the magnetic field is along the grooves.
    Tm,
}

/// Diffraction order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Order {
    /// Number of the order; its tangential wave number is the incident one plus `m·2π/Λ`.
    pub m: i32,
    /// Amplitude of the field along the grooves (E in TE, H in TM) at the mean plane, relative to the incident one.
    pub amplitude: Complex<f64>,
    /// Efficiency: fraction of the incident power, 0 to 1.
    pub efficiency: f64,
}

/// All propagating orders.
#[derive(Clone, Debug, PartialEq)]
pub struct Orders {
    /// Reflected orders, by increasing number.
    pub reflected: Vec<Order>,
    /// Transmitted orders, by increasing number; empty for an absorbing medium.
    pub transmitted: Vec<Order>,
}

impl Orders {
    /// Reflected order `m`; zero amplitude if it does not propagate.
    pub fn reflected(&self, m: i32) -> Order {
        let found = self.reflected.iter().find(|o| o.m == m);
        found.copied().unwrap_or(Order { m, amplitude: ZERO, efficiency: 0.0 })
    }

    /// Total efficiency of all orders; 1 without absorption.
    pub fn total(&self) -> f64 {
        self.reflected.iter().chain(&self.transmitted).map(|o| o.efficiency).sum()
    }
}

/// Plane waves of a problem, in units of the vacuum wave number.
struct Waves {
    /// Orders run from `-harmonics` to `harmonics`.
    harmonics: usize,
    /// Tangential wave numbers.
    alpha: Vec<f64>,
    /// Vertical wave numbers above, with Im ≥ 0.
    above: Vec<Complex<f64>>,
    /// Vertical wave numbers below, with Im ≥ 0.
    below: Vec<Complex<f64>>,
    /// Permittivities above and below.
    eps: [Complex<f64>; 2],
    /// Depth and grating wave number.
    depth: f64,
    grating: f64,
    polarization: Polarization,
}

impl Waves {
    /// Wave numbers and permittivities of a problem.
    ///
    /// # Errors
    /// `Input` for parameters that are not finite or not physical.
    fn new(grating: &Grating, light: &Light, polarization: Polarization, harmonics: usize) -> Result<Self> {
        check(grating, light)?;
        let k0 = TAU / (light.wavelength_nm / 1000.0);
        let (step, eps) = (TAU / grating.period_um / k0, [ONE * grating.above.powi(2), grating.below * grating.below]);
        let first = -(harmonics as f64);
        let alpha: Vec<f64> =
            (0..=2 * harmonics).map(|j| grating.above * light.angle.sin() + (first + j as f64) * step).collect();
        let vertical = |eps: Complex<f64>| alpha.iter().map(|a| outgoing(eps - a * a)).collect();
        let (above, below) = (vertical(eps[0]), vertical(eps[1]));
        Ok(Self { harmonics, alpha, above, below, eps, depth: grating.depth_um * k0, grating: step, polarization })
    }

    fn count(&self) -> usize {
        self.alpha.len()
    }

    /// Whether waves propagate to infinity in the lower medium.
    fn lossless(&self) -> bool {
        self.eps[1].im == 0.0
    }

    /// Factor of the normal derivative in the boundary condition: 1 in TE, 1/ε in TM.
    fn weight(&self, medium: usize) -> Complex<f64> {
        match self.polarization {
            Polarization::Te => ONE,
            Polarization::Tm => ONE / self.eps[medium],
        }
    }

    /// Propagating orders of a medium from the amplitudes at the mean plane.
    fn orders(&self, medium: usize, amplitudes: &[Complex<f64>]) -> Vec<Order> {
        let vertical = if medium == 0 { &self.above } else { &self.below };
        let incident = self.above[self.harmonics].re * self.weight(0).re;
        let order = |j: usize| Order {
            m: j as i32 - self.harmonics as i32,
            amplitude: amplitudes[j],
            efficiency: amplitudes[j].norm_sqr() * (vertical[j] * self.weight(medium)).re / incident,
        };
        (0..self.count()).filter(|j| propagates(vertical[*j])).map(order).collect()
    }
}

/// Whether a wave carries power to infinity in a lossless medium.
fn propagates(vertical: Complex<f64>) -> bool {
    vertical.im == 0.0 && vertical.re > 0.0
}

/// Square root with Im ≥ 0 (and Re > 0 for propagating waves).
fn outgoing(square: Complex<f64>) -> Complex<f64> {
    if square.im == 0.0 {
        let root = square.re.abs().sqrt();
        return if square.re >= 0.0 { root.into() } else { I * root };
    }
    let root = square.sqrt();
    if root.im < 0.0 { -root } else { root }
}

fn check(grating: &Grating, light: &Light) -> Result<()> {
    let (n, angle) = (grating.below, light.angle.abs());
    for (name, value, fits, wanted) in [
        ("period", grating.period_um, grating.period_um > 0.0, "a positive number of µm"),
        ("depth", grating.depth_um, grating.depth_um >= 0.0, "a number of µm, 0 or more"),
        ("index above", grating.above, grating.above > 0.0, "a positive index"),
        ("index below, real part", n.re, n.re >= 0.0 && n.norm() > 0.0, "0 or more"),
        ("index below, imaginary part", n.im, n.im >= 0.0, "0 or more: fields go as exp(-iωt)"),
        ("wavelength", light.wavelength_nm, light.wavelength_nm > 0.0, "a positive number of nm"),
        ("angle of incidence", light.angle, angle < FRAC_PI_2, "less than 90°"),
    ] {
        if !(fits && value.is_finite()) {
            return Err(Error::input(format!("grating, {name}"), format!("found {value}"), format!("give {wanted}")));
        }
    }
    Ok(())
}
