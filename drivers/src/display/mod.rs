//! Displays: LCDs as programmable light sources.

mod curve;
mod desktop;
pub mod edid;
pub mod kms;

pub use curve::{POWER_LAW, PowerLaw, power_law};
pub use desktop::desktop_warnings;

use crate::{Clock, DeviceResult, Display};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::Duration;

/// The display of a bench.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DisplayConfig {
    /// Driver and its settings.
    pub driver: DisplayDriver,
    /// Settling time of a new picture in ms, from the moment it was submitted.
    #[serde(default = "response_ms")]
    pub response_ms: f64,
}

fn response_ms() -> f64 {
    50.0
}

/// Display drivers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum DisplayDriver {
    /// The display of the simulated bench.
    Simulated {},
    /// The page `/display` of Nacre's service, in a full-screen browser on the display.
    Page {
        /// Width and height of the picture in mm.
        size_mm: [f64; 2],
    },
    /// A display on an output of this machine that no desktop uses.
    Kms(kms::Settings),
}

impl DisplayConfig {
    /// Checks the settings.
    ///
    /// # Errors
    /// The invalid key and its valid values.
    pub fn check(&self) -> Result<(), String> {
        if !(0.0..=10_000.0).contains(&self.response_ms) {
            return Err(format!("response_ms is {}; give 0 to 10000", self.response_ms));
        }
        match &self.driver {
            DisplayDriver::Simulated {} => Ok(()),
            DisplayDriver::Page { size_mm } if size_mm.iter().all(|mm| (1.0..=1e5).contains(mm)) => Ok(()),
            DisplayDriver::Page { size_mm } => Err(format!("size_mm is {size_mm:?}; give width and height in mm")),
            DisplayDriver::Kms(settings) => settings.check(),
        }
    }

    /// Settling time of a new picture.
    pub fn response(&self) -> Duration {
        Duration::try_from_secs_f64(self.response_ms / 1e3).unwrap_or_default()
    }

    /// Opens a display of this machine; `None` for the other drivers.
    ///
    /// # Errors
    /// `Setup` if the display is missing, may not be opened or is another device; the message contains the remedy.
    pub fn open(&self, clock: &Arc<dyn Clock>) -> Option<DeviceResult<Box<dyn Display>>> {
        match &self.driver {
            DisplayDriver::Simulated {} | DisplayDriver::Page { .. } => None,
            DisplayDriver::Kms(settings) => Some(self.open_kms(settings, clock)),
        }
    }

    fn open_kms(&self, settings: &kms::Settings, clock: &Arc<dyn Clock>) -> DeviceResult<Box<dyn Display>> {
        Ok(Box::new(kms::open(settings, self.response(), clock)?))
    }
}
