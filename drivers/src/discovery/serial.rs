//! Serial ports with a device behind them.

use super::{Found, Kind, Root, Usb, check, entries, name, quoted, stable_name};
use std::path::Path;

/// Serial ports. Those that the kernel makes up without hardware are left out.
pub(super) fn ports(root: &Root) -> Vec<Found> {
    entries(&root.sys.join("class/tty")).iter().filter_map(|folder| port(root, folder)).collect()
}

fn port(root: &Root, folder: &Path) -> Option<Found> {
    let device = folder.join("device");
    if !device.exists() {
        return None;
    }
    let usb = Usb::of(root, &device);
    // Ports of the mainboard are there by the dozen, plugged in or not: only real chips (type not 0) count.
    if usb.is_none() && super::text(&folder.join("type")).is_none_or(|kind| kind == "0") {
        return None;
    }
    let name = name(folder);
    let node = root.dev.join(&name);
    let stable = stable_name(root, "serial", &name, usb.as_ref());
    let path = stable.as_ref().unwrap_or(&node);
    let (kind, what, driver) = usb.as_ref().map_or((Kind::Other, "serial port of the machine", None), known);
    let what = match &usb {
        Some(usb) => format!("{what} ({})", usb.words()),
        None => what.to_owned(),
    };
    Some(Found {
        kind,
        what,
        id: usb.as_ref().map_or_else(|| name.clone(), Usb::identity),
        setting: driver.map(|d| format!("{{ kind = \"{d}\", port = {} }}", quoted(&path.to_string_lossy()))),
        sure: false,
        access: check(root, &node),
        node: Some(node),
        stable,
        size_mm: None,
        usb,
    })
}

/// What is probably behind a known chip. Many things are sold with the same chip, so this is never sure.
fn known(usb: &Usb) -> (Kind, &'static str, Option<&'static str>) {
    match (usb.vendor, usb.product) {
        (0x0403, 0x6015) => (Kind::Stage, "serial port, perhaps the interface of Elliptec stages", Some("elliptec")),
        (0x1a86, 0x7523) | (0x2341 | 0x2a03, _) => {
            (Kind::Stage, "serial port, perhaps a GRBL controller", Some("grbl"))
        }
        _ => (Kind::Other, "serial port", None),
    }
}
