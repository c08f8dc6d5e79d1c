//! The devices of a bench, as seen by the capture engine.
//!
//! Every call returns the device's own report of its state, or an error. The engine compares the report with the
//! request. Angles are in degrees, times are on the bench's clock.

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
    /// Stops a movement whose call was dropped, or waits for its end if it cannot be stopped ([`StageInfo::halts`]).
    async fn halt(&mut self) -> DeviceResult<()>;
    /// Present angle.
    async fn position(&mut self) -> DeviceResult<f64>;
}

/// The camera.
#[async_trait]
pub trait Camera: Send {
    /// Identity and limits.
    fn describe(&self) -> CameraInfo;
    /// Sets exposure and gain, and reads back the values in force.
    async fn configure(&mut self, exposure: Duration, gain: f64) -> DeviceResult<Controls>;
    /// Closes or opens the shutter; returns the time of completion.
    async fn cover(&mut self, closed: bool) -> DeviceResult<Duration>;
    /// The next frame in the camera's queue, regardless of its age; waits if the queue is empty. A frame that is not
    /// fresh may lack its codes, which saves decoding.
    async fn next_frame(&mut self, fresh: Freshness) -> DeviceResult<Frame>;
}

/// The display (LCD).
#[async_trait]
pub trait Display: Send {
    /// Identity and limits.
    fn describe(&self) -> DisplayInfo;
    /// Shows a pattern; returns once it is visible.
    async fn show(&mut self, pattern: Pattern) -> DeviceResult<Shown>;
    /// Ensures that the display emits no light. Unlike a black pattern this needs no confirmation on the screen: a
    /// hidden display page is dark.
    async fn dark(&mut self) -> DeviceResult<Shown> {
        self.show(Pattern::Black).await
    }
    /// Checks that the last pattern is still visible, for displays that other programs may cover.
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

/// A level that must hold during any motion or light: a door switch, an emergency stop.
#[async_trait]
pub trait Interlock: Send {
    /// Identity.
    fn describe(&self) -> InterlockInfo;
    /// Present level, and number of changes.
    async fn level(&mut self) -> DeviceResult<Level>;
}

/// Pattern on a display.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Pattern {
    /// Black.
    Black,
    /// A white disc.
    Disc {
        /// Centre in mm, from the display's centre to the right and up.
        center_mm: [f64; 2],
        /// Diameter in mm.
        diameter_mm: f64,
    },
    /// Fringes over the whole display: luminance (1 + cos 2π(f · x + phase)) / 2 of white. With f = 0 the display is
    /// uniform: white at phase 0, half of that at a quarter.
    Fringes {
        /// Spatial frequency to the right and up, in cycles per mm.
        cycles_per_mm: [f64; 2],
        /// Phase at the display's centre in cycles.
        phase: f64,
        /// Assumed exponent (gamma) of a display without a known tone curve: the code is luminance^(1/gamma).
        gamma: f64,
    },
}

/// Report of a stage that stands still.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Arrived {
    /// Start of standstill, settling included.
    pub since: Duration,
    /// Reported angle in degrees.
    pub angle_deg: f64,
}

/// A display's acknowledgement of a pattern.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Shown {
    /// Time since which the pattern is visible.
    pub since: Duration,
    /// Pattern as reported by the display.
    pub pattern: Pattern,
}

/// Report of a switched flash.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Switched {
    /// Time since which the light is steady.
    pub since: Duration,
    /// State as read back.
    pub on: bool,
}

/// Level of an interlock.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Level {
    /// Whether it holds at present.
    pub holds: bool,
    /// Number of changes so far, so that a brief opening is not missed.
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

/// One frame: codes of one channel, row-major, row 0 at the top.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Sequence number and timestamp.
    pub stamp: Stamp,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Whether the driver flags the frame as damaged.
    pub damaged: bool,
    /// Codes; empty if the frame is not fresh.
    pub codes: Vec<u16>,
}

/// Identity and limits of a stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StageInfo {
    /// Stable identity: model and serial number.
    pub id: String,
    /// Speed in degrees per second.
    pub speed_deg_s: f64,
    /// Settling time after a move in s.
    pub settling_s: f64,
    /// Lowest and highest permitted angle in degrees.
    pub limits_deg: [f64; 2],
    /// Largest accepted difference between reported and requested angle in degrees.
    pub tolerance_deg: f64,
    /// Distance below the target from which angles are approached, against backlash; 0 for direct moves.
    pub approach_deg: f64,
    /// Maximum time of a movement in s, including homing before it.
    pub longest_s: f64,
    /// Whether a movement can be stopped.
    pub halts: bool,
    /// Whether a person turns it, so that a move may take arbitrarily long.
    pub by_hand: bool,
}

