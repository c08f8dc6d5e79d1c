//! A lamp behind a HID relay (DCTTech and its clones: "USBRelay1" to "USBRelay8"; "HIDRelay").
//!
//! The relay keeps its state even if the computer fails, so its owner must switch it off. Only the lamp's channel is
//! switched.

mod blind;
pub mod protocol;

use super::lamp::{Lamp, Switchable, Timing};
use crate::discovery::{HidNode, Root};
use crate::hid::{self, Reports};
use crate::{Class, Clock, DeviceError, DeviceResult, Flash};
use blind::BlindRelay;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

const NUMBERS: (u16, u16) = (0x16c0, 0x05df);
const NAME: &str = "USBRelay";
const DEVICE: &str = "relay";

/// A relay and its channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Serial number of five letters; required if several are connected that have one.
    #[serde(default)]
    pub serial: Option<String>,
    /// Device node, such as `/dev/nacre-relay-1-2` (by USB port), or `unix:/path` for an emulated one; default: found
    /// automatically.
    #[serde(default)]
    pub path: Option<String>,
    /// Channel of the lamp, from 1.
    #[serde(default = "first")]
    pub channel: u8,
    /// Kind of board; default: that of the USB device.
    #[serde(default)]
    pub board: Option<RelayBoard>,
}

/// Kinds of relay boards.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum RelayBoard {
    /// 16c0:05df, "USBRelay…", with a report of its state.
    Usbrelay,
    /// 0519:2018, "HIDRelay", whose state cannot be read back.
    Hidrelay,
}

fn first() -> u8 {
    1
}

/// Opens the relay and switches the channel off.
///
/// # Errors
/// `Setup` if the relay is missing, may not be opened or lacks the channel.
pub fn open(settings: &Settings, timing: Timing, clock: &Arc<dyn Clock>) -> DeviceResult<Box<dyn Flash>> {
    let blind = |path: &str| open_blind(path, settings.channel, timing, clock);
    match (settings.board.or_else(|| board(settings)), &settings.path) {
        (Some(RelayBoard::Hidrelay), Some(path)) => return blind(path),
        (Some(RelayBoard::Hidrelay), None) => {
            let nodes = hid::find(&Root::default(), blind::NUMBERS, "");
            let node = hid::only(DEVICE, nodes, |node| format!("path = \"{}\"", stable(node)))?;
            return blind(&node.node.to_string_lossy());
        }
        _ => {}
    }
    let relay = match &settings.path {
        Some(path) => Relay::at(path, settings.channel, None)?,
        None => find(settings)?,
    };
    if let Some(other) = settings.serial.as_ref().filter(|serial| **serial != relay.serial) {
        return Err(wrong("open it", format!("the relay {other}"), format!("the relay {}", relay.serial))
            .remedy("correct `serial` or `path` in the flash's settings"));
    }
    Ok(Box::new(Switchable::new(relay, timing, clock.clone())?))
}

/// Kind of board by the numbers of the USB device; `None` if there is no such device, or it is emulated.
fn board(settings: &Settings) -> Option<RelayBoard> {
    let root = Root::default();
    let (known, other) = (hid::find(&root, NUMBERS, NAME), hid::find(&root, blind::NUMBERS, ""));
    let Some(path) = &settings.path else {
        return (known.is_empty() && !other.is_empty() && settings.serial.is_none()).then_some(RelayBoard::Hidrelay);
    };
    let node = Path::new(path).canonicalize().ok()?;
    other.iter().any(|hid| hid.node == node).then_some(RelayBoard::Hidrelay)
}

/// Opens a relay that cannot be read back.
fn open_blind(path: &str, channel: u8, timing: Timing, clock: &Arc<dyn Clock>) -> DeviceResult<Box<dyn Flash>> {
    if !(1..=blind::MAX_CHANNELS).contains(&channel) {
        let expected = format!("a channel from 1 to {}", blind::MAX_CHANNELS);
        return Err(
            wrong("open it", expected, format!("{channel}")).remedy("correct `channel` in the flash's settings")
        );
    }
    let relay = BlindRelay { reports: hid::open(DEVICE, path)?, path: path.to_owned(), channel, on: true };
    Ok(Box::new(Switchable::new(relay, timing, clock.clone())?))
}

/// Name of a relay's node by its USB port, if the udev rules are installed; otherwise its present name.
fn stable(node: &HidNode) -> String {
    let by_port = node.usb.as_ref().map(|usb| format!("/dev/nacre-relay-{}", usb.port));
    by_port.filter(|path| Path::new(path).exists()).unwrap_or_else(|| node.node.to_string_lossy().into_owned())
}

/// Only the relay itself reports its serial number, so every relay is opened and queried.
fn find(settings: &Settings) -> DeviceResult<Relay> {
    let nodes = hid::find(&Root::default(), NUMBERS, NAME);
    let open = |node: &HidNode| Relay::at(&stable(node), settings.channel, protocol::channels(&node.name));
    let (mut opened, mut failed) = (vec![], None);
    for relay in nodes.iter().map(open) {
        match relay {
            Ok(relay) if settings.serial.as_ref().is_none_or(|serial| *serial == relay.serial) => opened.push(relay),
            Ok(_) => {}
            Err(error) => failed = Some(error),
        }
    }
    match failed {
        // A relay that could not be opened may be the configured one.
        Some(error) if opened.is_empty() => Err(error),
        _ => hid::only(DEVICE, opened, Relay::setting),
    }
}

