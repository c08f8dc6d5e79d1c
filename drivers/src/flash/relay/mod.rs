//! A lamp behind a HID relay (DCTTech and its clones: "USBRelay1" to "USBRelay8").
//!
//! The relay keeps its state even if the computer fails, so its owner must switch it off. Only the lamp's channel is
//! switched.

pub mod protocol;

use super::lamp::{Lamp, Switchable, Timing};
use crate::discovery::{HidNode, Root};
use crate::hid::{self, Reports};
use crate::{Class, Clock, DeviceError, DeviceResult, Flash};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

const NUMBERS: (u16, u16) = (0x16c0, 0x05df);
const NAME: &str = "USBRelay";
const DEVICE: &str = "relay";

/// A relay and its channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Serial number of five letters; required if several are connected.
    #[serde(default)]
    pub serial: Option<String>,
    /// Device node, such as `/dev/nacre-relay`, or `unix:/path` for an emulated one; default: found automatically.
    #[serde(default)]
    pub path: Option<String>,
    /// Channel of the lamp, from 1.
    #[serde(default = "first")]
    pub channel: u8,
}

fn first() -> u8 {
    1
}

/// Opens the relay and switches the channel off.
///
/// # Errors
/// `Setup` if the relay is missing, may not be opened or lacks the channel.
pub fn open(settings: &Settings, timing: Timing, clock: &Arc<dyn Clock>) -> DeviceResult<Box<dyn Flash>> {
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

/// Only the relay itself reports its serial number, so every relay is opened and queried.
fn find(settings: &Settings) -> DeviceResult<Relay> {
    let nodes = hid::find(&Root::default(), NUMBERS, NAME);
    let open =
        |node: &HidNode| Relay::at(&node.node.to_string_lossy(), settings.channel, protocol::channels(&node.name));
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
        _ => hid::only(DEVICE, opened, |relay| format!("serial = \"{}\"", relay.serial)),
    }
}

fn wrong(command: &str, expected: String, got: String) -> DeviceError {
    DeviceError::new(DEVICE, command, expected, got).class(Class::Setup)
}

/// One channel of a relay.
struct Relay {
    reports: Box<dyn Reports>,
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
        let mut relay = Self { reports, serial: String::new(), channel, absent };
        let status = relay.status().map_err(|error| match error.class {
            Class::Retry => error.class(Class::Setup).remedy("it is no relay of this kind: correct `path`"),
            _ => error,
        })?;
        relay.serial = status.serial;
        Ok(relay)
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
