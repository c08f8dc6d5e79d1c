//! A HID device that reports the bench's door contact.

use super::fault::ByteFaultKind;
use super::reports::{Outcome, Peripheral, Transfer};
use crate::devices::Port;
use crate::messages::{Reply, Request};

/// Number of the feature report.
const REPORT: u8 = 1;

/// Firmware with one contact: bit 0 of byte 1 of feature report 1 is set while the door is closed.
pub struct InterlockEmulator {
    port: Box<dyn Port>,
}

impl InterlockEmulator {
    /// A device at the bench's door.
    pub fn new(port: Box<dyn Port>) -> Self {
        Self { port }
    }
}

impl Peripheral for InterlockEmulator {
    fn transfer(&mut self, transfer: Transfer<'_>, fault: Option<ByteFaultKind>) -> Outcome {
        if transfer != Transfer::Feature(REPORT) {
            return Outcome::Stalled;
        }
        match self.port.call(&Request::Level) {
            Ok(Reply::Level(level)) => {
                let closed = level.holds != (fault == Some(ByteFaultKind::WrongStatus));
                Outcome::Done(vec![REPORT, u8::from(closed), 0, 0, 0, 0, 0, 0])
            }
            _ => Outcome::Silent,
        }
    }

    fn reset(&mut self) {}
}