fn wrong(command: &str, expected: String, got: String) -> DeviceError {
    DeviceError::new(DEVICE, command, expected, got).class(Class::Setup)
}

/// One channel of a relay.
struct Relay {
    reports: Box<dyn Reports>,
    path: String,
    serial: String,
    channel: u8,
    /// Bit mask of missing channels, whose bits must never be set.
    absent: u8,
}

impl Relay {
    /// The relay at a path; `channels` is given if its name contains the number of channels.
    fn at(path: &str, channel: u8, channels: Option<u8>) -> DeviceResult<Self> {
        let channels = channels.unwrap_or(protocol::MAX_CHANNELS);
        if !(1..=channels).contains(&channel) {
            return Err(wrong("open it", format!("a channel from 1 to {channels}"), format!("{channel}"))
                .remedy("correct `channel` in the flash's settings"));
        }
        let reports = hid::open(DEVICE, path)?;
        let absent = 0xffu8.checked_shl(channels.into()).unwrap_or(0);
        let mut relay = Self { reports, path: path.to_owned(), serial: String::new(), channel, absent };
        let status = relay.status().map_err(|error| match error.class {
            Class::Retry => error.class(Class::Setup).remedy("it is no relay of this kind: correct `path`"),
            _ => error,
        })?;
        relay.serial = status.serial;
        Ok(relay)
    }

    /// Setting that distinguishes this relay from others: its path if it has no serial number.
    fn setting(&self) -> String {
        match self.serial.as_str() {
            protocol::UNREADABLE => format!("path = \"{}\"", self.path),
            serial => format!("serial = \"{serial}\""),
        }
    }

    fn status(&mut self) -> DeviceResult<protocol::Status> {
        let mut report = [0; protocol::STATUS_LENGTH + 1];
        let length = self.reports.feature(protocol::STATUS_REPORT, &mut report)?;
        let status = protocol::status(&report[..length])
            .filter(|status| status.on & self.absent == 0 && (self.serial.is_empty() || self.serial == status.serial));
        status.ok_or_else(|| {
            let got = format!("bytes without meaning: {:02x?}", &report[..length]);
            DeviceError::new(DEVICE, "report its state", "serial number and state", got)
                .remedy("unplug the relay and plug it in again, then resume the session")
                .class(Class::Retry)
        })
    }
}

impl Lamp for Relay {
    fn id(&self) -> String {
        format!("relay {} channel {}", self.serial, self.channel)
    }

    fn set(&mut self, on: bool) -> DeviceResult<()> {
        self.reports.write(&protocol::switch(self.channel, on))
    }

    fn state(&mut self) -> DeviceResult<bool> {
        Ok(self.status()?.is_on(self.channel))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SystemClock;
    use std::sync::Mutex;
    use std::time::Duration;

    /// Reports as received, and a status report.
    #[derive(Clone, Default)]
    struct Fake {
        sent: Arc<Mutex<Vec<Vec<u8>>>>,
        status: [u8; protocol::STATUS_LENGTH],
    }

    impl Reports for Fake {
        fn write(&mut self, report: &[u8]) -> DeviceResult<()> {
            self.sent.lock().unwrap().push(report.to_vec());
            Ok(())
        }

        fn set_feature(&mut self, _: &[u8]) -> DeviceResult<()> {
            Ok(())
        }

        fn feature(&mut self, _: u8, report: &mut [u8]) -> DeviceResult<usize> {
            report[..self.status.len()].copy_from_slice(&self.status);
            Ok(self.status.len())
        }
    }

    #[test]
    fn a_relay_that_cannot_be_read_back_gets_every_command_again() {
        let fake = Fake::default();
        let relay = BlindRelay { reports: Box::new(fake.clone()), path: "/dev/hidraw3".into(), channel: 2, on: true };
        let timing = Timing { settling: Duration::from_millis(1), max_on: Duration::from_secs(1) };
        let mut flash = Switchable::new(relay, timing, Arc::new(SystemClock)).unwrap();
        assert!(flash.describe().id.contains("/dev/hidraw3 channel 2 (as set, not read back)"));
        assert!(crate::wire::wait(flash.switch(true)).unwrap().on);
        drop(flash);
        let sent: Vec<u8> = fake.sent.lock().unwrap().iter().map(|report| report[1]).collect();
        assert!(sent.starts_with(&[0x02, 0x02, 0xf2, 0xf2]) && sent.ends_with(&[0x02]), "{sent:02x?}");
    }

    #[test]
    fn relays_without_a_serial_number_are_distinguished_by_path() {
        let relay = |serial: &str| Relay {
            reports: Box::new(Fake::default()),
            path: "/dev/nacre-relay-1-2".into(),
            serial: serial.into(),
            channel: 1,
            absent: 0,
        };
        assert_eq!(relay("6QMBS").setting(), "serial = \"6QMBS\"");
        assert_eq!(relay(protocol::UNREADABLE).setting(), "path = \"/dev/nacre-relay-1-2\"");
    }
}
