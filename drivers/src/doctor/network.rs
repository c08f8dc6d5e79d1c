//! Network and USB memory for GenICam cameras.

use super::{Check, Health};
use crate::discovery::{Found, Kind, NetworkCamera, Root, text};
use std::collections::BTreeMap;

/// Packets of this size in bytes (jumbo frames) need a sixth of the interrupts of ordinary ones.
const JUMBO: u64 = 9000;
/// Gigabit Ethernet in Mbit/s.
const GIGABIT: f64 = 1000.0;
/// Receive buffer that holds a picture of 8 megapixels with one byte each, in bytes.
const RECEIVE_BUFFER: u64 = 8 << 20;
/// Memory of the kernel for USB transfers, in MiB. Frames of USB3 Vision cameras are queued in it.
const USB_MEMORY_MIB: u64 = 200;

/// Checks each network interface with cameras: packet size, speed, receive buffer, and cameras that share it.
pub(super) fn cameras(root: &Root, cameras: &[NetworkCamera]) -> Vec<Check> {
    let mut interfaces: BTreeMap<&str, Vec<&NetworkCamera>> = BTreeMap::new();
    for camera in cameras {
        if let Some(interface) = &camera.interface {
            interfaces.entry(interface).or_default().push(camera);
        }
    }
    let mut checks: Vec<Check> = interfaces.iter().map(|(name, cameras)| interface(root, name, cameras)).collect();
    if !checks.is_empty() {
        checks.push(receive_buffer(root));
    }
    checks
}

fn interface(root: &Root, name: &str, cameras: &[&NetworkCamera]) -> Check {
    let folder = root.sys.join("class/net").join(name);
    let number = |file: &str| text(&folder.join(file)).and_then(|t| t.parse::<f64>().ok()).filter(|v| *v > 0.0);
    let title = format!("camera network {name}");
    let (speed, packets) = (number("speed"), number("mtu"));
    let warn = |found: String, remedy: String| Check::not_ok(&title, Health::Warn, found, remedy);
    if let Some(speed) = speed.filter(|speed| *speed < GIGABIT) {
        let found = format!("{speed:.0} Mbit/s, {:.0} MB of pictures per second", 0.118 * speed);
        return warn(found, "use a gigabit network socket, switch and cable (Cat 5e), or set a lower fps".into());
    }
    if cameras.len() > 1 {
        let names: Vec<&str> = cameras.iter().map(|camera| camera.found.id.as_str()).collect();
        let found = format!("{} cameras share the interface: {}", names.len(), names.join(", "));
        return warn(found, "give each camera a network socket of this computer, or set a lower fps for each".into());
    }
    match packets {
        Some(mtu) if mtu < JUMBO as f64 => warn(
            format!("packets of at most {mtu:.0} bytes, which large pictures lose"),
            format!(
                "enable jumbo frames: `sudo ip link set {name} mtu {JUMBO}`, on the switch too; the driver uses them if \
                 the camera does"
            ),
        ),
        _ => {
            let speed = speed.map_or_else(String::new, |speed| format!("{speed:.0} Mbit/s, "));
            let packets = packets.map_or_else(|| "of unknown size".into(), |mtu| format!("of up to {mtu:.0} bytes"));
            Check::ok(&title, format!("{speed}packets {packets}"))
        }
    }
}

fn receive_buffer(root: &Root) -> Check {
    let title = "receive buffer";
    let bytes = text(&root.proc.join("sys/net/core/rmem_max")).and_then(|t| t.parse::<u64>().ok());
    match bytes {
        Some(bytes) if bytes < RECEIVE_BUFFER => Check::not_ok(
            title,
            Health::Warn,
            format!("{} KiB, less than a picture", bytes >> 10),
            "run `sudo sysctl -w net.core.rmem_max=33554432`, and add the value to /etc/sysctl.d to keep it",
        ),
        Some(bytes) => Check::ok(title, format!("{} MiB", bytes >> 20)),
        None => Check::ok(title, "of unknown size"),
    }
}

/// Checks the kernel's memory for USB transfers, if there is a USB3 Vision camera.
pub(super) fn usb_memory(root: &Root, found: &[Found]) -> Option<Check> {
    let usb3_vision = |f: &Found| f.kind == Kind::Camera && f.what.starts_with("USB3 Vision");
    if !found.iter().any(usb3_vision) {
        return None;
    }
    let path = root.sys.join("module/usbcore/parameters/usbfs_memory_mb");
    let mib: u64 = text(&path)?.parse().ok()?;
    // 0 means no limit.
    let title = "USB memory";
    Some(if mib == 0 || mib >= USB_MEMORY_MIB {
        Check::ok(title, format!("{mib} MiB"))
    } else {
        let remedy =
            format!("run `echo 1000 | sudo tee {}`, or boot with usbcore.usbfs_memory_mb=1000", path.display());
        Check::not_ok(title, Health::Warn, format!("{mib} MiB, less than a queue of large pictures"), remedy)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discovery::Access;
    use std::net::Ipv4Addr;

    fn camera(interface: &str) -> NetworkCamera {
        let found = Found {
            kind: Kind::Camera,
            what: "USB3 Vision camera".into(),
            id: format!("camera on {interface}"),
            node: None,
            stable: None,
            size_mm: None,
            usb: None,
            setting: None,
            sure: true,
            access: Access::Open,
        };
        NetworkCamera { found, address: Ipv4Addr::LOCALHOST, interface: Some(interface.into()) }
    }

    #[test]
    fn slow_and_shared_networks_and_small_packets_are_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let root = Root::under(folder.path());
        assert!(cameras(&root, &[]).is_empty());
        for (name, speed, mtu) in [("slow", "100", "1500"), ("small", "1000", "1500"), ("good", "2500", "9000")] {
            let folder = root.sys.join("class/net").join(name);
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(folder.join("speed"), speed).unwrap();
            std::fs::write(folder.join("mtu"), mtu).unwrap();
        }
        let checks = |names: &[&str]| cameras(&root, &names.iter().map(|name| camera(name)).collect::<Vec<_>>());
        let found = checks(&["slow", "small", "good"]);
        let told: Vec<_> = found.iter().map(|c| (c.name.as_str(), c.ok)).collect();
        assert_eq!(told[0], ("camera network good", Health::Ok));
        assert_eq!(told[1], ("camera network slow", Health::Warn));
        assert!(found[1].found.contains("12 MB"), "{found:?}");
        assert!(found[2].remedy.as_ref().unwrap().contains("ip link set small mtu 9000"), "{found:?}");
        assert!(checks(&["good", "good"])[0].found.contains("2 cameras share"));
    }

    #[test]
    fn small_buffers_are_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let root = Root::under(folder.path());
        let put = |path: std::path::PathBuf, value: &str| {
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, value).unwrap();
        };
        put(root.proc.join("sys/net/core/rmem_max"), "212992\n");
        put(root.sys.join("module/usbcore/parameters/usbfs_memory_mb"), "16\n");
        assert!(receive_buffer(&root).remedy.unwrap().contains("rmem_max"));
        assert_eq!(usb_memory(&root, &[]), None);
        assert_eq!(usb_memory(&root, &[camera("x").found]).unwrap().ok, Health::Warn);
        put(root.sys.join("module/usbcore/parameters/usbfs_memory_mb"), "0\n");
        assert_eq!(usb_memory(&root, &[camera("x").found]).unwrap().ok, Health::Ok);
    }
}
