//! Digital cameras at USB cables: Picture Transfer Protocol in the kernel's device tree, and models from libgphoto2.

use super::{Access, Found, Kind, Root, Usb, check, entries, name, quoted, text};
use crate::camera::gphoto2::{GVFS, library};

/// Names of processes that open digital cameras, as the kernel shortens them, with their full names.
const OTHERS: [(&str, &str); 4] =
    [("gvfs-gphoto2-vo", GVFS), ("gvfsd-gphoto2", "gvfsd-gphoto2"), ("gphoto2", "gphoto2"), ("entangle", "entangle")];

/// Manufacturers of cameras. Telephones also offer this protocol.
const MAKERS: [&str; 9] = ["canon", "nikon", "sony", "fuji", "panasonic", "olympus", "pentax", "leica", "sigma"];

/// Digital cameras; on a simulated machine only those in its device tree.
pub(super) fn cameras(root: &Root) -> Vec<Found> {
    let known = if *root == Root::default() { library::cameras() } else { vec![] };
    let other = other_program(root);
    let mut found: Vec<Found> = ptp_devices(root).into_iter().map(|usb| at_usb(root, usb, &known, other)).collect();
    let listed = |port: &str| found.iter().filter_map(|f| f.usb.as_ref()).any(|usb| port_of(usb) == port);
    let more: Vec<Found> = known.iter().filter(|c| !listed(&c.port)).map(elsewhere).collect();
    found.extend(more);
    found
}

/// USB devices with an interface for still images (class 6, subclass 1, protocol 1).
fn ptp_devices(root: &Root) -> Vec<Usb> {
    let folders = entries(&root.sys.join("bus/usb/devices"));
    let is_ptp = |folder: &std::path::Path| {
        let is = |file: &str, value: &str| text(&folder.join(file)).as_deref() == Some(value);
        is("bInterfaceClass", "06") && is("bInterfaceSubClass", "01") && is("bInterfaceProtocol", "01")
    };
    let devices = folders.iter().filter(|folder| is_ptp(folder)).filter_map(|folder| {
        let interface = name(folder);
        Usb::at(&folder.with_file_name(interface.split_once(':')?.0))
    });
    devices.collect()
}

/// Port in the notation of the library.
fn port_of(usb: &Usb) -> String {
    format!("usb:{:03},{:03}", usb.bus, usb.address)
}

fn at_usb(root: &Root, usb: Usb, known: &[library::Detected], other: Option<&str>) -> Found {
    let node = usb.node(root);
    let model = known.iter().find(|camera| camera.port == port_of(&usb)).map(|camera| camera.model.clone());
    let access = match (check(root, &node), other) {
        (Access::Open, Some(program)) => Access::InUse {
            remedy: format!("{program} may hold the camera: end it (`pkill {program}`) before a session"),
        },
        (access, _) => access,
    };
    let maker = model.clone().unwrap_or_else(|| usb.words()).to_ascii_lowercase();
    let device = model.as_ref().map_or_else(String::new, |model| format!(", device = {}", quoted(model)));
    Found {
        kind: Kind::Camera,
        what: format!("digital camera {}", model.unwrap_or_else(|| usb.words())),
        id: usb.identity(),
        stable: None,
        size_mm: None,
        setting: Some(format!("{{ kind = \"gphoto2\"{device} }}")),
        sure: MAKERS.iter().any(|known| maker.contains(known)),
        access,
        node: Some(node),
        usb: Some(usb),
    }
}

/// A camera that only the library knows.
fn elsewhere(camera: &library::Detected) -> Found {
    Found {
        kind: Kind::Camera,
        what: format!("digital camera {} at {}", camera.model, camera.port),
        id: camera.port.clone(),
        stable: None,
        size_mm: None,
        setting: Some(format!("{{ kind = \"gphoto2\", device = {} }}", quoted(&camera.model))),
        sure: false,
        access: Access::NotNeeded,
        node: None,
        usb: None,
    }
}

/// A running program that opens digital cameras.
fn other_program(root: &Root) -> Option<&'static str> {
    let processes = entries(&root.proc);
    let numbered = processes.iter().filter(|folder| name(folder).bytes().all(|b| b.is_ascii_digit()));
    numbered
        .filter_map(|folder| text(&folder.join("comm")))
        .find_map(|comm| OTHERS.iter().find(|(short, _)| *short == comm).map(|(_, program)| *program))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn cameras_of_the_device_tree_are_found_with_the_program_that_holds_them() {
        let folder = tempfile::tempdir().unwrap();
        let root = Root::under(folder.path());
        let write = |path: &str, content: &str| {
            let path = folder.path().join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, content).unwrap();
        };
        for (file, content) in [
            ("idVendor", "04b0"),
            ("idProduct", "0437"),
            ("manufacturer", "NIKON"),
            ("product", "NIKON DSC D750"),
            ("serial", "000006012345"),
            ("busnum", "1"),
            ("devnum", "5"),
        ] {
            write(&format!("sys/bus/usb/devices/1-2/{file}"), content);
        }
        assert!(cameras(&root).is_empty());
        for (file, content) in [("bInterfaceClass", "06"), ("bInterfaceSubClass", "01"), ("bInterfaceProtocol", "01")] {
            write(&format!("sys/bus/usb/devices/1-2:1.0/{file}"), content);
        }
        let found = cameras(&root);
        assert!(found.len() == 1 && found[0].sure && found[0].what.contains("D750"), "{found:?}");
        assert!(matches!(found[0].access, Access::NoNode { .. }));
        write("dev/bus/usb/001/005", "");
        assert_eq!(cameras(&root)[0].access, Access::Open);
        write("proc/77/comm", "gvfs-gphoto2-vo\n");
        let remedy = cameras(&root)[0].access.remedy().unwrap().to_owned();
        assert!(remedy.contains(GVFS), "{remedy}");
    }
}
