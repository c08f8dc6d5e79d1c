//! Polarized light: Jones vectors and matrices, Stokes parameters, and materials of holograms.

mod jones;
mod material;
mod stokes;

pub use jones::{Jones, JonesVector};
pub use material::Material;
pub use stokes::Stokes;

/// Signed difference `a - b` of two orientations (rad), modulo π, in `[-π/2, π/2)`.
pub fn angle_difference(a: f64, b: f64) -> f64 {
    use std::f64::consts::{FRAC_PI_2, PI};
    (a - b + FRAC_PI_2).rem_euclid(PI) - FRAC_PI_2
}
