//! Cameras.

pub mod commanded;
pub mod folder;
pub mod genicam;
pub mod gphoto2;
mod library;
pub mod measure;
pub mod pfnc;
pub mod photograph;
pub mod v4l2;

use crate::{Camera, Class, Clock, DeviceError, DeviceResult, alpaca, indi};
use photograph::Photography;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::Duration;

/// The camera of a bench.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraConfig {
    /// Driver and its settings.
    pub driver: CameraDriver,
}

/// Camera drivers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum CameraDriver {
    /// The camera of the simulated bench.
    Simulated {},
    /// A V4L2 camera: USB cameras, frame grabbers, camera modules.
    V4l2(v4l2::Settings),
    /// A GenICam camera: GigE Vision, USB3 Vision.
    Genicam(genicam::Settings),
    /// A digital camera at a USB cable, through libgphoto2.
    Gphoto2(gphoto2::Settings),
    /// Photographs that another program or a memory card puts into a folder.
    Folder(folder::Settings),
    /// A camera of an ASCOM Alpaca server.
    Alpaca(alpaca::camera::Settings),
    /// A camera of an INDI server.
    Indi(indi::camera::Settings),
}

/// Answer of a camera without a shutter to [`Camera::cover`](crate::Camera::cover).
pub(crate) fn without_shutter(id: &str, closed: bool, now: Duration) -> DeviceResult<Duration> {
    if !closed {
        return Ok(now);
    }
    Err(DeviceError::new(id, "close the shutter", "a shutter", "a camera without one")
        .remedy("put the lens cap on")
        .class(Class::Setup))
}

impl CameraConfig {
    /// Setting for the number of frames until changed controls take effect; `None` for the simulated camera, and for
    /// cameras that expose at a command.
    pub fn control_lag_frames(&mut self) -> Option<&mut u32> {
        match &mut self.driver {
            CameraDriver::Simulated {}
            | CameraDriver::Gphoto2(_)
            | CameraDriver::Folder(_)
            | CameraDriver::Alpaca(_)
            | CameraDriver::Indi(_) => None,
            CameraDriver::V4l2(settings) => Some(&mut settings.control_lag_frames),
            CameraDriver::Genicam(settings) => Some(&mut settings.control_lag_frames),
        }
    }

    /// Opens a camera of this machine, with services of the program for still cameras; `None` for the simulated camera.
    ///
    /// # Errors
    /// `Setup` if the camera is missing, may not be opened or is another device; the message contains the remedy.
    pub fn open(&self, clock: &Arc<dyn Clock>, program: &Photography) -> Option<DeviceResult<Box<dyn Camera>>> {
        match &self.driver {
            CameraDriver::Simulated {} => None,
            CameraDriver::V4l2(settings) => Some(v4l2::open(settings, clock)),
            CameraDriver::Genicam(settings) => Some(genicam::open(settings, clock)),
            CameraDriver::Gphoto2(settings) => Some(gphoto2::open(settings, clock, program)),
            CameraDriver::Folder(settings) => Some(folder::open(settings, clock, program)),
            CameraDriver::Alpaca(settings) => Some(alpaca::camera::open(settings, clock)),
            CameraDriver::Indi(settings) => Some(indi::camera::open(settings, clock)),
        }
    }
}
