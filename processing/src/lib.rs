//! Pure computation of Nacre: photographs in, maps of diffracting surfaces out. Each module is a separate crate,
//! re-exported here.
//!
//! No device, no async, no network. Conventions of all these crates:
//!
//! - Orientation is the direction of the grating vector (across the grooves), in `[0, π)`, anticlockwise from the right
//!   of the image as seen by the camera, y up. Angles are radians in memory and in EXR maps, degrees in JSON and in
//!   names that end in `_deg`.
//! - Images are row-major, top row first, pixel centres at integers.
//! - Lengths are µm and wavelengths nm, unless a name states another unit.
//!
//! Programs call [`numeric::flush_subnormals`] once at their start, so that dark photographs take no longer than bright
//! ones.

pub mod operations;

pub use nacre_base::{Error, Result, error, fields, numeric, operation, progress, statistics, text};
pub use nacre_brdf as surface;
pub use nacre_calibrate as calibrate;
pub use nacre_frames as frames;
pub use nacre_frames::hdr;
pub use nacre_image as image;
pub use nacre_inspect as inspect;
pub use nacre_lut as pattern;
pub use nacre_lut::{bokeh, foil};
pub use nacre_maps as map;
pub use nacre_maps::recommend;
pub use nacre_optics::{color, geometry, polarization, rcwa};
pub use nacre_periods::{calibration, flash, fringes};
pub use nacre_plot as plot;
pub use nacre_polarimetry as polarimetry;
pub use nacre_render as render;
pub use nacre_render::environment;
