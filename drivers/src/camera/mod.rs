//! Cameras.

pub mod measure;
pub mod v4l2;

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
    /// A camera of the kernel's V4L2: USB cameras, frame grabbers, camera modules.
    V4l2(v4l2::Settings),
}

impl CameraConfig {
    /// Opens a camera that is a device of this machine; None for the simulated one.
    ///
    /// # Errors
    /// `Setup` when it is not there, may not be opened or is something else; the message says what to do.
    pub fn open(&self, clock: &Arc<dyn Clock>) -> Option<DeviceResult<Box<dyn Camera>>> {
        match &self.driver {
            CameraDriver::Simulated {} => None,
            CameraDriver::V4l2(settings) => Some(v4l2::open(settings, clock)),
        }
    }
}
