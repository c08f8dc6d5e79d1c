//! Cameras of the kernel's V4L2.
//!
//! Everything but the last step to the kernel works on a [`node::Node`], so that it is tested without a camera. That step
//! needs the feature `v4l2`: the bindings to the kernel are made by libclang when Nacre is built.

pub mod controls;
pub mod driver;
#[cfg(test)]
pub(crate) mod fake;
#[cfg(feature = "v4l2")]
pub mod kernel;
pub mod node;
mod open;
pub mod pixels;
mod sequence;
pub mod settings;
#[cfg(test)]
pub(crate) mod tests;

pub use driver::V4l2Camera;
pub use settings::{GainScale, Settings, Timestamps};

use crate::{Camera, Clock, DeviceResult};
use std::sync::Arc;

/// Opens a camera.
///
/// # Errors
/// `Setup` when it is not there, may not be opened or is something else.
#[cfg(feature = "v4l2")]
pub fn open(settings: &Settings, clock: &Arc<dyn Clock>) -> DeviceResult<Box<dyn Camera>> {
    Ok(Box::new(kernel::open(settings, clock)?))
}

/// Says that this build has no V4L2.
///
/// # Errors
/// Always `Setup`, with how to get a build that has it.
#[cfg(not(feature = "v4l2"))]
pub fn open(settings: &Settings, _clock: &Arc<dyn Clock>) -> DeviceResult<Box<dyn Camera>> {
    Err(crate::DeviceError::new(&settings.device, "open", "a build with V4L2", "one without")
        .remedy("build with `cargo build --release --features v4l2`; it needs libclang (Debian: libclang1-14 or later)")
        .class(crate::Class::Setup))
}
