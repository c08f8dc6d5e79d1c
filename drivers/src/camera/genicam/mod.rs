//! GenICam cameras: GigE Vision and USB3 Vision, through the library aravis.
//!
//! All code except the calls of the library works on a [`node::Node`], so that it is tested without a camera. The calls
//! need the feature `genicam` and the library (Debian: libaravis-dev). They are declared by hand: the driver needs 50
//! functions, and bindings for GLib would add 30 crates to the build.

#[cfg(feature = "genicam")]
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

pub use driver::GenicamCamera;
pub use settings::{GainUnit, Settings, Timestamps, Trigger};

use crate::{Camera, Clock, DeviceResult};
use std::sync::Arc;

/// Opens a camera.
///
/// # Errors
/// `Setup` if the camera is missing, in use or not usable.
#[cfg(feature = "genicam")]
pub fn open(settings: &Settings, clock: &Arc<dyn Clock>) -> DeviceResult<Box<dyn Camera>> {
    let checked = settings.check();
    checked.map_err(|wrong| open::wrong_settings(&settings.device, wrong))?;
    let node = aravis::AravisNode::open(&settings.device).map_err(|e| faults::opening(&settings.device, &e))?;
    Ok(Box::new(GenicamCamera::open(Box::new(node), settings.clone(), clock.clone())?))
}

/// Reports that this build lacks GenICam support.
///
/// # Errors
/// Always `Setup`, with instructions for a build with GenICam.
#[cfg(not(feature = "genicam"))]
pub fn open(settings: &Settings, _clock: &Arc<dyn Clock>) -> DeviceResult<Box<dyn Camera>> {
    Err(crate::DeviceError::new(&settings.device, "open", "a build with GenICam", "one without")
        .remedy("build with `cargo build --release --features genicam`; it needs libaravis-dev")
        .class(crate::Class::Setup))
}
