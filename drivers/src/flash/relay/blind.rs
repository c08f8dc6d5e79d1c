//! Relays without a status report: "HIDRelay", 0519:2018.
//!
//! The state is the commanded one, not read back; the flash's identity says so. Each check of the state sends the
//! command again, which fails if the relay is gone. All boards have the same serial number; paths distinguish them.

use super::{DEVICE, protocol};
use crate::DeviceResult;
use crate::flash::lamp::Lamp;
use crate::hid::Reports;

/// Vendor and product number.
pub(super) const NUMBERS: (u16, u16) = (0x0519, 0x2018);

/// Maximum number of channels; the board does not report its number.
pub(super) const MAX_CHANNELS: u8 = 9;

/// One channel of a relay that cannot be read back.
pub(super) struct BlindRelay {
    pub(super) reports: Box<dyn Reports>,
    pub(super) path: String,
    pub(super) channel: u8,
    /// The commanded state.
    pub(super) on: bool,
}

impl Lamp for BlindRelay {
    fn id(&self) -> String {
        format!("{DEVICE} at {} channel {} (as set, not read back)", self.path, self.channel)
    }

    fn set(&mut self, on: bool) -> DeviceResult<()> {
        self.reports.write(&protocol::switch_blind(self.channel, on))?;
        self.on = on;
        Ok(())
    }

    fn state(&mut self) -> DeviceResult<bool> {
        self.set(self.on)?;
        Ok(self.on)
    }
}
