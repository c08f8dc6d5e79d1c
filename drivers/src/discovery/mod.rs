//! Devices of this machine, from the kernel's device tree and the network; no device is opened.
//!
//! Devices without access rights are listed together with a remedy.

mod access;
pub(crate) mod genicam;
mod gphoto2;
pub mod gvcp;
mod hid;
mod routes;
mod rules;
mod screens;
mod serial;
mod sysfs;
pub mod uevent;
mod usb;
mod video;

pub use access::{Access, RULES_PATH, remedy, require};
pub use genicam::NetworkCamera;
pub use hid::{HidNode, hid_nodes};
pub use rules::udev_rules;
pub use sysfs::{Root, Usb};
pub use usb::usb_devices;

pub(crate) use access::check;
pub(crate) use routes::broadcast_addresses;
pub(crate) use sysfs::{bytes, entries, name, text};

use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// A detected device.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Found {
    /// Possible role on a bench.
    pub kind: Kind,
    /// Description of the device.
    pub what: String,
    /// Identifier that distinguishes devices of one model and, where possible, survives replugging at another port.
    pub id: String,
    /// Device node.
    pub node: Option<PathBuf>,
    /// Stable name of the node.
    pub stable: Option<PathBuf>,
    /// Width and height of a display in mm, if known from its EDID.
    pub size_mm: Option<[f64; 2]>,
    /// The USB device that it belongs to.
    pub usb: Option<Usb>,
    /// Value of `driver` for nacre.toml, as an inline TOML table; `None` if the role is unknown.
    pub setting: Option<String>,
    /// Whether the role is certain.
    pub sure: bool,
    /// Access rights.
    pub access: Access,
}

/// Role of a device on a bench.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// A rotation stage.
    Stage,
    /// A camera.
    Camera,
    /// A flash.
    Flash,
    /// A display.
    Display,
    /// No known role.
    Other,
}

/// All devices of this machine with a possible role. Cameras on the network take about a second.
pub fn discover(root: &Root) -> Vec<Found> {
    let (mut found, network) = discover_apart(root);
    found.extend(network.into_iter().map(|camera| camera.found));
    found
}

/// Devices of ASCOM Alpaca servers on the networks, and of an INDI server on this computer. Takes about a second.
pub fn discover_servers(root: &Root) -> Vec<Found> {
    let indi = std::thread::spawn(crate::indi::discovery::found);
    let mut found = crate::alpaca::discovery::found(root);
    found.extend(indi.join().unwrap_or_default());
    found
}

/// Devices of this machine, and cameras on the network.
pub(crate) fn discover_apart(root: &Root) -> (Vec<Found>, Vec<NetworkCamera>) {
    let mut found = serial::ports(root);
    found.extend(hid::devices(root));
    found.extend(video::cameras(root));
    found.extend(screens::screens(root));
    found.extend(usb::others(root));
    let answers = genicam::answers(root);
    found.extend(genicam::usb_cameras(root, &answers));
    found.extend(gphoto2::cameras(root));
    (found, genicam::network_cameras(root, answers))
}

/// The udev name of a node by its device's serial number. Devices without a serial number share that name, so they are
/// named by their port.
pub(crate) fn stable_name(root: &Root, class: &str, node: &str, usb: Option<&Usb>) -> Option<PathBuf> {
    let has_serial = usb.is_some_and(|usb| usb.serial.is_some());
    let links = entries(&root.dev.join(class).join(if has_serial { "by-id" } else { "by-path" }));
    links.into_iter().find(|link| std::fs::read_link(link).is_ok_and(|to| name(&to) == node))
}

/// Quotes a string as in TOML.
pub(crate) fn quoted(text: &str) -> String {
    let mut quoted = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => quoted.extend(['\\', c]),
            c if c.is_control() => quoted.push_str(&format!("\\u{:04X}", u32::from(c))),
            c => quoted.push(c),
        }
    }
    quoted.push('"');
    quoted
}

#[cfg(test)]
mod tests;
