//! Calibration of cameras from photographs, without the simulator and without a bench.
//!
//! [`camera`] is the photon transfer of EMVA Standard 1288: gain, read noise, full well, dark current, linearity,
//! differences between pixels and bad pixels.

pub mod camera;
pub mod report;
pub mod series;
pub mod spatial;
pub mod transfer;

pub use camera::Options;

#[cfg(test)]
mod tests;
