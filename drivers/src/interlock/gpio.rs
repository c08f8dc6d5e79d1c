//! A contact at a line of a GPIO chip.
//!
//! Wiring: a normally closed contact and a resistor of about 1 kΩ in series connect the supply of the chip (3.3 V) with
//! the line, which the chip pulls down. A broken wire reads as low, which means open.

use super::Input;
use crate::discovery::require;
use crate::{Class, DeviceError, DeviceResult};
use gpiocdev::Request;
use gpiocdev::line::{Bias as Pull, Value};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A GPIO chip and its line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Chip, such as `/dev/gpiochip0`.
    pub chip: String,
    /// Number of the line on the chip, from 0.
    pub line: u32,
    /// Resistor of the line within the chip.
    #[serde(default)]
    pub bias: Bias,
}

/// Resistor of a line within the chip.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Bias {
    /// To ground: an open contact to the supply reads low.
    #[default]
    PullDown,
    /// To the supply: an open contact to ground reads high; set `open = "high"`.
    PullUp,
    /// None: the circuit has its own resistor.
    Disabled,
}

impl Settings {
    pub(super) fn place(&self) -> String {
        format!("line {} of {}", self.line, self.chip)
    }
}

/// Requests the line as an input.
pub(super) fn open(device: &str, settings: &Settings) -> DeviceResult<Box<dyn Input>> {
    let chip = &settings.chip;
    let cannot = |got: String| DeviceError::new(device, format!("open {chip}"), "a GPIO line", got).class(Class::Setup);
    let missing = "plug it in, or correct `chip` in the interlock's settings; `ls /dev/gpiochip*` lists chips";
    require(chip, missing, cannot)?;
    let pull = match settings.bias {
        Bias::PullDown => Pull::PullDown,
        Bias::PullUp => Pull::PullUp,
        Bias::Disabled => Pull::Disabled,
    };
    let request = Request::builder()
        .on_chip(chip)
        .with_consumer("nacre interlock")
        .with_line(settings.line)
        .as_input()
        .with_bias(pull)
        .request()
        .map_err(|e| {
            let remedy =
                "correct `chip`, `line` and `bias`, or end the program that uses the line (`gpioinfo` names it)";
            cannot(e.to_string()).remedy(remedy)
        })?;
    Ok(Box::new(GpioInput { device: device.into(), request, line: settings.line }))
}

struct GpioInput {
    device: String,
    request: Request,
    line: u32,
}

impl Input for GpioInput {
    fn is_high(&mut self) -> DeviceResult<bool> {
        let value = self.request.value(self.line).map_err(|e| {
            DeviceError::new(&self.device, "read the line", "its level", e.to_string()).remedy("plug the chip in again")
        })?;
        Ok(value == Value::Active)
    }
}
