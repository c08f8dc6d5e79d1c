//! USB port of a device, and a reset that replaces unplugging.

use std::path::{Path, PathBuf};

/// The folder in sysfs of the device behind a node in /dev of the given class.
pub fn sysfs_device(class: &str, node: &Path) -> Option<PathBuf> {
    Path::new("/sys/class").join(class).join(node.file_name()?).join("device").canonicalize().ok()
}

/// The USB device that `place` in sysfs belongs to: the nearest parent folder with a USB address.
fn usb_device(place: &Path) -> Option<&Path> {
    place.ancestors().take(32).find(|folder| folder.join("busnum").is_file() && folder.join("devnum").is_file())
}

fn attribute(device: &Path, name: &str) -> Option<String> {
    let text = std::fs::read_to_string(device.join(name)).ok()?;
    let text: String = text.trim().chars().filter(|c| !c.is_control()).take(128).collect();
    (!text.is_empty()).then_some(text)
}

/// Vendor, product and serial number of the USB device at `place` in sysfs. The port replaces a missing serial number.
pub fn usb_identity(place: &Path) -> Option<String> {
    let device = usb_device(place)?;
    let serial = attribute(device, "serial")
        .or_else(|| Some(format!("at {}", device.file_name()?.to_string_lossy())))
        .unwrap_or_default();
    Some(format!("{}:{} {serial}", attribute(device, "idVendor")?, attribute(device, "idProduct")?))
}

/// Bus and address of the USB device at `place` in sysfs.
pub fn usb_address(place: &Path) -> Option<(u8, u8)> {
    let device = usb_device(place)?;
    Some((attribute(device, "busnum")?.parse().ok()?, attribute(device, "devnum")?.parse().ok()?))
}

/// Resets a USB device, which is then enumerated again.
///
/// # Errors
/// The reason for the user, if that is not possible.
pub fn reset((bus, address): (u8, u8)) -> Result<(), String> {
    use rusb::UsbContext;
    let why = |e: rusb::Error| match e {
        rusb::Error::Access => format!("this user may not write to /dev/bus/usb/{bus:03}/{address:03}"),
        e => e.to_string(),
    };
    let devices = rusb::Context::new().and_then(|context| context.devices()).map_err(why)?;
    let found = devices.iter().find(|d| (d.bus_number(), d.address()) == (bus, address));
    match found.ok_or("it is no longer on its USB bus")?.open().and_then(|handle| handle.reset()) {
        // The device has a new address, as intended.
        Ok(()) | Err(rusb::Error::NotFound | rusb::Error::NoDevice) => Ok(()),
        Err(e) => Err(why(e)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_is_found_above_its_interface() {
        let root = std::env::temp_dir().join(format!("nacre-usb-{}", std::process::id()));
        let interface = root.join("usb1/1-4/1-4:1.0");
        std::fs::create_dir_all(&interface).unwrap();
        let write = |name: &str, text: &str| std::fs::write(root.join("usb1/1-4").join(name), text).unwrap();
        assert_eq!(usb_address(&interface), None);
        for (name, text) in [("busnum", "1\n"), ("devnum", "12\n"), ("idVendor", "046d\n"), ("idProduct", "082d\n")] {
            write(name, text);
        }
        assert_eq!(usb_address(&interface), Some((1, 12)));
        assert_eq!(usb_identity(&interface).as_deref(), Some("046d:082d at 1-4"));
        write("serial", "A\u{7}B12\n");
        assert_eq!(usb_identity(&interface).as_deref(), Some("046d:082d AB12"));
        write("devnum", "many\n");
        assert_eq!(usb_address(&interface), None);
        std::fs::remove_dir_all(&root).unwrap();
    }

    #[test]
    fn a_device_that_is_not_there_is_not_reset() {
        assert!(reset((255, 255)).is_err());
    }
}
