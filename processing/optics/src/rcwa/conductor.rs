//! Perfect conductors of any smooth cross-section: outgoing plane waves, fitted to the boundary condition by least
//! squares.

use super::{ALUMINIUM, Grating, I, Light, Orders, Polarization, Waves, check};
use nacre_base::{Error, Result};
use nalgebra::{DMatrix, DVector};
use num_complex::Complex;
use std::f64::consts::TAU;

/// Surface points per plane wave.
const POINTS: usize = 4;

/// Solves for a perfect conductor with `h(x) = Σ aₖ cos(2πkx/Λ) + bₖ sin(2πkx/Λ)` and `2·harmonics + 1` plane waves.
/// `(aₖ, bₖ)` are in µm, from k = 1 on.
///
/// Outgoing and evanescent waves are complete on the surface in the least-squares sense (Millar 1973), even where
/// Rayleigh's hypothesis does not hold. The fit minimises the field along the grooves (TE) or its normal derivative
/// (TM) on the surface. A perfect conductor does not absorb, so the error shows as the deviation of [`Orders::total`]
/// from 1.
///
/// # Errors
/// `Input` for unphysical parameters.
pub fn conductor(
    series: &[[f64; 2]],
    period_um: f64,
    light: &Light,
    polarization: Polarization,
    harmonics: usize,
) -> Result<Orders> {
    let grating = Grating { period_um, depth_um: 0.0, above: 1.0, below: ALUMINIUM };
    check(&grating, light)?;
    if let Some(bad) = series.iter().flatten().find(|v| !v.is_finite()) {
        return Err(Error::input("grating, series", format!("found {bad}"), "give numbers of µm"));
    }
    let waves = Waves::new(&grating, light, polarization, harmonics)?;
    let points = POINTS * waves.count().max(8 * series.len());
    let k0 = TAU / (light.wavelength_nm / 1000.0);
    // Phase, height and slope, in units of the wave number.
    let surface: Vec<[f64; 3]> = (0..points)
        .map(|i| {
            let phase = TAU * i as f64 / points as f64;
            let mut at = [phase, 0.0, 0.0];
            for (k, [a, b]) in (1..).map(f64::from).zip(series) {
                let (sin, cos) = (k * phase).sin_cos();
                at[1] += (a * cos + b * sin) * k0;
                at[2] += (b * cos - a * sin) * k * k0 * waves.grating;
            }
            at
        })
        .collect();
    let top = surface.iter().fold(0.0_f64, |top, at| top.max(at[1].abs()));
    // Evanescent waves are scaled to 1 at their maximum.
    let wave = |alpha: f64, q: Complex<f64>, [phase, height, slope]: [f64; 3]| {
        let field = (I * alpha * (phase / waves.grating) + I * q * height - q.im * top).exp();
        match polarization {
            Polarization::Te => field,
            Polarization::Tm => field * (q - slope * alpha),
        }
    };
    let system = DMatrix::from_fn(points, waves.count(), |i, j| wave(waves.alpha[j], waves.above[j], surface[i]));
    let (alpha, down) = (waves.alpha[harmonics], -waves.above[harmonics]);
    let incident = DVector::from_fn(points, |i, _| -wave(alpha, down, surface[i]));
    let found = system.svd(true, true).solve(&incident, 1e-13).map_err(|why| {
        Error::input("grating", format!("its plane waves cannot be matched: {why}"), "change harmonics a little")
    })?;
    Ok(Orders { reflected: waves.orders(0, found.as_slice()), transmitted: vec![] })
}
