//! A lamp behind an LCUS relay board: a CH340 adapter and one to eight relays, switched by four bytes at 9600 baud.
//!
//! Only some boards report their state, so the driver does not read it: the stated one is the commanded one, and the
//! flash's identity says so. Each check of the state sends the command again, which fails if the board is gone. The
//! relay keeps its state when the computer fails.

use super::lamp::{Lamp, Switchable, Timing};
use crate::discovery::require;
use crate::{Class, Clock, DeviceError, DeviceResult, Flash};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serialport::TTYPort;
use std::io::Write;
use std::sync::Arc;
use std::time::Duration;

/// Baud rate of the boards.
const BAUD: u32 = 9600;

/// Maximum number of relays on a board.
const MAX_CHANNELS: u8 = 8;

/// First byte of a command.
const START: u8 = 0xa0;

/// Time limit for sending, after which the port counts as gone.
const SENDING: Duration = Duration::from_secs(1);

/// A relay board and its channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Port, preferably by a stable name such as `/dev/serial/by-path/…`: CH340 adapters have no serial number.
    pub port: String,
    /// Channel of the lamp, 1 to 8.
    #[serde(default = "first")]
    pub channel: u8,
}

fn first() -> u8 {
    1
}

impl Settings {
    pub(super) fn check(&self) -> Result<(), String> {
        if (1..=MAX_CHANNELS).contains(&self.channel) {
            return Ok(());
        }
        Err(format!("driver.channel is {}; give 1 to {MAX_CHANNELS}", self.channel))
    }
}

/// The command that switches one channel, counted from 1: start byte, channel, state and the sum of these.
pub fn command(channel: u8, on: bool) -> [u8; 4] {
    let state = u8::from(on);
    [START, channel, state, START.wrapping_add(channel).wrapping_add(state)]
}

/// Opens the board and switches the channel off.
///
/// # Errors
/// `Setup` if the port is missing or may not be opened.
pub fn open(settings: &Settings, timing: Timing, clock: &Arc<dyn Clock>) -> DeviceResult<Box<dyn Flash>> {
    let cannot = |got: String| {
        DeviceError::new("flash", format!("open {}", settings.port), "a serial port", got).class(Class::Setup)
    };
    let missing = "plug it in, or correct `port` in the flash's settings; `nacre devices --all` lists ports";
    require(&settings.port, missing, cannot)?;
    // Not exclusive: a guardian reopens the port while it still holds the old link, to ensure that the light is off.
    let port = serialport::new(&settings.port, BAUD)
        .exclusive(false)
        .timeout(SENDING)
        .open_native()
        .map_err(|e| cannot(e.to_string()).remedy("correct `port` in the flash's settings"))?;
    let board = Board { port, name: settings.port.clone(), channel: settings.channel, on: true };
    Ok(Box::new(Switchable::new(board, timing, clock.clone())?))
}

struct Board {
    port: TTYPort,
    name: String,
    channel: u8,
    /// The commanded state.
    on: bool,
}

impl Lamp for Board {
    fn id(&self) -> String {
        format!("LCUS relay at {} channel {} (as set, not read back)", self.name, self.channel)
    }

    fn set(&mut self, on: bool) -> DeviceResult<()> {
        let what = if on { "switch on" } else { "switch off" };
        self.port.write_all(&command(self.channel, on)).map_err(|e| {
            DeviceError::new(&self.id(), what, "a command that is sent", e.to_string())
                .remedy("plug the relay board in again, then resume the session")
                .class(Class::Lost)
        })?;
        self.on = on;
        Ok(())
    }

    fn state(&mut self) -> DeviceResult<bool> {
        self.set(self.on)?;
        Ok(self.on)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SystemClock;

    #[test]
    fn commands_are_those_of_the_data_sheet() {
        assert_eq!(command(1, true), [0xa0, 1, 1, 0xa2]);
        assert_eq!(command(1, false), [0xa0, 1, 0, 0xa1]);
        assert_eq!(command(8, true), [0xa0, 8, 1, 0xa9]);
    }

    #[test]
    fn missing_boards_and_channels_are_named() {
        let clock: Arc<dyn Clock> = Arc::new(SystemClock);
        let timing = Timing { settling: Duration::from_millis(1), max_on: Duration::from_secs(1) };
        for port in ["/dev/no-such-port", "/dev/null"] {
            let error = open(&Settings { port: port.into(), channel: 1 }, timing, &clock).err().unwrap();
            assert!(error.class == Class::Setup && error.remedy.contains("`port`"), "{error}");
        }
        assert!(Settings { port: String::new(), channel: 9 }.check().unwrap_err().contains("channel"));
    }
}
