//! Cameras of the kernel's V4L2 interface.
//!
//! All code except the kernel calls works on a [`node::Node`], so that it is tested without a camera. The kernel calls
//! are those of 64-bit Linux.

pub mod controls;
pub mod driver;
#[cfg(test)]
pub(crate) mod fake;
pub mod formats;
#[cfg(all(target_os = "linux", target_pointer_width = "64"))]
pub mod kernel;
pub mod node;
mod open;
pub mod pixels;
mod sequence;
pub mod settings;
#[cfg(all(target_os = "linux", target_pointer_width = "64"))]
mod stream;
#[cfg(test)]
pub(crate) mod tests;

pub use driver::V4l2Camera;
pub use settings::{GainScale, Settings, Timestamps};

use crate::{Camera, Clock, DeviceResult};
use std::sync::Arc;

/// Whether this program can use cameras of V4L2.
pub const SUPPORTED: bool = cfg!(all(target_os = "linux", target_pointer_width = "64"));

/// Opens a camera.
///
/// # Errors
/// `Setup` if the device is missing, may not be opened or is no camera.
#[cfg(all(target_os = "linux", target_pointer_width = "64"))]
pub fn open(settings: &Settings, clock: &Arc<dyn Clock>) -> DeviceResult<Box<dyn Camera>> {
    Ok(Box::new(kernel::open(settings, clock)?))
}

/// Reports that this system has no V4L2.
///
/// # Errors
/// Always `Setup`.
#[cfg(not(all(target_os = "linux", target_pointer_width = "64")))]
pub fn open(settings: &Settings, _clock: &Arc<dyn Clock>) -> DeviceResult<Box<dyn Camera>> {
    Err(crate::DeviceError::new(&settings.device, "open", "64-bit Linux", "another system")
        .remedy("connect the camera to a computer with 64-bit Linux")
        .class(crate::Class::Setup))
}
