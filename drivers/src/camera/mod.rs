//! Cameras.

use crate::{Camera, Clock, DeviceResult};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// The camera of a bench.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraConfig {
    /// Which driver, with its settings.
    pub driver: CameraDriver,
}

/// The drivers of cameras: one line each.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum CameraDriver {
    /// The camera of the simulated bench.
    Simulated {},
}

impl CameraConfig {
    /// Opens a camera that is a device of this machine; None for the simulated one.
    ///
    /// # Errors
    /// `Setup` when it is not there, may not be opened or is something else; the message says what to do.
    pub fn open(&self, _clock: &Arc<dyn Clock>) -> Option<DeviceResult<Box<dyn Camera>>> {
        match &self.driver {
            CameraDriver::Simulated {} => None,
        }
    }
}
