//! A lamp switched by a line of a serial port: RTS or DTR drives a transistor or a solid-state relay.
//!
//! The cheapest flash and the least safe one. Two hazards:
//! - Adapters do not tell how their lines stand, so the state is as set, not read back; the flash's identity says so. What is
//!   checked each time is that the port is still there.
//! - The kernel raises both lines whenever the port is opened, by any program. Ours is lowered at once, but the lamp flickers for
//!   some milliseconds; keep other programs (ModemManager) away by the udev rules.
//!
//! When the program dies the kernel closes the port, which lowers both lines.

use super::lamp::{Lamp, Switchable, Timing};
use crate::discovery::{Access, Root, check};
use crate::{Class, Clock, DeviceError, DeviceResult, Flash};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serialport::SerialPort;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// A serial port and its line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// The port, best by a name that stays, such as `/dev/serial/by-id/…`.
    pub port: String,
    /// The line that is high while the light is on.
    #[serde(default)]
    pub line: Line,
}

/// A line that the computer drives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Line {
    /// Request to send.
    #[default]
    Rts,
    /// Data terminal ready.
    Dtr,
}

/// Opens the port and lowers the line.
///
/// # Errors
/// `Setup` when it is not there, may not be opened or has no such line.
pub fn open(settings: &Settings, timing: Timing, clock: &Arc<dyn Clock>) -> DeviceResult<Box<dyn Flash>> {
    let cannot = |got: String| {
        DeviceError::new("flash", format!("open {}", settings.port), "a serial port", got).class(Class::Setup)
    };
    match check(&Root::default(), Path::new(&settings.port)) {
        Access::Denied { remedy } => return Err(cannot("no permission".into()).remedy(remedy)),
        Access::NoNode { .. } => {
            let remedy = "plug it in, or correct `port` in the flash's settings; `nacre devices` lists what is there";
            return Err(cannot("no such port".into()).remedy(remedy));
        }
        Access::Open | Access::NotNeeded => {}
    }
    // Not exclusive: a guardian opens it anew while it still holds the old link, to be sure that the light is off.
    let port = serialport::new(&settings.port, 9600)
        .dtr_on_open(false)
        .exclusive(false)
        .timeout(Duration::from_millis(100))
        .open()
        .map_err(|e| cannot(e.to_string()).remedy("correct `port` in the flash's settings"))?;
    let lamp = SerialLamp { port, name: settings.port.clone(), line: settings.line, on: true };
    Ok(Box::new(Switchable::new(lamp, timing, clock.clone())?))
}

struct SerialLamp {
    port: Box<dyn SerialPort>,
    name: String,
    line: Line,
    /// As set.
    on: bool,
}

impl SerialLamp {
    fn checked<T>(&self, command: &str, result: serialport::Result<T>) -> DeviceResult<T> {
        result.map_err(|error| {
            let there = Path::new(&self.name).exists();
            let (remedy, class) = if there {
                ("use a port that has this line, or another line", Class::Stop)
            } else {
                ("plug the adapter in again, then resume the session", Class::Lost)
            };
            DeviceError::new(&self.id(), command, "a line that follows", error.to_string()).remedy(remedy).class(class)
        })
    }
}

impl Lamp for SerialLamp {
    fn id(&self) -> String {
        let line = match self.line {
            Line::Rts => "RTS",
            Line::Dtr => "DTR",
        };
        format!("{line} of {} (as set, not read back)", self.name)
    }

    fn set(&mut self, on: bool) -> DeviceResult<()> {
        let set = match self.line {
            Line::Rts => self.port.write_request_to_send(on),
            Line::Dtr => self.port.write_data_terminal_ready(on),
        };
        self.checked(if on { "raise the line" } else { "lower the line" }, set)?;
        self.on = on;
        Ok(())
    }

    /// Reading the lines that others drive fails when the port is gone.
    fn state(&mut self) -> DeviceResult<bool> {
        let alive = self.port.read_clear_to_send();
        self.checked("report its lines", alive)?;
        Ok(self.on)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SystemClock;

    fn opened(port: &str) -> DeviceError {
        let settings = Settings { port: port.into(), line: Line::Rts };
        let timing = Timing { settling: Duration::from_millis(1), max_on: Duration::from_secs(1) };
        let clock: Arc<dyn Clock> = Arc::new(SystemClock);
        open(&settings, timing, &clock).err().unwrap()
    }

    #[test]
    fn what_is_no_port_says_what_to_do() {
        for port in ["/dev/no-such-port", "/dev/null", ""] {
            let error = opened(port);
            assert_eq!(error.class, Class::Setup, "{error}");
            assert!(error.remedy.contains("`port`"), "{error}");
        }
    }

    /// A pseudo-terminal has no lines.
    #[test]
    fn a_port_without_lines_is_refused() {
        let (_master, slave) = serialport::TTYPort::pair().unwrap();
        let name = slave.name().unwrap();
        let error = opened(&name);
        assert!(error.expected.contains("line"), "{error}");
    }
}
