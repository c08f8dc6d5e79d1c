//! Cameras that answer on the network or are connected to USB 3.

use super::ffi;
use super::safe::text;
use crate::discovery::Root;
use crate::discovery::genicam::has_usb3_vision;
use std::ffi::c_char;

/// Maximum number of listed cameras.
const MAX_CAMERAS: u32 = 256;

/// A camera that answers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Listed {
    /// Identifier for the configuration.
    pub id: String,
    /// Network address, or a description of the USB device.
    pub address: String,
    /// Manufacturer.
    pub vendor: String,
    /// Model.
    pub model: String,
    /// Serial number.
    pub serial: String,
    /// Whether the camera is on a network.
    pub network: bool,
}

/// Looks for cameras on USB only where one is connected: for them, the library keeps a thread and files until the
/// process ends.
pub(super) fn choose_interfaces() {
    let usb = c"USB3Vision".as_ptr();
    let connected = has_usb3_vision(&Root::default());
    // SAFETY: the name ends with zero.
    unsafe { if connected { ffi::arv_enable_interface(usb) } else { ffi::arv_disable_interface(usb) } }
}

/// Cameras that answer within about a second; none without the library. No camera is opened.
pub fn cameras() -> Vec<Listed> {
    if ffi::load().is_err() {
        return vec![];
    }
    choose_interfaces();
    // SAFETY: the library guards its list by a lock, and indices beyond its end give null.
    let count = unsafe {
        ffi::arv_update_device_list();
        ffi::arv_get_n_devices()
    };
    // SAFETY: as above.
    let get = |read: unsafe extern "C" fn(u32) -> *const c_char, index: u32| text(unsafe { read(index) });
    let listed = |index: u32| Listed {
        id: get(ffi::arv_get_device_id, index),
        address: get(ffi::arv_get_device_address, index),
        vendor: get(ffi::arv_get_device_vendor, index),
        model: get(ffi::arv_get_device_model, index),
        serial: get(ffi::arv_get_device_serial_nbr, index),
        network: get(ffi::arv_get_device_protocol, index) == "GigEVision",
    };
    (0..count.min(MAX_CAMERAS)).map(listed).filter(|camera| !camera.id.is_empty()).collect()
}
