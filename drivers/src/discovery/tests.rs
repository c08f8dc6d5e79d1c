use super::*;
use std::os::unix::fs::symlink;
use std::path::Path;

/// A simulated machine.
struct Machine(tempfile::TempDir);

impl Machine {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn root(&self) -> Root {
        Root::under(self.0.path())
    }

    fn write(&self, path: &str, content: impl AsRef<[u8]>) {
        let path = self.0.path().join(path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, content).unwrap();
    }

    fn link(&self, path: &str, to: &str) {
        let path = self.0.path().join(path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        symlink(to, path).unwrap();
    }

    /// Adds a USB device at a port of bus 1 to the tree.
    fn usb(&self, port: &str, numbers: &str, texts: &[(&str, &str)]) -> String {
        let folder = format!("sys/devices/pci/usb1/{port}");
        let (vendor, product) = numbers.split_once(':').unwrap();
        for (file, text) in [("idVendor", vendor), ("idProduct", product), ("busnum", "1"), ("speed", "480")] {
            self.write(&format!("{folder}/{file}"), format!("{text}\n"));
        }
        for (file, text) in texts {
            self.write(&format!("{folder}/{file}"), format!("{text}\n"));
        }
        self.link(&format!("sys/bus/usb/devices/{port}"), &format!("../../../devices/pci/usb1/{port}"));
        folder
    }

    /// Adds a device of a class below a folder of the tree.
    fn class(&self, class: &str, name: &str, on: &str) -> String {
        let folder = format!("{on}/{class}/{name}");
        std::fs::create_dir_all(self.0.path().join(&folder)).unwrap();
        let on = self.0.path().join(on);
        symlink(on, self.0.path().join(&folder).join("device")).unwrap();
        self.link(&format!("sys/class/{class}/{name}"), self.0.path().join(&folder).to_str().unwrap());
        folder
    }
}

fn find<'a>(found: &'a [Found], what: &str) -> &'a Found {
    found.iter().find(|f| f.what.contains(what)).unwrap_or_else(|| panic!("no {what} in {found:#?}"))
}

#[test]
fn an_empty_machine_has_no_devices() {
    assert!(discover(&Machine::new().root()).is_empty());
    // Discovery must not fail on any machine.
    discover(&Root::default());
}

#[test]
fn an_interface_of_stages_is_found_by_its_chip() {
    let machine = Machine::new();
    let texts = [("manufacturer", "FTDI"), ("product", "FT230X Basic UART"), ("serial", "DK0AHAEM")];
    let usb = machine.usb("1-4", "0403:6015", &texts);
    machine.class("tty", "ttyUSB0", &format!("{usb}/1-4:1.0"));
    machine.write("dev/ttyUSB0", "");
    machine.link("dev/serial/by-id/usb-FTDI_FT230X_Basic_UART_DK0AHAEM-if00-port0", "../../ttyUSB0");
    let found = discover(&machine.root());
    let stage = find(&found, "Elliptec");
    assert_eq!((stage.kind, stage.sure, &stage.access), (Kind::Stage, false, &Access::Open));
    assert_eq!(stage.id, "0403:6015 DK0AHAEM");
    let setting = stage.setting.as_ref().unwrap();
    assert!(setting.contains("kind = \"elliptec\"") && setting.contains("by-id/usb-FTDI"), "{setting}");
    assert_eq!(found.len(), 1);
}

/// Cheap adapters share one name, so only the port distinguishes them.
#[test]
fn adapters_without_serial_number_are_named_by_their_place() {
    let machine = Machine::new();
    for n in 0..2 {
        let usb = machine.usb(&format!("1-{n}"), "1a86:7523", &[("product", "USB Serial")]);
        machine.class("tty", &format!("ttyUSB{n}"), &format!("{usb}/1-{n}:1.0"));
        machine.link(&format!("dev/serial/by-path/pci-usb-0:{n}:1.0-port0"), &format!("../../ttyUSB{n}"));
    }
    machine.link("dev/serial/by-id/usb-1a86_USB_Serial-if00-port0", "../../ttyUSB1");
    let found = discover(&machine.root());
    let settings: Vec<&str> = found.iter().filter_map(|f| f.setting.as_deref()).collect();
    assert!(settings[0].contains("\"grbl\"") && settings[0].contains("usb-0:0:1.0-port0"), "{settings:?}");
    assert!(settings[1].contains("usb-0:1:1.0-port0"), "{settings:?}");
}

#[test]
fn ports_without_anything_behind_are_left_out() {
    let machine = Machine::new();
    machine.write("sys/class/tty/tty0/uevent", "");
    let port = machine.class("tty", "ttyS0", "sys/devices/platform/serial8250");
    machine.write(&format!("{port}/type"), "0\n");
    let port = machine.class("tty", "ttyS1", "sys/devices/platform/serial8251");
    machine.write(&format!("{port}/type"), "4\n");
    let found = discover(&machine.root());
    assert_eq!(found.iter().map(|f| f.id.as_str()).collect::<Vec<_>>(), ["ttyS1"]);
}

