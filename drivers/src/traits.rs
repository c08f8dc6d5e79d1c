//! The devices of a bench, as the capture engine sees them.
//!
//! Every call ends: with what the device reports of itself afterwards, or with an error. A device that reports something
//! else than it was asked for is not believed; the engine compares. Angles are degrees, times are on the bench's clock.

use crate::{DeviceResult, Freshness, Stamp};
use async_trait::async_trait;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// The rotation stage of the analyser.
#[async_trait]
pub trait Stage: Send {
    /// Identity and limits.
    fn describe(&self) -> StageInfo;
    /// Finds the mechanical zero and moves to it.
    async fn home(&mut self) -> DeviceResult<Arrived>;
    /// Moves to an absolute angle; returns once the stage stands still.
    async fn move_to(&mut self, angle_deg: f64) -> DeviceResult<Arrived>;
    /// Ends a movement whose call was dropped. One that cannot be cut short ([`StageInfo::halts`]) is waited for.
    async fn halt(&mut self) -> DeviceResult<()>;
    /// Where it stands.
    async fn position(&mut self) -> DeviceResult<f64>;
}

/// The camera.
#[async_trait]
pub trait Camera: Send {
    /// Identity and limits.
    fn describe(&self) -> CameraInfo;
    /// Sets exposure and gain, and reads back what the camera made of them.
    async fn configure(&mut self, exposure: Duration, gain: f64) -> DeviceResult<Controls>;
    /// Closes or opens the shutter; returns when that was done.
    async fn cover(&mut self, closed: bool) -> DeviceResult<Duration>;
    /// The next frame in the camera's queue, however old; waits for one if there is none. A frame that is not fresh
    /// may come without its codes, which spares decoding what is dropped.
    async fn next_frame(&mut self, fresh: Freshness) -> DeviceResult<Frame>;
}

/// The LCD panel.
#[async_trait]
pub trait Display: Send {
    /// Identity and limits.
    fn describe(&self) -> DisplayInfo;
    /// Shows a pattern; returns once it can be seen.
    async fn show(&mut self, pattern: Pattern) -> DeviceResult<Shown>;
    /// Sees to it that it gives no light. Unlike black that is shown, this need not be visible: a panel that nobody sees is dark.
    async fn dark(&mut self) -> DeviceResult<Shown> {
        self.show(Pattern::Black).await
    }
    /// That what was shown last can still be seen, for those that others may cover.
    async fn still_shows(&mut self) -> DeviceResult<()> {
        Ok(())
    }
}

/// The flash.
#[async_trait]
pub trait Flash: Send {
    /// Identity and limits.
    fn describe(&self) -> FlashInfo;
    /// Switches the light and reads its state back.
    async fn switch(&mut self, on: bool) -> DeviceResult<Switched>;
    /// Whether the light is on.
    async fn is_on(&mut self) -> DeviceResult<bool>;
}

/// A level that must hold while anything moves or shines: a door switch, an emergency stop.
#[async_trait]
pub trait Interlock: Send {
    /// Identity.
    fn describe(&self) -> InterlockInfo;
    /// The level now, and how often it changed.
    async fn level(&mut self) -> DeviceResult<Level>;
}

/// What a panel shows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Pattern {
    /// Nothing.
    Black,
    /// A white disc.
    Disc {
        /// Its middle, from the panel's middle to the right and up, in mm.
        center_mm: [f64; 2],
        /// Its diameter in mm.
        diameter_mm: f64,
    },
    /// Stripes over the whole panel: luminance (1 + cos 2π(f · x + phase)) / 2 of white. Without any frequency f it is even: white at
    /// phase 0, half of that at a quarter.
    Fringes {
        /// Spatial frequency to the right and up, in cycles per mm.
        cycles_per_mm: [f64; 2],
        /// Phase at the panel's middle in cycles.
        phase: f64,
        /// Exponent that the panel is taken to have where nothing better is known: it is sent luminance^(1/gamma).
        gamma: f64,
    },
}

