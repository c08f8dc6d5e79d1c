//! Cameras that the library detects.

use super::context::Messages;
use super::ffi;
use super::safe::{checked, text};
use crate::camera::gphoto2::node::NodeResult;
use std::ptr;

/// Largest number of cameras in a list.
const MAX_CAMERAS: i32 = 64;

/// A detected camera.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Detected {
    /// Model, as the library names it.
    pub model: String,
    /// Port, such as `usb:001,005`, which changes each time that the camera is switched on.
    pub port: String,
}

/// Cameras at USB ports. The library must be loaded and locked.
pub(super) fn detect() -> NodeResult<Vec<Detected>> {
    let messages = Messages::new();
    let mut list = ptr::null_mut();
    // SAFETY: the pointer lives through the call.
    checked(&messages, || unsafe { ffi::gp_list_new(&raw mut list) })?;
    // SAFETY: the list is valid until it is released below, and the context as long as `messages`.
    let found = checked(&messages, || unsafe { ffi::gp_camera_autodetect(list, messages.context()) });
    // SAFETY: as above.
    let count = unsafe { ffi::gp_list_count(list) }.min(MAX_CAMERAS);
    let mut cameras = vec![];
    for index in 0..count {
        let (mut model, mut port) = (ptr::null(), ptr::null());
        // SAFETY: the index is valid; the strings are copied before the list is released.
        unsafe {
            ffi::gp_list_get_name(list, index, &raw mut model);
            ffi::gp_list_get_value(list, index, &raw mut port);
            cameras.push(Detected { model: text(model), port: text(port) });
        }
    }
    // SAFETY: the list is released once, after its last use.
    unsafe { ffi::gp_list_unref(list) };
    found.map(|_| cameras)
}
