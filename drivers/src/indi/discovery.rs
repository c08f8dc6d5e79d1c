//! Devices of INDI servers.

use super::PORT;
use super::xml::{Element, Reader};
use crate::discovery::{Access, Found, Kind, quoted};
use crate::net::{Connection, host_and_port};
use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::time::{Duration, Instant};

/// Time for the list of devices.
const ANSWER: Duration = Duration::from_millis(600);
/// Silence after which the list counts as complete.
const SILENCE: Duration = Duration::from_millis(200);
/// Largest number of devices.
const MAX_DEVICES: usize = 256;
/// Bits of `DRIVER_INTERFACE`.
const CAMERA: u32 = 1 << 1;
const LIGHT_BOX: u32 = 1 << 10;
const ROTATOR: u32 = 1 << 12;

/// Devices of a server and their interfaces; none if it does not answer.
fn devices(address: &str) -> BTreeMap<String, u32> {
    let mut found = BTreeMap::new();
    let Ok((host, port)) = host_and_port(address, PORT) else { return found };
    let Ok(mut connection) = Connection::open(host, port, ANSWER) else { return found };
    if connection.write_all(b"<getProperties version=\"1.7\"/>\n").is_err() {
        return found;
    }
    let (mut reader, mut buffer, begun) = (Reader::default(), [0; 16 * 1024], Instant::now());
    while begun.elapsed() < ANSWER && found.len() < MAX_DEVICES {
        connection.until = Instant::now() + SILENCE;
        let Ok(count @ 1..) = connection.read(&mut buffer) else { break };
        if reader.push(buffer.get(..count).unwrap_or(&buffer)).is_err() {
            break;
        }
        while let Some(element) = reader.next_element() {
            note(&mut found, &element);
        }
    }
    found
}

fn note(found: &mut BTreeMap<String, u32>, element: &Element) {
    let device = element.get("device");
    if device.is_empty() || !element.name.starts_with("def") {
        return;
    }
    let interface = found.entry(device.to_owned()).or_default();
    if element.get("name") == "DRIVER_INFO" {
        let one = element.children.iter().find(|one| one.get("name") == "DRIVER_INTERFACE");
        *interface = one.and_then(|one| one.trimmed().parse().ok()).unwrap_or(0);
    }
}

/// Names of the devices of a server.
pub(crate) fn names(address: &str) -> Vec<String> {
    devices(address).into_keys().map(|name| name.chars().filter(|c| !c.is_control()).take(100).collect()).collect()
}

/// Rotators, cameras and light boxes of the server on this computer.
pub(crate) fn found() -> Vec<Found> {
    found_at(&format!("localhost:{PORT}"))
}

/// Rotators, cameras and light boxes of a server.
pub fn found_at(address: &str) -> Vec<Found> {
    devices(address).iter().filter_map(|(name, interface)| device(address, name, *interface)).collect()
}

fn device(address: &str, name: &str, interface: u32) -> Option<Found> {
    let has = |bit: u32| interface & bit != 0;
    let (kind, word) = match () {
        () if has(CAMERA) => (Kind::Camera, "camera"),
        () if has(ROTATOR) => (Kind::Stage, "rotator"),
        () if has(LIGHT_BOX) => (Kind::Flash, "light box"),
        () => return None,
    };
    let shown: String = name.chars().filter(|c| !c.is_control()).take(100).collect();
    Some(Found {
        kind,
        what: format!("INDI {word} {shown} at {address}"),
        id: format!("{shown} at {address}"),
        node: None,
        stable: None,
        size_mm: None,
        usb: None,
        setting: Some(format!("{{ kind = \"indi\", address = {}, device = {} }}", quoted(address), quoted(name))),
        sure: true,
        access: Access::NotNeeded,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roles_follow_from_interfaces() {
        let role = |interface| device("a", "x \"y\"", interface).map(|found| found.kind);
        // Those of INDI's simulators.
        assert_eq!(role(22), Some(Kind::Camera));
        assert_eq!(role(4096), Some(Kind::Stage));
        assert_eq!(role(33_792), Some(Kind::Flash));
        assert_eq!(role(32), None);
        let setting = device("a", "x \"y\"", 2).unwrap().setting.unwrap();
        assert_eq!(setting, "{ kind = \"indi\", address = \"a\", device = \"x \\\"y\\\"\" }");
    }
}
