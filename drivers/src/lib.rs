//! What devices and their simulation have in common: time, and the rule that decides whether a frame is fresh.
//!
//! The device traits and drivers themselves come with the capture engine.

pub mod clock;
pub mod freshness;

pub use clock::{Clock, SystemClock};
pub use freshness::{Freshness, Stamp};
