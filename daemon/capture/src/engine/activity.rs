//! Activities of the bench, for people who watch a session.

use serde::Serialize;
use std::time::Duration;

/// Activity of the devices.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "activity", rename_all = "snake_case")]
pub enum Activity {
    /// The stage seeks its mechanical zero.
    Homing,
    /// The analyser turns.
    Turning {
        /// Target angle in degrees.
        analyser_deg: f64,
    },
    /// The light changes.
    Lighting,
    /// The camera exposes.
    Exposing {
        /// Exposure time in seconds.
        exposure_s: f64,
    },
    /// All frames are taken; the last ones are written to the disk.
    Saving,
}

impl Activity {
    /// An exposure of this time.
    pub(super) fn exposing(exposure: Duration) -> Self {
        Self::Exposing { exposure_s: exposure.as_secs_f64() }
    }
}
