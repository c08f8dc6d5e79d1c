//! Analyser-angle errors and shifts between photographs: estimation and correction.

pub(crate) mod aligned;
pub(crate) mod angle_error;
#[cfg(test)]
mod drift_tests;
pub(crate) mod duplicates;
pub(crate) mod layout;
pub(crate) mod repeats;
pub(crate) mod sample;
