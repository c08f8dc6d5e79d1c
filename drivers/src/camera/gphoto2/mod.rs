//! Digital cameras at a USB cable, through the library libgphoto2.
//!
//! All code except the calls of the library works on a [`node::Node`], so that it is tested without a camera. The
//! library is loaded when one of these cameras is used; the calls are declared by hand.

pub mod driver;
#[cfg(test)]
mod fake;
mod faults;
pub mod labels;
pub mod library;
pub mod node;
mod open;
pub mod settings;
#[cfg(test)]
mod tests;

pub use driver::Gphoto2Camera;
pub use faults::GVFS;
pub use library::load;
pub use settings::{Format, Settings};

use super::photograph::Photography;
use crate::{Camera, Clock, DeviceResult};
use std::sync::Arc;

/// Opens a camera. One photograph is taken, whose size and levels describe the camera.
///
/// # Errors
/// `Setup` without the library (Debian: libgphoto2-6), and if the camera is missing, in use or not usable.
pub fn open(settings: &Settings, clock: &Arc<dyn Clock>, program: &Photography) -> DeviceResult<Box<dyn Camera>> {
    settings.check().map_err(faults::wrong_settings)?;
    let device = settings.device.as_deref();
    let node = library::GphotoNode::open(device, settings.serial.as_deref());
    let node = node.map_err(|e| faults::opening(device, &e))?;
    Ok(Box::new(Gphoto2Camera::open(Box::new(node), settings.clone(), clock.clone(), program.reader.clone())?))
}
