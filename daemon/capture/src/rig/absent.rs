//! Placeholder for a device that a task does not open.

use async_trait::async_trait;
use nacre_drivers::{
    Arrived, Camera, CameraInfo, Class, Controls, DeviceError, DeviceResult, Display, DisplayInfo, Frame, Freshness,
    Pattern, Shown, Stage, StageInfo,
};
use std::time::Duration;

/// Stage, camera and panel that reject every command except switching the panel's light off.
pub struct Absent;

fn closed<T>(device: &str, command: &str) -> DeviceResult<T> {
    Err(DeviceError::new(device, command, "an open device", "one that was not opened").class(Class::Setup))
}

#[async_trait]
impl Stage for Absent {
    fn describe(&self) -> StageInfo {
        StageInfo {
            id: "no stage".into(),
            speed_deg_s: 0.0,
            settling_s: 0.0,
            limits_deg: [0.0, 0.0],
            tolerance_deg: 0.0,
            approach_deg: 0.0,
            longest_s: 0.0,
            halts: true,
            by_hand: false,
        }
    }
    async fn home(&mut self) -> DeviceResult<Arrived> {
        closed("stage", "home")
    }
    async fn move_to(&mut self, _angle_deg: f64) -> DeviceResult<Arrived> {
        closed("stage", "move")
    }
    /// The device is not open, so nothing moves.
    async fn halt(&mut self) -> DeviceResult<()> {
        Ok(())
    }
    async fn position(&mut self) -> DeviceResult<f64> {
        closed("stage", "report its position")
    }
}

#[async_trait]
impl Camera for Absent {
    fn describe(&self) -> CameraInfo {
        CameraInfo {
            id: "no camera".into(),
            width: 0,
            height: 0,
            exposure_s: [0.0, 0.0],
            exposure_now_s: 0.0,
            gain: [1.0, 1.0],
            black: 0,
            white: 0,
            readout_s: 0.0,
            control_lag_frames: 0,
            shutter: false,
            full_scale_e: None,
            read_noise_e: None,
            steady_exposures_s: vec![],
            exposure_choices_s: vec![],
            by_hand: false,
            warnings: vec![],
        }
    }
    async fn configure(&mut self, _exposure: Duration, _gain: f64) -> DeviceResult<Controls> {
        closed("camera", "set exposure and gain")
    }
    async fn cover(&mut self, _closed: bool) -> DeviceResult<Duration> {
        closed("camera", "close or open the shutter")
    }
    async fn next_frame(&mut self, _fresh: Freshness) -> DeviceResult<Frame> {
        closed("camera", "take a frame")
    }
}

#[async_trait]
impl Display for Absent {
    fn describe(&self) -> DisplayInfo {
        DisplayInfo { id: "no panel".into(), size_mm: [0.0, 0.0] }
    }
    async fn show(&mut self, pattern: Pattern) -> DeviceResult<Shown> {
        match pattern {
            Pattern::Black => Ok(Shown { since: Duration::ZERO, pattern }),
            _ => closed("display", "show a pattern"),
        }
    }
}
