//! Flashes: lamps that are switched over USB or a serial line.

use crate::{Clock, DeviceResult, Flash};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// The flash of a bench.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FlashConfig {
    /// Which driver, with its settings.
    pub driver: FlashDriver,
    /// Time from the command until the light is steady, in ms.
    #[serde(default = "settling_ms")]
    pub settling_ms: f64,
    /// It must not be on for longer than this at a time, in s.
    #[serde(default = "max_on_s")]
    pub max_on_s: f64,
}

fn settling_ms() -> f64 {
    20.0
}

fn max_on_s() -> f64 {
    10.0
}

/// The drivers of flashes: one line each.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum FlashDriver {
    /// The flash of the simulated bench.
    Simulated {},
}

impl FlashConfig {
    /// Whether it is the simulated bench's.
    pub fn is_simulated(&self) -> bool {
        matches!(self.driver, FlashDriver::Simulated {})
    }

    /// Opens a flash that is a device of this machine; None for the simulated one.
    ///
    /// # Errors
    /// `Setup` when it is not there, may not be opened or is something else; the message says what to do.
    pub fn open(&self, _clock: &Arc<dyn Clock>) -> Option<DeviceResult<Box<dyn Flash>>> {
        match &self.driver {
            FlashDriver::Simulated {} => None,
        }
    }
}
