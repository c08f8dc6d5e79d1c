//! Panels: LCDs as programmable light.

use crate::{Clock, DeviceResult, Display};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

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
    /// A browser in full screen that has `/display` of the service open.
    Page {
        /// Width and height of the panel, in mm.
        size_mm: [f64; 2],
    },
}

impl DisplayConfig {
    /// Opens a panel that is a device of this machine; None for those that are not.
    ///
    /// # Errors
    /// `Setup` when it is not there, may not be opened or is something else; the message says what to do.
    pub fn open(&self, _clock: &Arc<dyn Clock>) -> Option<DeviceResult<Box<dyn Display>>> {
        match &self.driver {
            DisplayDriver::Simulated {} | DisplayDriver::Page { .. } => None,
        }
    }
}
