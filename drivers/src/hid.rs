//! HID devices at the report level: on a device node, or on the socket of an emulated device (see
//! [`crate::socket_transport`]).

use crate::discovery::{HidNode, Root, hid_nodes, require};
use crate::socket_transport::{self, SocketTransport, Transfer};
use crate::{Class, DeviceError, DeviceResult};
use std::ffi::CString;
use std::io;
use std::path::Path;

/// Maximum length of a report.
pub const MAX_REPORT: usize = 1024;

/// A device that exchanges reports. The first byte of each report is its ID, 0 if the device does not number its
/// reports.
pub trait Reports: Send {
    /// Sends an output report.
    ///
    /// # Errors
    /// `Lost` if the device is gone or silent, `Retry` if it refuses.
    fn write(&mut self, report: &[u8]) -> DeviceResult<()>;

    /// Sends a feature report.
    ///
    /// # Errors
    /// As [`Reports::write`].
    fn set_feature(&mut self, report: &[u8]) -> DeviceResult<()>;

    /// Reads the feature report of this ID; returns its length.
    ///
    /// # Errors
    /// As [`Reports::write`].
    fn feature(&mut self, id: u8, report: &mut [u8]) -> DeviceResult<usize>;
}

/// Opens a device by its path: a node such as `/dev/hidraw0`, or `unix:/path`.
///
/// # Errors
/// `Setup` if the device is missing or may not be opened; the message contains the remedy.
pub fn open(device: &str, path: &str) -> DeviceResult<Box<dyn Reports>> {
    if let Some(socket) = path.strip_prefix(socket_transport::PREFIX) {
        let transport = SocketTransport::open(Path::new(socket)).map_err(|e| {
            cannot_open(device, path, e.to_string()).remedy("start the emulated device that this path belongs to")
        })?;
        return Ok(Box::new(Socket { transport, device: device.into() }));
    }
    let missing = "plug the device in, or correct `path`; `nacre devices` lists devices";
    require(path, missing, |got| cannot_open(device, path, got))?;
    let refuse = |got: String| cannot_open(device, path, got).remedy("give the path of a hidraw node");
    let name = CString::new(path).map_err(|e| refuse(e.to_string()))?;
    let api = hidapi::HidApi::new().map_err(|e| refuse(e.to_string()))?;
    let opened = api.open_path(&name).map_err(|e| refuse(e.to_string()))?;
    Ok(Box::new(Hidraw { hid: opened, device: device.into(), path: path.into() }))
}

fn cannot_open(device: &str, path: &str, got: String) -> DeviceError {
    DeviceError::new(device, format!("open {path}"), "a device that may be opened", got).class(Class::Setup)
}

/// Nodes of devices with these IDs whose name contains `name`; none if the kernel lacks HID.
pub fn find(root: &Root, numbers: (u16, u16), name: &str) -> Vec<HidNode> {
    let fits = |hid: &HidNode| (hid.vendor, hid.product) == numbers && hid.name.contains(name);
    hid_nodes(root).into_iter().filter(fits).collect()
}

/// The only element of a list of candidates.
///
/// # Errors
/// `Setup` if there is none or more than one; `named` gives the name of each in the settings.
pub fn only<T>(device: &str, mut found: Vec<T>, named: impl Fn(&T) -> String) -> DeviceResult<T> {
    let wrong = |got: String, remedy: String| {
        Err(DeviceError::new(device, "find it", "one device", got).remedy(remedy).class(Class::Setup))
    };
    match (found.pop(), found.is_empty()) {
        (Some(one), true) => Ok(one),
        (None, _) => wrong("none".into(), "plug it in; `nacre devices` lists what is there".into()),
        (Some(last), false) => {
            found.push(last);
            let names: Vec<String> = found.iter().take(16).map(named).collect();
            wrong(format!("{}", found.len()), format!("say which one in its settings: {}", names.join(" or ")))
        }
    }
}

/// A device node of the kernel.
struct Hidraw {
    hid: hidapi::HidDevice,
    device: String,
    path: String,
}

impl Hidraw {
    /// The library reports most errors as text only.
    fn checked<T>(&self, command: &str, result: hidapi::HidResult<T>) -> DeviceResult<T> {
        result.map_err(|error| {
            let text = error.to_string();
            let there = Path::new(&self.path).exists();
            let kind = if there && text.contains("EPIPE") { io::ErrorKind::InvalidInput } else { io::ErrorKind::Other };
            socket_transport::failed(&self.device, command, &io::Error::new(kind, text))
        })
    }
}

impl Reports for Hidraw {
    fn write(&mut self, report: &[u8]) -> DeviceResult<()> {
        let sent = self.checked("take a report", self.hid.write(report))?;
        if sent < report.len() {
            let (expected, got) = (format!("{} bytes taken", report.len()), format!("{sent}"));
            return Err(DeviceError::new(&self.device, "take a report", expected, got).class(Class::Retry));
        }
        Ok(())
    }

    fn set_feature(&mut self, report: &[u8]) -> DeviceResult<()> {
        self.checked("take a feature report", self.hid.send_feature_report(report))
    }

    fn feature(&mut self, id: u8, report: &mut [u8]) -> DeviceResult<usize> {
        if let Some(first) = report.first_mut() {
            *first = id;
        }
        let got = self.checked("give a feature report", self.hid.get_feature_report(report))?;
        Ok(got.min(report.len()))
    }
}

/// An emulated device.
struct Socket {
    transport: SocketTransport,
    device: String,
}

impl Socket {
    fn transfer(&mut self, command: &str, kind: Transfer, payload: &[u8]) -> DeviceResult<Vec<u8>> {
        self.transport.transfer(kind, payload).map_err(|e| socket_transport::failed(&self.device, command, &e))
    }
}

impl Reports for Socket {
    fn write(&mut self, report: &[u8]) -> DeviceResult<()> {
        self.transfer("take a report", Transfer::Output, report).map(drop)
    }

    fn set_feature(&mut self, report: &[u8]) -> DeviceResult<()> {
        self.transfer("take a feature report", Transfer::SetFeature, report).map(drop)
    }

    fn feature(&mut self, id: u8, report: &mut [u8]) -> DeviceResult<usize> {
        let [low, high] = (report.len().min(MAX_REPORT) as u16).to_le_bytes();
        let got = self.transfer("give a feature report", Transfer::Feature, &[id, low, high])?;
        let length = got.len().min(report.len());
        report[..length].copy_from_slice(&got[..length]);
        Ok(length)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_machine_without_hid_has_no_devices() {
        let empty = tempfile::tempdir().unwrap();
        assert!(find(&Root::under(empty.path()), (0x16c0, 0x05df), "").is_empty());
        let error = only("relay", Vec::<u8>::new(), |_| String::new()).unwrap_err();
        assert_eq!((error.class, &*error.got), (Class::Setup, "none"));
    }

    #[test]
    fn several_are_named_for_the_settings() {
        assert_eq!(only("relay", vec![7], |_| String::new()), Ok(7));
        let error = only("relay", vec!["A", "B"], |s| format!("serial = \"{s}\"")).unwrap_err();
        assert_eq!(error.class, Class::Setup);
        assert!(error.remedy.contains("serial = \"A\" or serial = \"B\""), "{error}");
    }

    #[test]
    fn missing_devices_have_a_remedy() {
        for path in ["/dev/hidraw-none", "unix:/no/such/socket", "/dev/null", "/dev/nu\0ll", ""] {
            let error = open("relay", path).err().unwrap();
            assert_eq!(error.class, Class::Setup, "{error}");
            assert!(error.remedy.len() > 10, "{error}");
        }
    }
}
