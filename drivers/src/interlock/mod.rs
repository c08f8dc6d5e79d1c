//! Interlocks of the bench: a door contact, an emergency stop, an operator's pedal.
//!
//! The contact is normally closed: a broken wire or a missing plug reads as open. An input that cannot be read also
//! counts as open.

mod contact;
pub mod gpio;
pub mod report;
pub mod serial_line;

pub use contact::{Contact, Input, OpenInput};

use crate::{DeviceResult, Interlock};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Maximum length of an interlock's name in characters.
const MAX_NAME: usize = 40;

/// An interlock of a bench.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InterlockConfig {
    /// Name in messages, such as `door` or `emergency stop`; 1 to 40 characters.
    pub name: String,
    /// Driver and its settings.
    pub driver: InterlockDriver,
    /// Level of the input while the interlock is open. A broken wire must read as this level.
    #[serde(default)]
    pub open: InputLevel,
}

/// Level of a digital input.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum InputLevel {
    /// Inactive: a cleared modem line, 0 V on a GPIO line, a bit of 0.
    #[default]
    Low,
    /// Active.
    High,
}

/// Interlock drivers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum InterlockDriver {
    /// A contact at an input line of a serial port.
    SerialLine(serial_line::Settings),
    /// A contact at a line of a GPIO chip.
    Gpio(gpio::Settings),
    /// A contact at a HID device, read as a bit of a feature report.
    Hid(report::Settings),
}

impl InterlockConfig {
    /// Checks the settings.
    ///
    /// # Errors
    /// The invalid key and its valid values.
    pub fn check(&self) -> Result<(), String> {
        let length = self.name.chars().count();
        if !(1..=MAX_NAME).contains(&length) || self.name.chars().any(char::is_control) || self.name.trim().is_empty() {
            return Err(format!("name is {:?}; give 1 to {MAX_NAME} printable characters", self.name));
        }
        match &self.driver {
            InterlockDriver::Hid(settings) => settings.check(),
            InterlockDriver::SerialLine(_) | InterlockDriver::Gpio(_) => Ok(()),
        }
    }

    /// Serial port of the interlock, if it has one.
    pub fn port(&self) -> Option<&str> {
        match &self.driver {
            InterlockDriver::SerialLine(settings) => Some(&settings.port),
            InterlockDriver::Gpio(_) | InterlockDriver::Hid(_) => None,
        }
    }

    /// Opens the input and monitors it.
    ///
    /// # Errors
    /// `Setup` if the input is missing, may not be opened or cannot be read; the message contains the remedy.
    pub fn open(&self) -> DeviceResult<Box<dyn Interlock>> {
        let place = match &self.driver {
            InterlockDriver::SerialLine(settings) => settings.place(),
            InterlockDriver::Gpio(settings) => settings.place(),
            InterlockDriver::Hid(settings) => settings.place(),
        };
        let id = format!("{} ({place})", self.name);
        let (driver, device) = (self.driver.clone(), id.clone());
        let open: OpenInput = Box::new(move || match &driver {
            InterlockDriver::SerialLine(settings) => serial_line::open(&device, settings),
            InterlockDriver::Gpio(settings) => gpio::open(&device, settings),
            InterlockDriver::Hid(settings) => report::open(&device, settings),
        });
        Ok(Box::new(Contact::open(id, open, self.open)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Class;

    fn read(text: &str) -> InterlockConfig {
        serde_json::from_str(text).unwrap()
    }

    #[test]
    fn settings_are_read_and_open_is_low_by_default() {
        let door = read(r#"{ "name": "door", "driver": { "kind": "serial_line", "port": "/dev/ttyUSB0" } }"#);
        assert_eq!((door.open, door.port()), (InputLevel::Low, Some("/dev/ttyUSB0")));
        door.check().unwrap();
        for name in ["", "  ", "do\nor", &"x".repeat(41)] {
            assert!(InterlockConfig { name: name.into(), ..door.clone() }.check().is_err(), "{name:?}");
        }
    }

    #[test]
    fn missing_inputs_are_named_with_a_remedy() {
        for driver in [
            r#"{ "kind": "serial_line", "port": "/dev/no-such-port", "line": "dsr", "drive": "dtr" }"#,
            r#"{ "kind": "serial_line", "port": "/dev/null" }"#,
            r#"{ "kind": "gpio", "chip": "/dev/no-such-chip", "line": 4 }"#,
            r#"{ "kind": "gpio", "chip": "/dev/null", "line": 4, "bias": "pull_up" }"#,
            r#"{ "kind": "hid", "path": "unix:/no/such/socket" }"#,
            r#"{ "kind": "hid", "vendor": 5824, "product": 1503, "product_name": "no such device" }"#,
        ] {
            let config = read(&format!(r#"{{ "name": "door", "driver": {driver}, "open": "high" }}"#));
            config.check().unwrap();
            let error = config.open().err().unwrap();
            assert_eq!(error.class, Class::Setup, "{error}");
            assert!(error.device.starts_with("door (") && error.remedy.len() > 10, "{error}");
        }
    }
}
