//! Lamps behind switches of Alpaca servers.
//!
//! The state is read back from the server after each command. The server keeps it when this computer fails.

use super::client::{Device, Role};
use crate::flash::{Lamp, Switchable, Timing};
use crate::{Class, Clock, DeviceError, DeviceResult, Flash};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::Duration;

/// Maximum time for an answer. The guardian of the flash waits 6 s for three attempts to switch off.
const ANSWER: Duration = Duration::from_millis(900);

/// A switch of an ASCOM Alpaca server.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Host of the server, or host and port; the default port is 11111.
    pub address: String,
    /// Number of the switch device on the server.
    #[serde(default)]
    pub switch: u32,
    /// Number of the lamp's switch within the device, from 0.
    #[serde(default)]
    pub id: u32,
    /// Value of the lamp when on, for switches with more than two values; default: the largest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<f64>,
}

/// Opens a switch and switches it off.
///
/// # Errors
/// `Setup` if the server or the switch cannot be reached, or the switch is read-only.
pub fn open(settings: &Settings, timing: Timing, clock: &Arc<dyn Clock>) -> DeviceResult<Box<dyn Flash>> {
    let lamp = AlpacaLamp::open(settings).map_err(|e| e.class(Class::Setup))?;
    Ok(Box::new(Switchable::new(lamp, timing, clock.clone())?))
}

struct AlpacaLamp {
    device: Device,
    id: String,
    value: Option<f64>,
}

impl AlpacaLamp {
    fn open(settings: &Settings) -> DeviceResult<Self> {
        const WHAT: &str = "open";
        let mut device = Device::open(&settings.address, Role::Switch, settings.switch, ANSWER)?;
        let number = settings.id.to_string();
        let wrong = |device: &Device, expected: &str, got: String| {
            DeviceError::new(device.id(), WHAT, expected, got).remedy("correct the flash's settings")
        };
        let count: u32 = device.get("maxswitch", WHAT)?;
        if settings.id >= count {
            return Err(wrong(
                &device,
                &format!("a switch {number}"),
                format!("switches 0 to {}", count.saturating_sub(1)),
            ));
        }
        if !device.get_of::<bool>("canwrite", WHAT, &[("Id", &number)])? {
            return Err(wrong(&device, "a switch that can be set", format!("the read-only switch {number}")));
        }
        if let Some(value) = settings.value {
            let low: f64 = device.get_of("minswitchvalue", WHAT, &[("Id", &number)])?;
            let high: f64 = device.get_of("maxswitchvalue", WHAT, &[("Id", &number)])?;
            if !(value > low && value <= high) {
                return Err(wrong(&device, &format!("a value above {low} and up to {high}"), value.to_string()));
            }
        }
        Ok(Self { device, id: number, value: settings.value })
    }
}

impl Lamp for AlpacaLamp {
    fn id(&self) -> String {
        format!("{} switch {}", self.device.id(), self.id)
    }

    fn set(&mut self, on: bool) -> DeviceResult<()> {
        let what = if on { "switch on" } else { "switch off" };
        match self.value.filter(|_| on) {
            Some(value) => self.device.put("setswitchvalue", what, &[("Id", &self.id), ("Value", &value.to_string())]),
            None => {
                self.device.put("setswitch", what, &[("Id", &self.id), ("State", if on { "True" } else { "False" })])
            }
        }
    }

    fn state(&mut self) -> DeviceResult<bool> {
        self.device.get_of("getswitch", "report its state", &[("Id", &self.id)])
    }
}
