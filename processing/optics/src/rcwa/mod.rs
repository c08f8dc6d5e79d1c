//! Rigorous diffraction by gratings: Maxwell's equations without the scalar or thin-grating assumption.
//!
//! A metal's surface is `h(x) = d/2 · cos(2πx/Λ)`, d peak to peak; below it lies the metal (or a dielectric), above it air or
//! film. Light comes from above in the plane across the grooves (no conical incidence). Two independent methods share
//! one set of types:
//!
//! - [`slices`]: rigorous coupled-wave analysis. The profile is a staircase, every slice couples plane waves through
//!   Fourier series of its permittivity (with Li's factorisation rules for TM: Li 1996), and slices are joined by a
//!   recursion of the admittance that holds decaying exponentials only, so it is stable at any depth. Works for any
//!   depth, but in TM metal stairs converge slowly.
//! - [`coordinates`]: the same equations in coordinates that follow the surface (Chandezon's method). A smooth profile
//!   has no stairs there and converges exponentially.
//!
//! [`solve`] takes the wanted error, and uses the cheapest setting whose predicted error meets it. [`conductor`] takes any smooth cross-section
//! of a perfect conductor: what scalar theory is compared with.
//!
//! Conventions: fields go as `exp(-iωt)`, so absorbing media have a positive imaginary index and a delay is a positive
//! phase; amplitudes refer to the mean plane of the surface.
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

/// Refractive index of evaporated aluminium near 560 nm, as the 2018 paper uses it (below its Fig. 14), for
/// `exp(-iωt)`.
pub const ALUMINIUM: Complex<f64> = Complex::new(1.0003, 6.5044);

const I: Complex<f64> = Complex::new(0.0, 1.0);
const ONE: Complex<f64> = Complex::new(1.0, 0.0);
const ZERO: Complex<f64> = Complex::new(0.0, 0.0);

/// A sinusoidal surface between two media.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grating {
    /// Period in µm.
    pub period_um: f64,
    /// Depth in µm, peak to peak.
    pub depth_um: f64,
    /// Refractive index above the surface, where the light comes from.
    pub above: f64,
    /// Complex refractive index below; its imaginary part is not negative.
    pub below: Complex<f64>,
}

/// A plane wave across the grooves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Wavelength in vacuum, in nm.
    pub wavelength_nm: f64,
    /// Angle of incidence in the upper medium, in rad.
    pub angle: f64,
}

/// Which field lies along the grooves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Polarization {
    /// s: the electric field.
    Te,
    /// p: the magnetic field.
    Tm,
}

/// One plane wave that leaves the grating.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Order {
    /// Number of the order; its tangential wave number is the incident one plus `m·2π/Λ`.
    pub m: i32,
    /// Amplitude of the field along the grooves (E in TE, H in TM) relative to the incident one, at the mean plane.
    pub amplitude: Complex<f64>,
    /// Share of the incident power, 0 to 1.
    pub efficiency: f64,
}

/// All propagating orders.
#[derive(Clone, Debug, PartialEq)]
pub struct Orders {
    /// Reflected orders, by rising number.
    pub reflected: Vec<Order>,
    /// Transmitted orders, by rising number; none into an absorbing medium.
    pub transmitted: Vec<Order>,
}

impl Orders {
    /// A reflected order; no light when it does not propagate.
    pub fn reflected(&self, m: i32) -> Order {
        let found = self.reflected.iter().find(|o| o.m == m);
        found.copied().unwrap_or(Order { m, amplitude: ZERO, efficiency: 0.0 })
    }

    /// Power in all orders, relative to the incident one: 1 without absorption.
    pub fn total(&self) -> f64 {
        self.reflected.iter().chain(&self.transmitted).map(|o| o.efficiency).sum()
    }
}

/// The plane waves of a problem, in units of the wave number in vacuum.
struct Waves {
    /// Orders run from `-harmonics` to `harmonics`.
    harmonics: usize,
    /// Tangential wave numbers.
    alpha: Vec<f64>,
    /// Vertical wave numbers above, with Im ≥ 0.
    above: Vec<Complex<f64>>,
    /// The same below.
    below: Vec<Complex<f64>>,
    /// Permittivities above and below.
    eps: [Complex<f64>; 2],
    /// Depth and the grating's own wave number.
    depth: f64,
    grating: f64,
    polarization: Polarization,
}

impl Waves {
    /// # Errors
    /// Numbers that are not finite or not physical.
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

    /// Whether the lower medium lets waves propagate to infinity.
    fn lossless(&self) -> bool {
        self.eps[1].im == 0.0
    }

    /// 1 in TE, 1/ε in TM: what multiplies the normal derivative in the boundary condition.
    fn weight(&self, medium: usize) -> Complex<f64> {
        match self.polarization {
            Polarization::Te => ONE,
            Polarization::Tm => ONE / self.eps[medium],
        }
    }

    /// Propagating orders of a medium from their amplitudes at the mean plane.
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

/// A wave that carries power to infinity in a lossless medium.
fn propagates(vertical: Complex<f64>) -> bool {
    vertical.im == 0.0 && vertical.re > 0.0
}

/// The root with Im ≥ 0 (and Re > 0 for waves that propagate).
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
