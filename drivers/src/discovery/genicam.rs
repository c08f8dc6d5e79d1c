//! GenICam cameras: USB3 Vision in the kernel's device tree, and GigE Vision on the network.
//!
//! Cameras on the network are found by the library aravis, which asks on every network interface and waits a second.

use super::gvcp::{self, Control};
use super::{Access, Found, Kind, Root, Usb, check, entries, name, quoted, routes, text};
use std::net::Ipv4Addr;

/// A camera on a network.
#[derive(Clone, Debug, PartialEq)]
pub struct NetworkCamera {
    /// The camera as a detected device.
    pub found: Found,
    /// Address.
    pub address: Ipv4Addr,
    /// Interface whose network contains the address.
    pub interface: Option<String>,
}

/// A camera that answers, as the library describes it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Answer {
    pub id: String,
    pub address: String,
    pub words: String,
    pub serial: String,
    pub network: bool,
}

/// Cameras that answer; none on a simulated machine, or without the library.
pub(super) fn answers(root: &Root) -> Vec<Answer> {
    if *root != Root::default() {
        return vec![];
    }
    crate::camera::genicam::aravis::list::cameras()
        .into_iter()
        .map(|camera| Answer {
            words: format!("{} {}", camera.vendor, camera.model),
            id: camera.id,
            address: camera.address,
            serial: camera.serial,
            network: camera.network,
        })
        .collect()
}

/// Whether a USB3 Vision camera is connected.
pub(crate) fn has_usb3_vision(root: &Root) -> bool {
    entries(&root.sys.join("bus/usb/devices")).iter().any(|folder| is_usb3_vision(folder))
}

/// Cameras on USB 3. Only the library knows their names for the configuration.
pub(super) fn usb_cameras(root: &Root, answers: &[Answer]) -> Vec<Found> {
    let folders = entries(&root.sys.join("bus/usb/devices"));
    let cameras = folders.iter().filter(|folder| is_usb3_vision(folder)).filter_map(|folder| {
        let device = name(folder);
        Usb::at(&folder.with_file_name(device.split_once(':')?.0))
    });
    cameras.map(|usb| usb_camera(root, usb, answers)).collect()
}

/// Whether this is the control interface of a USB3 Vision camera.
fn is_usb3_vision(interface: &std::path::Path) -> bool {
    let is = |file: &str, value: &str| text(&interface.join(file)).is_some_and(|found| found == value);
    is("bInterfaceClass", "ef") && is("bInterfaceSubClass", "05") && is("bInterfaceProtocol", "00")
}

fn usb_camera(root: &Root, usb: Usb, answers: &[Answer]) -> Found {
    let known = answers.iter().find(|answer| !answer.network && Some(&answer.serial) == usb.serial.as_ref());
    let node = usb.node(root);
    Found {
        kind: Kind::Camera,
        what: format!("USB3 Vision camera {}", usb.words()),
        id: usb.identity(),
        stable: None,
        size_mm: None,
        setting: known.map(|answer| setting(&answer.id)),
        sure: true,
        access: check(root, &node),
        node: Some(node),
        usb: Some(usb),
    }
}

fn setting(id: &str) -> String {
    format!("{{ kind = \"genicam\", device = {} }}", quoted(id))
}

/// Cameras on the network, with the reason if one cannot be opened.
pub(super) fn network_cameras(root: &Root, answers: Vec<Answer>) -> Vec<NetworkCamera> {
    let on_network = answers.into_iter().filter(|answer| answer.network);
    on_network.filter_map(|answer| network_camera(root, answer, gvcp::control)).collect()
}

fn network_camera(root: &Root, answer: Answer, control: fn(Ipv4Addr) -> Control) -> Option<NetworkCamera> {
    let address: Ipv4Addr = answer.address.parse().ok()?;
    let interface = routes::interface(root, address);
    let access = match (control(address), &interface) {
        (Control::Free, _) => Access::Open,
        (Control::Taken, _) => Access::InUse {
            remedy: "end the program that controls the camera; after a crash it is free within some seconds".into(),
        },
        (Control::Silent, None) => Access::Denied {
            remedy: format!(
                "no network interface of this computer has an address in the network of {address}: give one such an \
                 address, or give the camera another one (`arv-tool-0.8 network`)"
            ),
        },
        (Control::Silent, Some(interface)) => Access::Denied {
            remedy: format!("{address} does not answer on {interface}: let UDP port 3956 pass the firewall"),
        },
    };
    let found = Found {
        kind: Kind::Camera,
        what: format!("GigE Vision camera {} at {address}", answer.words),
        id: answer.id.clone(),
        node: None,
        stable: None,
        size_mm: None,
        usb: None,
        setting: Some(setting(&answer.id)),
        sure: true,
        access,
    };
    Some(NetworkCamera { found, address, interface })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answer(address: &str) -> Answer {
        Answer {
            id: "Acme-Eye-7".into(),
            address: address.into(),
            words: "Acme Eye".into(),
            serial: "7".into(),
            network: true,
        }
    }

    #[test]
    fn a_camera_that_cannot_be_opened_says_why() {
        let folder = tempfile::tempdir().unwrap();
        let root = Root::under(folder.path());
        let access = |address, control| network_camera(&root, answer(address), control).unwrap().found.access;
        assert_eq!(access("127.0.0.1", |_| Control::Free), Access::Open);
        assert!(matches!(access("127.0.0.1", |_| Control::Taken), Access::InUse { .. }));
        assert!(access("10.1.2.3", |_| Control::Silent).remedy().unwrap().contains("network of 10.1.2.3"));
        assert!(access("127.0.0.1", |_| Control::Silent).remedy().unwrap().contains("firewall"));
        assert_eq!(network_camera(&root, answer("USB3"), |_| Control::Free), None);
        let found = network_camera(&root, answer("127.0.0.1"), |_| Control::Free).unwrap().found;
        assert_eq!(found.setting.as_deref(), Some("{ kind = \"genicam\", device = \"Acme-Eye-7\" }"));
    }

    #[test]
    fn a_usb_camera_is_named_once_the_library_knows_it() {
        let folder = tempfile::tempdir().unwrap();
        let root = Root::under(folder.path());
        let write = |path: &str, content: &str| {
            let path = root.sys.join("bus/usb/devices").join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, content).unwrap();
        };
        for (file, text) in [("idVendor", "1e10"), ("idProduct", "4000"), ("serial", "7"), ("speed", "5000")] {
            write(&format!("2-1/{file}"), text);
        }
        for (interface, protocol) in [("2-1:1.0", "00"), ("2-1:1.1", "02")] {
            write(&format!("{interface}/bInterfaceClass"), "ef\n");
            write(&format!("{interface}/bInterfaceSubClass"), "05\n");
            write(&format!("{interface}/bInterfaceProtocol"), protocol);
        }
        let found = usb_cameras(&root, &[]);
        assert_eq!(found.len(), 1);
        assert!(found[0].setting.is_none() && found[0].what.contains("USB3 Vision"), "{found:?}");
        let known = Answer { network: false, ..answer("USB3") };
        assert!(usb_cameras(&root, &[known])[0].setting.as_ref().unwrap().contains("Acme-Eye-7"));
    }
}
