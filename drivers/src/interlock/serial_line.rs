//! A contact between an output and an input line of a serial port, such as RTS and CTS.
//!
//! Wiring: a normally closed contact connects RTS with CTS. Nacre raises RTS; a closed contact raises CTS. An open
//! contact, a broken wire or a missing plug leaves CTS inactive, with RS-232 levels and with the pull-ups of TTL
//! adapters.

use super::Input;
use crate::discovery::require;
use crate::{Class, DeviceError, DeviceResult};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serialport::{SerialPort, TTYPort};
use std::time::Duration;

/// A serial port and its lines.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Port, preferably by a stable name such as `/dev/serial/by-id/…`. No other device may use it.
    pub port: String,
    /// Input line of the contact.
    #[serde(default)]
    pub line: InputLine,
    /// Output line that supplies the contact.
    #[serde(default)]
    pub drive: DriveLine,
}

/// Input line of a serial port.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum InputLine {
    /// Clear to send.
    #[default]
    Cts,
    /// Data set ready.
    Dsr,
    /// Carrier detect.
    Cd,
}

/// Output line of a serial port that supplies a contact.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DriveLine {
    /// Request to send.
    #[default]
    Rts,
    /// Data terminal ready.
    Dtr,
}

impl Settings {
    pub(super) fn place(&self) -> String {
        let line = match self.line {
            InputLine::Cts => "CTS",
            InputLine::Dsr => "DSR",
            InputLine::Cd => "CD",
        };
        format!("{line} of {}", self.port)
    }
}

/// Opens the port and raises the line that supplies the contact.
pub(super) fn open(device: &str, settings: &Settings) -> DeviceResult<Box<dyn Input>> {
    let port = &settings.port;
    let cannot =
        |got: String| DeviceError::new(device, format!("open {port}"), "a serial port", got).class(Class::Setup);
    let missing = "plug it in, or correct `port` in the interlock's settings; `nacre devices --all` lists ports";
    require(port, missing, cannot)?;
    // Not exclusive: several programs may read one interlock.
    let opened = serialport::new(port, 9600).exclusive(false).timeout(Duration::from_millis(100)).open_native();
    let mut opened = opened.map_err(|e| cannot(e.to_string()).remedy("correct `port` in the interlock's settings"))?;
    let driven = match settings.drive {
        DriveLine::Rts => opened.write_request_to_send(true),
        DriveLine::Dtr => opened.write_data_terminal_ready(true),
    };
    driven.map_err(|e| cannot(e.to_string()).remedy("use a port that has modem lines"))?;
    Ok(Box::new(SerialInput { device: device.into(), port: opened, line: settings.line }))
}

struct SerialInput {
    device: String,
    port: TTYPort,
    line: InputLine,
}

impl Input for SerialInput {
    fn is_high(&mut self) -> DeviceResult<bool> {
        let level = match self.line {
            InputLine::Cts => self.port.read_clear_to_send(),
            InputLine::Dsr => self.port.read_data_set_ready(),
            InputLine::Cd => self.port.read_carrier_detect(),
        };
        level.map_err(|e| {
            DeviceError::new(&self.device, "read the line", "its level", e.to_string())
                .remedy("plug the adapter in again, or use a port that has this line")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

    /// A pseudo-terminal has no modem lines.
    #[test]
    fn a_port_without_modem_lines_is_refused() {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        let port = ptsname(&master, vec![]).unwrap().into_string().unwrap();
        for drive in [DriveLine::Rts, DriveLine::Dtr] {
            let settings = Settings { port: port.clone(), line: InputLine::Cd, drive };
            let error = open("door", &settings).err().unwrap();
            assert!(error.class == Class::Setup && error.remedy.contains("modem lines"), "{error}");
        }
    }
}
