//! A HID relay that switches the bench's flash on one of its channels.

use super::fault::ByteFaultKind;
use super::lamp::Load;
use super::reports::{Outcome, Peripheral, Transfer};
use crate::devices::Port;

/// A relay of up to eight channels.
pub struct RelayEmulator {
    serial: [u8; 5],
    channels: u8,
    /// Channel of the flash, counted from 1.
    wired: u8,
    /// Other closed channels, the first one in the lowest bit.
    others: u8,
    load: Load,
}

impl RelayEmulator {
    /// A relay with all contacts open.
    pub fn new(port: Box<dyn Port>, serial: [u8; 5], channels: u8, wired: u8) -> Self {
        Self { serial, channels: channels.min(8), wired, others: 0, load: Load::new(port) }
    }

    /// Closed channels, the first one in the lowest bit.
    fn closed(&self) -> u8 {
        self.others | if self.load.is_on() { self.wired_bit() } else { 0 }
    }

    fn wired_bit(&self) -> u8 {
        bit(self.wired)
    }

    fn set(&mut self, channel: u8, on: bool) {
        if channel == self.wired {
            self.load.set(on);
        } else if on {
            self.others |= bit(channel);
        } else {
            self.others &= !bit(channel);
        }
    }

    fn command(&mut self, command: u8, channel: u8) -> Outcome {
        let all = 1..=self.channels;
        match command {
            0xff | 0xfd if all.contains(&channel) => self.set(channel, command == 0xff),
            0xfe | 0xfc => all.for_each(|channel| self.set(channel, command == 0xfe)),
            // Real relays accept unknown commands without error.
            _ => {}
        }
        Outcome::Done(vec![])
    }

    /// Status report, in which the serial number replaces the report number.
    fn report(&self, closed: u8) -> Outcome {
        let mut report = self.serial.to_vec();
        report.extend([0, 0, closed]);
        Outcome::Done(report)
    }
}

fn bit(channel: u8) -> u8 {
    if (1..=8).contains(&channel) { 1 << (channel - 1) } else { 0 }
}

impl Peripheral for RelayEmulator {
    fn transfer(&mut self, transfer: Transfer<'_>, fault: Option<ByteFaultKind>) -> Outcome {
        match transfer {
            Transfer::Output(_) | Transfer::SetFeature(_) if fault == Some(ByteFaultKind::StuckBusy) => {
                Outcome::Done(vec![])
            }
            Transfer::Output(&[0, command, channel, ..]) | Transfer::SetFeature(&[0, command, channel, ..]) => {
                self.command(command, channel)
            }
            Transfer::Feature(1) if fault == Some(ByteFaultKind::WrongStatus) => {
                self.report(self.closed() ^ self.wired_bit())
            }
            Transfer::Feature(1) => self.report(self.closed()),
            _ => Outcome::Stalled,
        }
    }

    fn reset(&mut self) {
        self.others = 0;
        self.load.set(false);
    }
}
