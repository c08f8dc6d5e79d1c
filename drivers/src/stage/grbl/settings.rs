//! Configuration of a GRBL axis.

use super::protocol::Axis;
use crate::stage::check;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// A rotary axis on a motor controller that runs GRBL 1.1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Serial port, such as /dev/ttyACM0 or a link in /dev/serial/by-id.
    pub port: PathBuf,
    /// Baud rate.
    pub baud: u32,
    /// Letter of the axis; boards without rotary axes use X, Y or Z.
    pub axis: Axis,
    /// Degrees per unit of the axis: 1 if its steps per unit ($103, or $100 for X) are steps per degree.
    pub degrees_per_unit: f64,
    /// Speed in degrees per minute.
    pub feed_deg_min: f64,
    /// Whether the axis has a switch at its zero and homes ($H). Otherwise its zero is the position at which the
    /// controller started.
    pub homes: bool,
    /// Maximum time for an answer, in ms.
    pub answer_ms: u64,
    /// Maximum start-up time after the port is opened, in ms.
    pub start_ms: u64,
    /// Maximum time of a movement, in ms.
    pub move_ms: u64,
    /// Maximum time of homing, in ms.
    pub home_ms: u64,
    /// Settling time after a move, in ms.
    pub settling_ms: u64,
    /// Largest accepted difference between reported and requested angle, in degrees.
    pub tolerance_deg: f64,
    /// Lowest and highest angle of the axis in degrees.
    pub limits_deg: [f64; 2],
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            port: PathBuf::new(),
            baud: 115_200,
            axis: Axis::default(),
            degrees_per_unit: 1.0,
            feed_deg_min: 3600.0,
            homes: true,
            answer_ms: 500,
            start_ms: 5000,
            move_ms: 60_000,
            home_ms: 60_000,
            settling_ms: 200,
            tolerance_deg: 0.1,
            limits_deg: [-360.0, 720.0],
        }
    }
}

impl Settings {
    /// Checks the settings.
    ///
    /// # Errors
    /// The invalid key and its valid values.
    pub fn check(&self) -> Result<(), String> {
        check::port(&self.port)?;
        check::number("degrees_per_unit", self.degrees_per_unit.abs(), 1e-3, 1e3)?;
        check::number("feed_deg_min", self.feed_deg_min, 1.0, 1e6)?;
        for (key, value) in [
            ("answer_ms", self.answer_ms),
            ("start_ms", self.start_ms),
            ("move_ms", self.move_ms),
            ("home_ms", self.home_ms),
        ] {
            check::milliseconds(key, value, 1)?;
        }
        check::milliseconds("settling_ms", self.settling_ms, 0)?;
        check::number("tolerance_deg", self.tolerance_deg, 1e-3, 5.0)?;
        check::limits(self.limits_deg)
    }
}
