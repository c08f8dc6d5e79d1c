//! Flashes: lamps switched over USB, a serial line or the network.

pub mod blink1;
pub mod bulk;
mod lamp;
pub mod lcus;
pub mod relay;
pub mod serial_line;

pub use lamp::{Lamp, Switchable, Timing};

use crate::{Class, Clock, DeviceError, DeviceResult, Flash, alpaca, indi};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::Duration;

/// The flash of a bench.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FlashConfig {
    /// Driver and its settings.
    pub driver: FlashDriver,
    /// Time from the command until the light is steady, in ms.
    #[serde(default = "settling_ms")]
    pub settling_ms: f64,
    /// Maximum continuous on-time in s.
    #[serde(default = "max_on_s")]
    pub max_on_s: f64,
}

fn settling_ms() -> f64 {
    20.0
}

fn max_on_s() -> f64 {
    10.0
}

/// Flash drivers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum FlashDriver {
    /// The flash of the simulated bench.
    Simulated {},
    /// A lamp behind a HID relay.
    Relay(relay::Settings),
    /// A blink(1) lamp.
    Blink1(blink1::Settings),
    /// Custom electronics with bulk transfers.
    Bulk(bulk::Settings),
    /// A lamp behind an LCUS relay board.
    Lcus(lcus::Settings),
    /// A lamp switched by a control line of a serial port.
    SerialLine(serial_line::Settings),
    /// A lamp behind a switch of an ASCOM Alpaca server.
    Alpaca(alpaca::switch::Settings),
    /// A light box or switch of an INDI server.
    Indi(indi::lamp::Settings),
}

impl FlashConfig {
    /// Whether this is the flash of the simulated bench.
    pub fn is_simulated(&self) -> bool {
        matches!(self.driver, FlashDriver::Simulated {})
    }

    /// Opens a flash of this machine; `None` for the simulated one.
    ///
    /// # Errors
    /// `Setup` if the flash is missing, may not be opened or is another device; the message contains the remedy.
    pub fn open(&self, clock: &Arc<dyn Clock>) -> Option<DeviceResult<Box<dyn Flash>>> {
        let timing = match self.timing() {
            Ok(timing) => timing,
            Err(error) => return Some(Err(error)),
        };
        match &self.driver {
            FlashDriver::Simulated {} => None,
            FlashDriver::Relay(settings) => Some(relay::open(settings, timing, clock)),
            FlashDriver::Blink1(settings) => Some(blink1::open(settings, timing, clock)),
            FlashDriver::Bulk(settings) => Some(bulk::open(settings, timing, clock)),
            FlashDriver::Lcus(settings) => Some(lcus::open(settings, timing, clock)),
            FlashDriver::SerialLine(settings) => Some(serial_line::open(settings, timing, clock)),
            FlashDriver::Alpaca(settings) => Some(alpaca::switch::open(settings, timing, clock)),
            FlashDriver::Indi(settings) => Some(indi::lamp::open(settings, timing, clock)),
        }
    }

    /// Checks the settings.
    ///
    /// # Errors
    /// The invalid key and its valid values.
    pub fn check(&self) -> Result<(), String> {
        let sane = |value: f64, most: f64| value > 0.0 && value <= most;
        if !sane(self.settling_ms, MAX_SETTLING_MS) {
            return Err(format!("settling_ms is {}; give more than 0 and up to {MAX_SETTLING_MS}", self.settling_ms));
        }
        if !sane(self.max_on_s, MAX_ON_S) {
            return Err(format!("max_on_s is {}; give more than 0 and up to {MAX_ON_S}", self.max_on_s));
        }
        if self.settling_ms >= 1000.0 * self.max_on_s {
            return Err(format!("settling_ms is {}, but it may be on for {} s only", self.settling_ms, self.max_on_s));
        }
        match &self.driver {
            FlashDriver::Blink1(blink1::Settings { serial: Some(_), path: Some(_), .. })
            | FlashDriver::Bulk(bulk::Settings { serial: Some(_), path: Some(_), .. }) => {
                Err("driver has both serial and path; give one of them".into())
            }
            FlashDriver::Lcus(settings) => settings.check(),
            _ => Ok(()),
        }
    }

    /// # Errors
    /// `Setup` if the times are invalid.
    fn timing(&self) -> DeviceResult<Timing> {
        self.check().map_err(|problem| {
            DeviceError::new("flash", "read its settings", "settings that make sense", problem)
                .remedy("correct them in the configuration")
                .class(Class::Setup)
        })?;
        let [settling, max_on] = [self.settling_ms / 1000.0, self.max_on_s].map(Duration::from_secs_f64);
        Ok(Timing { settling, max_on })
    }
}

/// Largest settling time in ms; slower lamps are not suitable.
const MAX_SETTLING_MS: f64 = 60_000.0;

/// Largest on-time in s; longer ones do not make a flash.
const MAX_ON_S: f64 = 600.0;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SystemClock;

    #[test]
    fn times_that_make_no_sense_are_refused_by_name() {
        let clock: Arc<dyn Clock> = Arc::new(SystemClock);
        let good = FlashConfig { driver: FlashDriver::Simulated {}, settling_ms: 20.0, max_on_s: 10.0 };
        assert!(good.open(&clock).is_none());
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e300] {
            let error = FlashConfig { settling_ms: bad, ..good.clone() }.open(&clock).unwrap().err().unwrap();
            assert!(error.got.contains("settling_ms") && error.class == Class::Setup, "{error}");
            let error = FlashConfig { max_on_s: bad, ..good.clone() }.open(&clock).unwrap().err().unwrap();
            assert!(error.got.contains("max_on_s"), "{error}");
        }
    }
}
