//! Panels: LCDs as programmable light.

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

/// The panel of a bench.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DisplayConfig {
    /// Which driver, with its settings.
    pub driver: DisplayDriver,
    /// Time until a new picture is steady, in ms, from when it was handed over.
    #[serde(default = "response_ms")]
    pub response_ms: f64,
}

fn response_ms() -> f64 {
    50.0
}

/// The drivers of panels: one line each.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum DisplayDriver {
    /// The panel of the simulated bench.
    Simulated {},
    /// The page `/display` of Nacre's service, in a browser on the panel's full screen.
    Page {
        /// Width and height of the picture in mm.
        size_mm: [f64; 2],
    },
    /// A panel on an output of this machine that no desktop uses.
    Kms(kms::Settings),
}

impl DisplayConfig {
    /// Says what is wrong with it.
    ///
    /// # Errors
    /// The key and what it must be.
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

    /// Time until a new picture is steady.
    pub fn response(&self) -> Duration {
        Duration::try_from_secs_f64(self.response_ms / 1e3).unwrap_or_default()
    }

    /// Opens a panel that is a device of this machine; None for those that are not.
    ///
    /// # Errors
    /// `Setup` when it is not there, may not be opened or is something else; the message says what to do.
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