/// Identity and limits of a camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraInfo {
    /// Stable identity: model and serial number.
    pub id: String,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Shortest and longest exposure in s.
    pub exposure_s: [f64; 2],
    /// Exposure in force before any is set, in s.
    pub exposure_now_s: f64,
    /// Lowest and highest gain.
    pub gain: [f64; 2],
    /// Code of black.
    pub black: u16,
    /// Code of a saturated pixel.
    pub white: u16,
    /// Readout time in s.
    pub readout_s: f64,
    /// Frames until changed controls take effect, as measured.
    pub control_lag_frames: u32,
    /// Whether it has a shutter that can be closed.
    pub shutter: bool,
    /// Full-well capacity at gain 1 in electrons, if known.
    pub full_scale_e: Option<f64>,
    /// Read noise in electrons, if known.
    pub read_noise_e: Option<f64>,
    /// Exposures in s that are whole refresh periods of the display; empty if its refresh rate is unknown.
    pub steady_exposures_s: Vec<f64>,
    /// Exposures in s that the camera offers, in any order; empty if any in the range is possible.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub exposure_choices_s: Vec<f64>,
    /// Whether a person takes the photographs, so that a frame may take arbitrarily long.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub by_hand: bool,
    /// Warnings for the user: a lossy format, automatic functions that cannot be disabled.
    pub warnings: Vec<String>,
}

/// Identity and size of a display.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DisplayInfo {
    /// Stable identity.
    pub id: String,
    /// Width and height in mm.
    pub size_mm: [f64; 2],
}

/// Identity and limits of a flash.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FlashInfo {
    /// Stable identity.
    pub id: String,
    /// Time from the command until the light is steady, in s.
    pub settling_s: f64,
    /// Maximum continuous on-time in s.
    pub max_on_s: f64,
}

/// Identity of an interlock.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct InterlockInfo {
    /// Stable identity.
    pub id: String,
}

/// Relative tolerance between a requested exposure and one that a camera offers. Cameras label their exposures with
/// rounded values, such as 1/60 s.
pub const EXPOSURE_TOLERANCE: f64 = 0.05;

impl CameraInfo {
    /// The exposure that the camera offers for a requested one in s; the request itself if any is possible.
    ///
    /// # Errors
    /// The next shorter and next longer exposures in s, if none is within [`EXPOSURE_TOLERANCE`].
    pub fn choice(&self, seconds: f64) -> Result<f64, Vec<f64>> {
        if self.exposure_choices_s.is_empty() {
            return Ok(seconds);
        }
        let off = |choice: &f64| (choice / seconds - 1.0).abs();
        let nearest = self.exposure_choices_s.iter().copied().min_by(|a, b| off(a).total_cmp(&off(b)));
        if let Some(choice) = nearest.filter(|choice| off(choice) <= EXPOSURE_TOLERANCE) {
            return Ok(choice);
        }
        let shorter = self.exposure_choices_s.iter().copied().filter(|s| *s < seconds).max_by(f64::total_cmp);
        let longer = self.exposure_choices_s.iter().copied().filter(|s| *s > seconds).min_by(f64::total_cmp);
        Err(shorter.into_iter().chain(longer).collect())
    }

    /// The longest exposure that the camera offers within a requested one in s, or else its shortest one.
    pub fn at_most(&self, seconds: f64) -> f64 {
        let fits = |s: &f64| *s <= seconds * (1.0 + 1e-9);
        let choices = || self.exposure_choices_s.iter().copied();
        let shortest = choices().min_by(f64::total_cmp);
        choices().filter(fits).max_by(f64::total_cmp).or(shortest).unwrap_or(seconds)
    }
}

impl Pattern {
    /// Half the width and height that the pattern requires around the display's centre, in mm.
    pub fn reach_mm(&self) -> [f64; 2] {
        match self {
            // Fringes fill a display of any size.
            Self::Black | Self::Fringes { .. } => [0.0, 0.0],
            Self::Disc { center_mm, diameter_mm } => center_mm.map(|c| c.abs() + 0.5 * diameter_mm),
        }
    }

    /// Relative luminance of fringes, 0 to 1, at a position in mm from the display's centre to the right and up.
    pub fn fringe([fx, fy]: [f64; 2], phase: f64, [x, y]: [f64; 2]) -> f64 {
        0.5 + 0.5 * (std::f64::consts::TAU * (fx * x + fy * y + phase)).cos()
    }
}
