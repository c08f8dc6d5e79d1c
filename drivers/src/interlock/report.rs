//! A contact at a HID device, such as a microcontroller with V-USB, read as a bit of a feature report.
//!
//! The first byte of the report repeats its number, as HID requires.

use super::Input;
use crate::discovery::Root;
use crate::hid::{self, MAX_REPORT, Reports};
use crate::{Class, DeviceError, DeviceResult};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Highest index of the byte with the bit: feature reports of V-USB devices are short.
const MAX_BYTE: u16 = 255;

/// A HID device and the bit of its contact.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Device node, such as `/dev/hidraw0`, or `unix:/path` for an emulated one; default: found by vendor and product.
    #[serde(default)]
    pub path: Option<String>,
    /// USB vendor number.
    #[serde(default = "vendor")]
    pub vendor: u16,
    /// USB product number.
    #[serde(default = "product")]
    pub product: u16,
    /// Part of the product's name: V-USB devices share their numbers.
    #[serde(default)]
    pub product_name: String,
    /// Number of the feature report; 0 if the device does not number its reports.
    #[serde(default = "one_u8")]
    pub report: u8,
    /// Index of the byte in the report, 1 to 255; byte 0 is the number of the report.
    #[serde(default = "one_u16")]
    pub byte: u16,
    /// Bit in the byte, 0 (lowest) to 7.
    #[serde(default)]
    pub bit: u8,
}

/// Vendor number of HID devices with V-USB.
fn vendor() -> u16 {
    0x16c0
}

/// Product number of HID devices with V-USB.
fn product() -> u16 {
    0x05df
}

fn one_u8() -> u8 {
    1
}

fn one_u16() -> u16 {
    1
}

impl Settings {
    pub(super) fn check(&self) -> Result<(), String> {
        if !(1..=MAX_BYTE).contains(&self.byte) {
            return Err(format!("driver.byte is {}; give 1 to {MAX_BYTE}", self.byte));
        }
        if self.bit > 7 {
            return Err(format!("driver.bit is {}; give 0 to 7", self.bit));
        }
        if self.path.is_none() && (self.vendor, self.product) == (vendor(), product()) && self.product_name.is_empty() {
            return Err("driver has neither path nor product_name; V-USB devices share the numbers 16c0:05df".into());
        }
        Ok(())
    }

    pub(super) fn place(&self) -> String {
        match &self.path {
            Some(path) => format!("bit {} of {path}", self.bit),
            None => format!("bit {} of {:04x}:{:04x} {}", self.bit, self.vendor, self.product, self.product_name),
        }
    }
}

/// Bit of a feature report; `None` if the report has another number or is too short.
pub fn level(report: &[u8], number: u8, byte: u16, bit: u8) -> Option<bool> {
    let bits = *report.get(usize::from(byte).max(1)).filter(|_| report.first() == Some(&number))?;
    (bit < 8).then(|| bits >> bit & 1 == 1)
}

/// Opens the HID device.
pub(super) fn open(device: &str, settings: &Settings) -> DeviceResult<Box<dyn Input>> {
    let path = match &settings.path {
        Some(path) => path.clone(),
        None => {
            let found = hid::find(&Root::default(), (settings.vendor, settings.product), &settings.product_name);
            let nodes = found.into_iter().map(|hid| hid.node.to_string_lossy().into_owned()).collect();
            hid::only(device, nodes, |node: &String| format!("path = \"{node}\""))?
        }
    };
    let reports = hid::open(device, &path)?;
    Ok(Box::new(HidInput { device: device.into(), reports, settings: settings.clone() }))
}

struct HidInput {
    device: String,
    reports: Box<dyn Reports>,
    settings: Settings,
}

impl Input for HidInput {
    fn is_high(&mut self) -> DeviceResult<bool> {
        let Settings { report: number, byte, bit, .. } = self.settings;
        let mut report = [0; MAX_REPORT];
        let room = (usize::from(byte) + 1).clamp(8, MAX_REPORT);
        let length = self.reports.feature(number, &mut report[..room])?;
        level(&report[..length.min(room)], number, byte, bit).ok_or_else(|| {
            let shown = &report[..length.min(8)];
            let (expected, got) = (format!("report {number} with byte {byte}"), format!("{shown:02x?}"));
            DeviceError::new(&self.device, "report its level", expected, got)
                .remedy("correct `report` and `byte` in the interlock's settings, or plug the device in again")
                .class(Class::Stop)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn bits_are_read_from_the_right_report_only() {
        assert_eq!(level(&[1, 0b100], 1, 1, 2), Some(true));
        assert_eq!(level(&[1, 0b100], 1, 1, 0), Some(false));
        for (report, byte, bit) in [(&[2, 4][..], 1, 2), (&[1], 1, 2), (&[], 1, 2), (&[1, 4], 1, 8), (&[1, 4], 2, 0)] {
            assert_eq!(level(report, 1, byte, bit), None, "{report:?}");
        }
        // The report's number is never a level.
        assert_eq!(level(&[1], 1, 0, 0), None);
    }

    #[test]
    fn settings_that_fit_no_report_are_refused() {
        let read = |text: &str| serde_json::from_str::<Settings>(text).unwrap().check();
        read(r#"{ "path": "/dev/hidraw0" }"#).unwrap();
        read(r#"{ "product_name": "door" }"#).unwrap();
        for (text, words) in [
            ("{}", "product_name"),
            (r#"{ "path": "/dev/hidraw0", "byte": 0 }"#, "driver.byte"),
            (r#"{ "path": "/dev/hidraw0", "bit": 8 }"#, "driver.bit"),
        ] {
            assert!(read(text).unwrap_err().contains(words), "{text}");
        }
    }

    proptest! {
        #[test]
        fn any_report_is_read(report in proptest::collection::vec(any::<u8>(), 0..20), number: u8, byte: u16, bit: u8) {
            let _ = level(&report, number, byte, bit);
        }
    }
}
