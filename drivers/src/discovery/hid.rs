//! HID devices that accept reports.

use super::{Found, Kind, Root, Usb, check, entries, name, quoted, text, uevent};
use std::path::{Path, PathBuf};

/// A hidraw node.
#[derive(Clone, Debug, PartialEq)]
pub struct HidNode {
    /// The device node.
    pub node: PathBuf,
    /// Vendor ID.
    pub vendor: u16,
    /// Product ID.
    pub product: u16,
    /// Manufacturer and product in one string.
    pub name: String,
    /// Serial number; empty if there is none.
    pub serial: String,
    /// The underlying USB device.
    pub usb: Option<Usb>,
}

/// All hidraw nodes; none if the kernel lacks HID.
pub fn hid_nodes(root: &Root) -> Vec<HidNode> {
    entries(&root.sys.join("class/hidraw")).iter().filter_map(|folder| node(root, folder)).collect()
}

fn node(root: &Root, folder: &Path) -> Option<HidNode> {
    let read = uevent::parse(&text(&folder.join("device/uevent"))?);
    let (_, vendor, product) = read.id?;
    let usb = Usb::of(root, &folder.join("device"));
    Some(HidNode { node: root.dev.join(name(folder)), vendor, product, name: read.name, serial: read.serial, usb })
}

/// HID devices of possible use; keyboards and mice are excluded.
pub(super) fn devices(root: &Root) -> Vec<Found> {
    hid_nodes(root).into_iter().filter_map(|hid| device(root, hid)).collect()
}

fn device(root: &Root, hid: HidNode) -> Option<Found> {
    let (what, setting) = match (hid.vendor, hid.product) {
        (0x16c0, 0x05df) if hid.name.contains("USBRelay") => ("relay", "{ kind = \"relay\", channel = 1 }".to_owned()),
        (0x0519, 0x2018) => ("relay whose state cannot be read back", "{ kind = \"relay\", channel = 1 }".to_owned()),
        (0x27b8, 0x01ed) if hid.serial.is_empty() => ("blink(1) lamp", "{ kind = \"blink1\" }".to_owned()),
        (0x27b8, 0x01ed) => ("blink(1) lamp", format!("{{ kind = \"blink1\", serial = {} }}", quoted(&hid.serial))),
        _ => return None,
    };
    let numbers = format!("{:04x}:{:04x}", hid.vendor, hid.product);
    let id = match (&hid.usb, hid.serial.as_str()) {
        (Some(usb), _) => usb.identity(),
        (None, "") => format!("{numbers} at {}", hid.node.display()),
        (None, serial) => format!("{numbers} {serial}"),
    };
    Some(Found {
        kind: Kind::Flash,
        what: format!("{what} ({})", hid.name),
        id,
        stable: None,
        size_mm: None,
        setting: Some(setting),
        sure: true,
        access: check(root, &hid.node),
        node: Some(hid.node),
        usb: hid.usb,
    })
}
