//! The virtual bench: optics, samples, devices, noise and time, without hardware.
//!
//! It renders a fuller model than the reconstruction inverts, so that a good score is not the same code run
//! backwards.

pub mod sample;
