//! Calibration of a bench from photographs, without the simulator.
//!
//! - [`camera`]: gain, read noise, full well, dark current, linearity, differences between pixels and bad pixels by
//!   photon transfer (EMVA Standard 1288).
//! - [`flat`]: unevenness of light and lens.
//! - [`analyser`]: zero, sense, extinction and eccentricity of the analyser, from a reference polarizer.
//! - [`retarder`]: azimuth and retardance of the panel's film.
//! - [`orientation`]: offset of orientations, from a sample of known orientation.
//!
//! Each writes a `calibration.json` ([`nacre_frames::Calibration`]), which sessions record and reconstructions apply.

pub mod analyser;
pub mod camera;
mod chart;
pub mod flat;
mod malus;
mod mirror;
pub mod orientation;
pub mod report;
pub mod response;
pub mod retarder;
pub mod series;
pub mod spatial;
pub mod transfer;
mod turn;
mod wedge;

#[cfg(test)]
mod tests;