/// The stage stands still.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Arrived {
    /// Since when, settling included.
    pub since: Duration,
    /// Where, as it reports.
    pub angle_deg: f64,
}

/// The panel acknowledges a pattern.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Shown {
    /// Since when it can be seen.
    pub since: Duration,
    /// The pattern it says that it shows.
    pub pattern: Pattern,
}

/// The flash was switched.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Switched {
    /// Since when the light is steady.
    pub since: Duration,
    /// Its state as read back.
    pub on: bool,
}

/// Level of an interlock.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Level {
    /// Whether it holds now.
    pub holds: bool,
    /// How often it changed so far, so that a short opening is not missed.
    pub changes: u64,
}

/// Camera controls in force.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
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
    /// The driver says that the frame is damaged.
    pub damaged: bool,
    /// Codes; none if the frame is not fresh.
    pub codes: Vec<u16>,
}

/// What a stage is and can do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StageInfo {
    /// Stable identity: kind and serial number.
    pub id: String,
    /// Speed in degrees per second.
    pub speed_deg_s: f64,
    /// Time to stand still after a move.
    pub settling_s: f64,
    /// Lowest and highest angle that it may be sent to.
    pub limits_deg: [f64; 2],
    /// A reported angle may differ from the asked one by this much.
    pub tolerance_deg: f64,
    /// Angles are approached from this far below, so that backlash has no say; 0 for straight moves.
    pub approach_deg: f64,
    /// The longest that a movement may take, with homing before it.
    pub longest_s: f64,
    /// A movement can be cut short.
    pub halts: bool,
    /// A person turns it, so a move takes as long as it takes.
    pub by_hand: bool,
}

/// What a camera is and can do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
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
    /// Code of no light.
    pub black: u16,
    /// Code of a saturated pixel.
    pub white: u16,
    /// Readout time in seconds.
    pub readout_s: f64,
    /// Frames until changed controls act, as measured.
    pub control_lag_frames: u32,
    /// Whether it has a shutter that can be closed.
    pub shutter: bool,
    /// Electrons that make a pixel white at gain 1, where known.
    pub full_scale_e: Option<f64>,
    /// Read noise in electrons, where known.
    pub read_noise_e: Option<f64>,
    /// Exposures in seconds that suit the panel: whole periods of its refresh, where that is known.
    pub steady_exposures_s: Vec<f64>,
    /// What the user should know: a lossy format, what the camera goes on doing by itself.
    pub warnings: Vec<String>,
}

/// What a panel is and can do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DisplayInfo {
    /// Stable identity.
    pub id: String,
    /// Width and height in mm.
    pub size_mm: [f64; 2],
}

/// What a flash is and can do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FlashInfo {
    /// Stable identity.
    pub id: String,
    /// Time from the command until the light is steady.
    pub settling_s: f64,
    /// It must not be on for longer than this at a time.
    pub max_on_s: f64,
}

/// What an interlock is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct InterlockInfo {
    /// Stable identity.
    pub id: String,
}

impl Pattern {
    /// Half the width and height that it needs around the panel's middle, in mm.
    pub fn reach_mm(&self) -> [f64; 2] {
        match self {
            // Whatever its size, the panel is full of fringes.
            Self::Black | Self::Fringes { .. } => [0.0, 0.0],
            Self::Disc { center_mm, diameter_mm } => center_mm.map(|c| c.abs() + 0.5 * diameter_mm),
        }
    }

    /// Luminance of fringes at a place, from the panel's middle to the right and up in mm: 0 to 1.
    pub fn fringe([fx, fy]: [f64; 2], phase: f64, [x, y]: [f64; 2]) -> f64 {
        0.5 + 0.5 * (std::f64::consts::TAU * (fx * x + fy * y + phase)).cos()
    }
}
