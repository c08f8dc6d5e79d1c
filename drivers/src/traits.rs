//! The devices of a bench, as the capture engine sees them.
//!
//! Every call ends: with the device in the state asked for, or with an error that says what it did instead. Angles are
//! degrees, times are on the bench's clock.

use crate::{DeviceResult, Stamp};
use async_trait::async_trait;
use serde::Serialize;
use std::time::Duration;

/// The rotation stage of the analyser.
#[async_trait]
pub trait Stage: Send {
    /// Identity and limits.
    fn describe(&self) -> StageInfo;
    /// Finds the mechanical zero and moves to it.
    async fn home(&mut self) -> DeviceResult<Settled>;
    /// Moves to an absolute angle; returns once the stage stands still.
    async fn move_to(&mut self, angle_deg: f64) -> DeviceResult<Settled>;
}

/// The camera.
#[async_trait]
pub trait Camera: Send {
    /// Identity and limits.
    fn describe(&self) -> CameraInfo;
    /// Sets exposure and gain, and reads back what the camera made of them.
    async fn configure(&mut self, exposure: Duration, gain: f64) -> DeviceResult<Controls>;
    /// The next frame in the camera's queue, however old; waits for one if there is none.
    async fn next_frame(&mut self) -> DeviceResult<Frame>;
}

/// The LCD panel.
#[async_trait]
pub trait Display: Send {
    /// Identity and limits.
    fn describe(&self) -> DisplayInfo;
    /// Shows a pattern; returns once it can be seen.
    async fn show(&mut self, pattern: Pattern) -> DeviceResult<Settled>;
}

/// What a panel shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pattern {
    /// Nothing.
    Black,
    /// A white disc of this diameter in mm around the panel's middle.
    Disc(f64),
}

/// A change is complete.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settled {
    /// Since when, settling included.
    pub since: Duration,
}

/// Camera controls in force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Controls {
    /// Exposure time.
    pub exposure: Duration,
    /// Gain.
    pub gain: f64,
    /// When they were set.
    pub set_at: Duration,
}

/// One frame: codes of one channel, row-major, row 0 on top.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Sequence number and timestamp.
    pub stamp: Stamp,
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Codes.
    pub codes: Vec<u16>,
}

/// What a stage is and can do.
#[derive(Clone, Debug, Serialize)]
pub struct StageInfo {
    /// Stable identity: kind and serial number.
    pub id: String,
    /// Speed in degrees per second.
    pub speed_deg_s: f64,
    /// Time to stand still after a move.
    pub settling_s: f64,
}

/// What a camera is and can do.
#[derive(Clone, Debug, Serialize)]
pub struct CameraInfo {
    /// Stable identity: kind and serial number.
    pub id: String,
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Shortest and longest exposure in seconds.
    pub exposure_s: [f64; 2],
    /// Exposure in force before anything is set.
    pub exposure_now_s: f64,
    /// Lowest and highest gain.
    pub gain: [f64; 2],
    /// Code of no light, and of a saturated pixel.
    pub black: u16,
    /// Code of a saturated pixel.
    pub white: u16,
    /// Readout time in seconds.
    pub readout_s: f64,
    /// Frames until changed controls act, as measured.
    pub control_lag_frames: u32,
    /// Electrons that make a pixel white at gain 1, where known.
    pub full_scale_e: Option<f64>,
    /// Read noise in electrons, where known.
    pub read_noise_e: Option<f64>,
}

/// What a panel is and can do.
#[derive(Clone, Debug, Serialize)]
pub struct DisplayInfo {
    /// Stable identity.
    pub id: String,
    /// Largest disc in mm.
    pub largest_disc_mm: f64,
}
