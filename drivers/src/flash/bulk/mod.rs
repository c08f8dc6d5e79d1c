//! A flash with bulk transfers: the template for custom electronics. Firmware needs only [`protocol`], with interface
//! 0, endpoint 1 out and endpoint 1 in.
//!
//! The device switches off autonomously some time after the last ON, so the light cannot stay on if the computer fails.

mod link;
pub mod protocol;

pub use link::Bulk;

use super::lamp::{Lamp, Switchable, Timing};
use crate::discovery::Root;
use crate::{Class, Clock, DeviceError, DeviceResult, Flash};
use protocol::{Answer, Command, Status};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::Duration;

/// Vendor ID of pid.codes, whose product 1 is for experiments.
pub const VENDOR: u16 = 0x1209;
/// Product ID.
pub const PRODUCT: u16 = 0x0001;
/// Product string.
pub const NAME: &str = "Nacre flash";

const DEVICE: &str = "flash";

/// Time from the maximum on-time to the device's own switch-off.
const GRACE: Duration = Duration::from_millis(500);

/// Maximum number of pending answers to earlier requests.
const MAX_LATE: usize = 8;

/// A flash with bulk transfers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Serial number; required if several are connected.
    #[serde(default)]
    pub serial: Option<String>,
    /// `unix:/path` for an emulated device; not needed on USB.
    #[serde(default)]
    pub path: Option<String>,
}

/// Opens the flash and switches it off.
///
/// # Errors
/// `Setup` if the flash is missing or may not be opened.
pub fn open(settings: &Settings, timing: Timing, clock: &Arc<dyn Clock>) -> DeviceResult<Box<dyn Flash>> {
    let (bulk, id) = match &settings.path {
        Some(path) => (link::socket(path)?, format!("flash at {path}")),
        None => {
            let (bulk, identity) = link::usb(&Root::default(), settings.serial.as_deref())?;
            (bulk, format!("flash {identity}"))
        }
    };
    let steps = (timing.max_on + GRACE).as_millis().div_ceil(10);
    let lamp = BulkLamp { bulk, id, sequence: 0, longest: u16::try_from(steps).unwrap_or(u16::MAX) };
    Ok(Box::new(Switchable::new(lamp, timing, clock.clone())?))
}

struct BulkLamp {
    bulk: Box<dyn Bulk>,
    id: String,
    sequence: u8,
    /// Maximum on-time in steps of 10 ms, enforced by the device.
    longest: u16,
}

impl BulkLamp {
    fn query(&mut self, command: Command) -> DeviceResult<Answer> {
        self.sequence = self.sequence.wrapping_add(1);
        self.bulk.send(&protocol::request(self.sequence, command))?;
        let mut got = String::from("answers to other requests only");
        for _ in 0..MAX_LATE {
            let mut frame = [0; 64];
            let length = self.bulk.receive(&mut frame)?;
            match protocol::answer(&frame[..length]) {
                Some(answer) if (answer.sequence, answer.command) == (self.sequence, command.number()) => {
                    return self.done(command, answer);
                }
                Some(_) => {}
                None => {
                    got = format!("bytes without meaning: {:02x?}", &frame[..length.min(16)]);
                    break;
                }
            }
        }
        Err(DeviceError::new(&self.id, format!("answer {command:?}"), "its answer", got)
            .remedy("unplug the flash and plug it in again, then resume the session")
            .class(Class::Retry))
    }

    fn done(&self, command: Command, answer: Answer) -> DeviceResult<Answer> {
        let (got, remedy, class) = match answer.status {
            Status::Done => return Ok(answer),
            Status::Busy => ("that it is busy", "resume the session", Class::Retry),
            Status::Refused => ("a refusal", "let the flash cool down, close its lid, then resume", Class::Stop),
            Status::Unknown => ("an unknown command", "update the flash's firmware", Class::Setup),
        };
        Err(DeviceError::new(&self.id, format!("carry out {command:?}"), "that it is done", got)
            .remedy(remedy)
            .class(class))
    }
}

impl Lamp for BulkLamp {
    fn id(&self) -> String {
        self.id.clone()
    }

    fn set(&mut self, on: bool) -> DeviceResult<()> {
        self.query(if on { Command::On(self.longest) } else { Command::Off }).map(drop)
    }

    fn state(&mut self) -> DeviceResult<bool> {
        Ok(self.query(Command::State)?.on)
    }
}
