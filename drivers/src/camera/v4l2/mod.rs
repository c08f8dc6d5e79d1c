//! Cameras of the kernel's V4L2 interface.
//!
//! All code except the kernel calls works on a [`node::Node`], so that it is tested without a camera. The kernel calls
//! need the feature `v4l2`: libclang generates the bindings when Nacre is built.

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
/// `Setup` if the device is missing, may not be opened or is no camera.
#[cfg(feature = "v4l2")]
pub fn open(settings: &Settings, clock: &Arc<dyn Clock>) -> DeviceResult<Box<dyn Camera>> {
    Ok(Box::new(kernel::open(settings, clock)?))
}

/// Reports that this build lacks V4L2 support.
///
/// # Errors
/// Always `Setup`, with instructions for a build with V4L2.
#[cfg(not(feature = "v4l2"))]
pub fn open(settings: &Settings, _clock: &Arc<dyn Clock>) -> DeviceResult<Box<dyn Camera>> {
    Err(crate::DeviceError::new(&settings.device, "open", "a build with V4L2", "one without")
        .remedy("build with `cargo build --release --features v4l2`; it needs libclang (Debian: libclang1-14 or later)")
        .class(crate::Class::Setup))
}
