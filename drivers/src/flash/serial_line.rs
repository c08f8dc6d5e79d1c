//! A lamp switched by a control line of a serial port: RTS or DTR drives a transistor or a solid-state relay.
//!
//! This is the cheapest and least safe flash. It has two hazards:
//! - Adapters do not report the state of their output lines, so the state is the commanded one, not read back; the
//!   flash's identity says so. Each command checks that the port still exists.
//! - The kernel raises both lines whenever a program opens the port. Nacre lowers its line at once, but the lamp
//!   flickers for some milliseconds. Keep other programs away: the udev rules keep ModemManager only from the adapters
//!   that they name.
//!
//! When the program dies the kernel closes the port and lowers both lines, unless another program has the port open.
//! This behaviour (`HUPCL`) is the kernel's default, and is set explicitly because users disable it to keep an Arduino
//! from resetting.

use super::lamp::{Lamp, Switchable, Timing};
use crate::discovery::require;
use crate::{Class, Clock, DeviceError, DeviceResult, Flash};
use rustix::termios::{ControlModes, OptionalActions, tcgetattr, tcsetattr};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serialport::{SerialPort, TTYPort};
use std::io;
use std::os::fd::{AsRawFd, BorrowedFd};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// A serial port and its control line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Port, preferably by a stable name such as `/dev/serial/by-id/…`.
    pub port: String,
    /// Line that is high while the light is on.
    #[serde(default)]
    pub line: Line,
}

/// Output line of a serial port.
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
/// `Setup` if the port is missing, may not be opened or lacks the line.
pub fn open(settings: &Settings, timing: Timing, clock: &Arc<dyn Clock>) -> DeviceResult<Box<dyn Flash>> {
    let cannot = |got: String| {
        DeviceError::new("flash", format!("open {}", settings.port), "a serial port", got).class(Class::Setup)
    };
    let missing = "plug it in, or correct `port` in the flash's settings; `nacre devices --all` lists ports";
    require(&settings.port, missing, cannot)?;
    // Not exclusive: a guardian reopens the port while it still holds the old link, to ensure that the light is off.
    let port = serialport::new(&settings.port, 9600)
        .dtr_on_open(false)
        .exclusive(false)
        .timeout(Duration::from_millis(100))
        .open_native()
        .map_err(|e| cannot(e.to_string()).remedy("correct `port` in the flash's settings"))?;
    hang_up_on_close(&port).map_err(|e| cannot(e.to_string()).remedy("use another adapter"))?;
    let lamp = SerialLamp { port, name: settings.port.clone(), line: settings.line, on: true };
    Ok(Box::new(Switchable::new(lamp, timing, clock.clone())?))
}

/// Makes the kernel lower the lines when the port is closed, however the program ends.
#[allow(unsafe_code, reason = "the port lends its descriptor only as a number")]
fn hang_up_on_close(port: &TTYPort) -> io::Result<()> {
    // SAFETY: the port keeps the descriptor open until it is dropped, which is after this.
    let port = unsafe { BorrowedFd::borrow_raw(port.as_raw_fd()) };
    let mut settings = tcgetattr(port)?;
    settings.control_modes |= ControlModes::HUPCL;
    Ok(tcsetattr(port, OptionalActions::Now, &settings)?)
}

struct SerialLamp {
    port: TTYPort,
    name: String,
    line: Line,
    /// The commanded state.
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

    /// Reading the input lines fails if the port is gone.
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
    fn missing_ports_have_a_remedy() {
        for port in ["/dev/no-such-port", "/dev/null", ""] {
            let error = opened(port);
            assert_eq!(error.class, Class::Setup, "{error}");
            assert!(error.remedy.contains("`port`"), "{error}");
        }
    }

    /// A pseudo-terminal has no control lines, but has settings.
    #[test]
    fn a_port_without_lines_is_refused_and_lines_would_go_down_with_the_program() {
        use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        let name = ptsname(&master, vec![]).unwrap().into_string().unwrap();
        // The settings persist while any process has it open.
        let port = std::fs::File::open(&name).unwrap();
        let hangs_up = || tcgetattr(&port).unwrap().control_modes.contains(ControlModes::HUPCL);
        assert!(!hangs_up());
        let error = opened(&name);
        assert!(error.expected.contains("line"), "{error}");
        assert!(hangs_up());
    }
}
