//! Errors of cameras of libgphoto2, in the user's terms.

use super::node::{Cause, Failure};
use crate::{Class, DeviceError};

/// Name of the driver before the camera is known.
const UNKNOWN: &str = "gphoto2 camera";

/// Name of a program of the GNOME desktop that opens every camera.
pub const GVFS: &str = "gvfs-gphoto2-volume-monitor";

/// Error of a wrong setting.
pub fn setup(id: &str, expected: impl Into<Box<str>>, got: impl Into<Box<str>>) -> DeviceError {
    DeviceError::new(id, "open", expected, got).class(Class::Setup)
}

/// Error of invalid settings.
pub fn wrong_settings(wrong: String) -> DeviceError {
    setup(UNKNOWN, "settings of a gphoto2 camera", wrong).remedy("correct the camera's settings in the configuration")
}

/// Error of opening a camera.
pub fn opening(device: Option<&str>, failure: &Failure) -> DeviceError {
    let id = device.map_or_else(|| UNKNOWN.to_owned(), |device| format!("gphoto2 {device}"));
    match failure.cause {
        Cause::Library => {
            setup(&id, "the library libgphoto2", failure.text.clone()).remedy("install it (Debian: libgphoto2-6)")
        }
        Cause::Missing => setup(&id, "a camera", failure.text.clone())
            .remedy("switch the camera on and plug it in; `nacre devices` lists cameras"),
        Cause::Several => setup(&id, "one camera", failure.text.clone())
            .remedy("name one with `device`, and with `serial` if the models are the same"),
        _ => command(&id, "open", "a camera", failure).class(Class::Setup),
    }
}

/// Error of a command.
pub fn command(id: &str, command: &str, expected: &str, failure: &Failure) -> DeviceError {
    let error = DeviceError::new(id, command, expected, failure.text.clone());
    match failure.cause {
        Cause::Gone => {
            error.class(Class::Lost).remedy("check the cable and that the camera is on, then resume the session")
        }
        Cause::Busy => error.class(Class::Retry).remedy("wait until the camera is idle, then resume the session"),
        Cause::Held => error.class(Class::Setup).remedy(format!(
            "end the program that uses the camera; on a GNOME desktop run `systemctl --user mask --now {GVFS}.service` \
             or `pkill {GVFS}`"
        )),
        Cause::Denied => error
            .class(Class::Setup)
            .remedy("install the udev rules (`nacre devices --udev`), then plug the camera in again"),
        cause => error.remedy(remedy(cause)),
    }
}

/// Instruction for an error at the camera itself.
fn remedy(cause: Cause) -> &'static str {
    match cause {
        Cause::Battery => "charge the battery or use a mains adapter, then resume the session",
        Cause::CardFull => "the memory card is full: empty it, then resume the session",
        Cause::NoCard => "put a memory card in, then resume the session",
        Cause::CardProtected => {
            "the memory card cannot be written: unlock its switch or format it, then resume the session"
        }
        Cause::Lens => "take the lens cap off and check the lens, then resume the session",
        Cause::Mirror => "switch the camera's mirror lock-up off, then resume the session",
        Cause::Focus => "switch the lens to manual focus and focus by hand, then resume the session",
        Cause::Bulb => "set the shutter to a speed: bulb and time are not supported",
        Cause::TooLarge => "set a smaller image size on the camera",
        _ => "look at the camera's display, then resume the session",
    }
}
