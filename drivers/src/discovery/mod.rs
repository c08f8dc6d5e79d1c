//! Which devices this machine has, as the kernel's device tree tells: nothing is opened to find out.
//!
//! A device that is there but may not be opened is listed, with what would change that.

mod access;
mod hid;
mod rules;
mod screens;
mod serial;
mod sysfs;
pub mod uevent;
mod usb;
mod video;

pub use access::{Access, RULES_PATH, remedy};
pub use hid::{HidNode, hid_nodes};
pub use rules::udev_rules;
pub use sysfs::{Root, Usb};
pub use usb::usb_devices;

pub(crate) use access::check;
pub(crate) use sysfs::{bytes, entries, name, text};

use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// A device that was found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Found {
    /// What it can be on a bench.
    pub kind: Kind,
    /// What it is, in words.
    pub what: String,
    /// What tells it apart from others of its kind, also after it was plugged in elsewhere where that is possible.
    pub id: String,
    /// Its device node.
    pub node: Option<PathBuf>,
    /// A name of its node that stays the same.
    pub stable: Option<PathBuf>,
    /// Width and height of a panel in mm, where it tells.
    pub size_mm: Option<[f64; 2]>,
    /// The USB device that it belongs to.
    pub usb: Option<Usb>,
    /// What to write as `driver` into nacre.toml, as an inline table of TOML; None when it is of no known kind.
    pub setting: Option<String>,
    /// It is of the kind for sure, not only perhaps.
    pub sure: bool,
    /// Whether it may be opened.
    pub access: Access,
}

/// What a device can be on a bench.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// A rotation stage.
    Stage,
    /// A camera.
    Camera,
    /// A flash.
    Flash,
    /// A panel.
    Display,
    /// None of these, as far as is known.
    Other,
}

/// All devices of this machine that could be of use.
pub fn discover(root: &Root) -> Vec<Found> {
    let mut found = serial::ports(root);
    found.extend(hid::devices(root));
    found.extend(video::cameras(root));
    found.extend(screens::screens(root));
    found.extend(usb::others(root));
    found
}

/// The name that udev gives a node by its device's serial number, or, as devices without one have the same name, by the
/// place where it is plugged in.
pub(crate) fn stable_name(root: &Root, class: &str, node: &str, usb: Option<&Usb>) -> Option<PathBuf> {
    let has_serial = usb.is_some_and(|usb| usb.serial.is_some());
    let links = entries(&root.dev.join(class).join(if has_serial { "by-id" } else { "by-path" }));
    links.into_iter().find(|link| std::fs::read_link(link).is_ok_and(|to| name(&to) == node))
}

/// A text as TOML writes it.
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
