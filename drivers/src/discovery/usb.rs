//! Devices on USB that no driver of the kernel serves: own electronics.

use super::{Found, Kind, Root, Usb, check, entries, quoted};
use crate::flash::bulk;
use std::path::{Path, PathBuf};

/// All devices on USB; none where there is no USB.
pub fn usb_devices(root: &Root) -> Vec<Usb> {
    folders(root).into_iter().map(|(_, usb)| usb).collect()
}

fn folders(root: &Root) -> Vec<(PathBuf, Usb)> {
    let all = entries(&root.sys.join("bus/usb/devices"));
    all.into_iter().filter_map(|folder| Usb::at(&folder).map(|usb| (folder, usb))).collect()
}

/// Flashes that are driven over bulk transfers.
pub(super) fn others(root: &Root) -> Vec<Found> {
    let ours = |usb: &Usb| (usb.vendor, usb.product) == (bulk::VENDOR, bulk::PRODUCT);
    let found = folders(root).into_iter().filter(|(_, usb)| ours(usb));
    found.map(|(folder, usb)| flash(root, &folder, usb)).collect()
}

fn flash(root: &Root, folder: &Path, usb: Usb) -> Found {
    let number = super::text(&folder.join("devnum")).and_then(|n| n.parse::<u16>().ok()).unwrap_or(0);
    let node = root.dev.join(format!("bus/usb/{:03}/{number:03}", usb.bus));
    let serial = usb.serial.as_ref().map_or_else(String::new, |s| format!(", serial = {}", quoted(s)));
    Found {
        kind: Kind::Flash,
        what: format!("flash with bulk transfers ({})", usb.words()),
        id: usb.identity(),
        stable: None,
        setting: Some(format!("{{ kind = \"bulk\"{serial} }}")),
        // The number is one that anybody may use for experiments.
        sure: usb.name.as_deref() == Some(bulk::NAME),
        access: check(root, &node),
        node: Some(node),
        usb: Some(usb),
    }
}