#[test]
fn a_relay_is_distinguished_from_others_with_its_ids_and_listed_without_a_node() {
    let machine = Machine::new();
    for (n, product) in ["USBRelay2", "Joystick"].iter().enumerate() {
        let usb = machine.usb(&format!("1-{n}"), "16c0:05df", &[("product", product)]);
        let hid = format!("{usb}/1-{n}:1.0/0003:16C0:05DF.000{n}");
        machine.class("hidraw", &format!("hidraw{n}"), &hid);
        let text = format!("HID_ID=0003:000016C0:000005DF\nHID_NAME=www.dcttech.com {product}\nHID_UNIQ=\n");
        machine.write(&format!("{hid}/uevent"), text);
    }
    let found = discover(&machine.root());
    assert_eq!(found.len(), 1);
    let relay = find(&found, "relay");
    assert_eq!((relay.kind, relay.id.as_str()), (Kind::Flash, "16c0:05df at 1-0"));
    assert!(matches!(relay.access, Access::NoNode { .. }), "listed, though it cannot be opened");
    assert!(relay.setting.as_ref().unwrap().contains("kind = \"relay\""));
}

#[test]
fn a_lamp_is_named_by_its_serial_number() {
    let machine = Machine::new();
    let usb = machine.usb("1-2", "27b8:01ed", &[("product", "blink(1) mk2"), ("serial", "20001234")]);
    machine.class("hidraw", "hidraw4", &format!("{usb}/hid"));
    let text = "HID_ID=0003:000027B8:000001ED\nHID_NAME=ThingM blink(1) mk2\nHID_UNIQ=20001234\n";
    machine.write(&format!("{usb}/hid/uevent"), text);
    machine.write("dev/hidraw4", "");
    let found = discover(&machine.root());
    assert_eq!(found[0].setting.as_deref(), Some("{ kind = \"blink1\", serial = \"20001234\" }"));
}

#[test]
fn a_camera_is_listed_once() {
    let machine = Machine::new();
    let usb = machine.usb("1-7", "046d:085e", &[("product", "BRIO"), ("serial", "A1")]);
    for (index, node) in ["video0", "video1"].iter().enumerate() {
        let folder = machine.class("video4linux", node, &format!("{usb}/1-7:1.0"));
        machine.write(&format!("{folder}/index"), format!("{index}\n"));
        machine.write(&format!("{folder}/name"), "Logitech BRIO\n");
        machine.write(&format!("dev/{node}"), "");
    }
    let found = discover(&machine.root());
    assert_eq!(found.len(), 1);
    assert_eq!(
        (found[0].kind, found[0].what.as_str(), found[0].id.as_str()),
        (Kind::Camera, "Logitech BRIO", "046d:085e A1")
    );
}

/// A monitor "Panel 24" by ABC of 527 mm × 296 mm with 1920 × 1080 pixels.
fn edid() -> Vec<u8> {
    let mut block = vec![0u8; 128];
    block[1..7].fill(0xff);
    block[8..16].copy_from_slice(&[0x04, 0x43, 0x34, 0x12, 7, 0, 0, 0]);
    let timing = [2, 0x3a, 0x80, 0x18, 0x71, 0x38, 0x2d, 0x40, 0x58, 0x2c, 0x45, 0, 0x0f, 0x28, 0x21, 0, 0, 0x1e];
    block[54..72].copy_from_slice(&timing);
    block[72..90].copy_from_slice(b"\0\0\0\xfc\0Panel 24\n    ");
    block[90..108].copy_from_slice(b"\0\0\0\xff\0S123\n        ");
    block[127] = block.iter().fold(0u8, |sum, b| sum.wrapping_add(*b)).wrapping_neg();
    block
}

#[test]
fn a_monitor_says_its_size_and_empty_outputs_are_left_out() {
    let machine = Machine::new();
    machine.write("sys/class/drm/card0-HDMI-A-1/status", "connected\n");
    machine.write("sys/class/drm/card0-HDMI-A-1/edid", edid());
    machine.write("sys/class/drm/card0-DP-1/status", "disconnected\n");
    machine.write("sys/class/drm/card0-DP-2/status", "connected\n");
    machine.write("sys/class/drm/version", "drm\n");
    machine.write("dev/dri/card0", "");
    let found = discover(&machine.root());
    assert_eq!(found.len(), 2);
    let panel = find(&found, "Panel 24");
    assert_eq!(
        (panel.what.as_str(), panel.id.as_str()),
        ("monitor Panel 24 on HDMI-A-1, 527 mm × 296 mm", "ABC 1234 Panel 24 S123")
    );
    assert!(panel.setting.as_ref().unwrap().contains("HDMI-A-1"));
}

#[test]
fn own_electronics_are_found_by_number() {
    let machine = Machine::new();
    let usb = machine.usb("1-9", "1209:0001", &[("product", "Nacre flash"), ("serial", "7")]);
    machine.write(&format!("{usb}/devnum"), "12\n");
    let found = discover(&machine.root());
    assert_eq!((found[0].kind, found[0].sure), (Kind::Flash, true));
    assert!(found[0].node.as_ref().unwrap().ends_with(Path::new("dev/bus/usb/001/012")));
}

#[test]
fn texts_with_quotes_stay_one_text() {
    assert_eq!(quoted("a\"b\\c\n"), "\"a\\\"b\\\\c\\u000A\"");
}
