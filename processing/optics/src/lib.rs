#![doc = include_str!("../README.md")]
//!
//! The 2018 paper's setup: circular light, a grating, and an analyser. The intensity behind the analyser is a sinusoid
//! in twice its angle (Eq. 9), and the angle of linear polarization (AoLP) rotates with the grating:
//!
//! ```
//! use nacre_optics::polarization::{Jones, JonesVector, angle_difference};
//! use num_complex::Complex;
//!
//! let ratio = Complex::from_polar(1.1, 0.8);
//! let light = |orientation: f64| Jones::grating(orientation, ratio).apply(JonesVector::circular()).stokes();
//!
//! let [s, turned] = [light(0.0), light(0.3)];
//! let intensity = s.through_analyser(0.5);
//! assert!((intensity - (s.s0 + s.s1 * 1.0_f64.cos() + s.s2 * 1.0_f64.sin()) / 2.0).abs() < 1e-12);
//! assert!(angle_difference(turned.aolp() - 0.3, s.aolp()).abs() < 1e-12);
//! ```

pub mod color;
pub mod geometry;
pub mod polarization;
pub mod rcwa;
