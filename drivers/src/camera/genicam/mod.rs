//! GenICam cameras: GigE Vision and USB3 Vision, through the library aravis.
//!
//! All code except the calls of the library works on a [`node::Node`], so that it is tested without a camera. The calls
//! are declared by hand: the driver needs 70 functions, and bindings for GLib would add 30 crates to the build.

pub mod aravis;
pub mod driver;
#[cfg(test)]
mod fake;
mod faults;
pub mod node;
mod open;
pub mod settings;
mod stamps;
#[cfg(test)]
mod tests;

pub use aravis::load;
pub use driver::GenicamCamera;
pub use settings::{GainUnit, Settings, Timestamps, Trigger};

use crate::{Camera, Clock, DeviceResult};
use std::sync::Arc;

/// Opens a camera.
///
/// # Errors
/// `Setup` without the library (Debian: libaravis-0.8-0), and if the camera is missing, in use or not usable.
pub fn open(settings: &Settings, clock: &Arc<dyn Clock>) -> DeviceResult<Box<dyn Camera>> {
    let checked = settings.check();
    checked.map_err(|wrong| open::wrong_settings(&settings.device, wrong))?;
    let node = aravis::AravisNode::open(&settings.device).map_err(|e| faults::opening(&settings.device, &e))?;
    Ok(Box::new(GenicamCamera::open(Box::new(node), settings.clone(), clock.clone())?))
}
