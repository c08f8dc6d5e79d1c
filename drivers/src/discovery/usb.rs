//! USB devices without a kernel driver: custom electronics.

use super::{Found, Kind, Root, Usb, check, entries, quoted};
use crate::flash::bulk;

/// All USB devices; none on machines without USB.
pub fn usb_devices(root: &Root) -> Vec<Usb> {
    entries(&root.sys.join("bus/usb/devices")).iter().filter_map(|folder| Usb::at(folder)).collect()
}

/// Flashes with a bulk-transfer protocol.
pub(super) fn others(root: &Root) -> Vec<Found> {
    let ours = |usb: &Usb| (usb.vendor, usb.product) == (bulk::VENDOR, bulk::PRODUCT);
    usb_devices(root).into_iter().filter(ours).map(|usb| flash(root, usb)).collect()
}

fn flash(root: &Root, usb: Usb) -> Found {
    let node = usb.node(root);
    let serial = usb.serial.as_ref().map_or_else(String::new, |s| format!(", serial = {}", quoted(s)));
    Found {
        kind: Kind::Flash,
        what: format!("flash with bulk transfers ({})", usb.words()),
        id: usb.identity(),
        stable: None,
        size_mm: None,
        setting: Some(format!("{{ kind = \"bulk\"{serial} }}")),
        // The IDs are free for experiments, so only the name identifies the device.
        sure: usb.name.as_deref() == Some(bulk::NAME),
        access: check(root, &node),
        node: Some(node),
        usb: Some(usb),
    }
}
