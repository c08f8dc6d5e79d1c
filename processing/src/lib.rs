//! Pure computation of Nacre: photographs in, maps of diffracting surfaces out.
//!
//! No device, no async, no network. Conventions that hold everywhere in this crate:
//!
//! - Orientation is the direction of the grating vector (across the grooves), in `[0, π)`, anticlockwise from
//!   image right as the camera sees it, y up. Angles are radians in memory and in EXR maps, degrees in JSON and
//!   in names that end in `_deg`.
//! - Images are row-major, row 0 on top, pixel centres at integers.
//! - Lengths are µm, wavelengths nm, unless a name says otherwise.
//!
//! Programs call [`numeric::flush_subnormals`] once at their start, so that dark photographs take no longer than bright ones.

pub mod bokeh;
mod budget;
pub mod calibration;
pub mod chart;
pub mod color;
pub mod environment;
pub mod error;
pub mod flash;
pub mod foil;
pub mod frames;
pub mod geometry;
mod guard;
pub mod hdr;
pub mod image;
pub mod map;
mod memory;
pub mod numeric;
pub mod pattern;
pub mod polarimetry;
pub mod progress;
mod random;
pub mod rcwa;
pub mod recommend;
pub mod render;
pub mod spots;
pub mod surface;
pub mod text;
mod vectors;

pub use error::{Error, Result};
