//! Serial ports with a device behind them.

use super::{Found, Kind, Root, Usb, check, entries, name, quoted, stable_name};
use std::path::Path;

/// Serial ports, without the kernel's placeholders.
pub(super) fn ports(root: &Root) -> Vec<Found> {
    entries(&root.sys.join("class/tty")).iter().filter_map(|folder| port(root, folder)).collect()
}

fn port(root: &Root, folder: &Path) -> Option<Found> {
    let device = folder.join("device");
    if !device.exists() {
        return None;
    }
    let usb = Usb::of(root, &device);
    // The kernel lists dozens of mainboard ports even without hardware. Only real chips (type not 0) count.
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

/// Probable device behind a known chip. Many products use the same chip, so the result is never certain.
fn known(usb: &Usb) -> (Kind, &'static str, Option<&'static str>) {
    match (usb.vendor, usb.product) {
        (0x0403, 0x6015) => (Kind::Stage, "serial port, perhaps the interface of Elliptec stages", Some("elliptec")),
        (0x1a86, 0x7523) => {
            (Kind::Stage, "serial port, perhaps a GRBL controller or an LCUS relay (kind = \"lcus\")", Some("grbl"))
        }
        (0x2341 | 0x2a03, _) => (Kind::Stage, "serial port, perhaps a GRBL controller", Some("grbl")),
        _ => (Kind::Other, "serial port", None),
    }
}
