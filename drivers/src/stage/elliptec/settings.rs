//! Configuration of an Elliptec stage.

use super::protocol::Address;
use crate::stage::check;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// A rotation stage of Thorlabs' Elliptec series: ELL14, ELL18 and related models.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Serial port, such as /dev/ttyUSB0 or a link in /dev/serial/by-id.
    pub port: PathBuf,
    /// Address on the bus, 0 to 9 or A to F.
    pub address: Address,
    /// Maximum time for an answer, in ms.
    pub answer_ms: u64,
    /// Maximum time of a movement, homing included, in ms.
    pub move_ms: u64,
    /// Settling time after a move, in ms.
    pub settling_ms: u64,
    /// Speed in degrees per second, for time estimates.
    pub speed_deg_s: f64,
    /// Largest accepted difference between reported and requested angle, in degrees.
    pub tolerance_deg: f64,
    /// Lowest and highest angle of the axis in degrees.
    pub limits_deg: [f64; 2],
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            port: PathBuf::new(),
            address: Address::default(),
            answer_ms: 600,
            move_ms: 15_000,
            settling_ms: 100,
            speed_deg_s: 300.0,
            tolerance_deg: 0.2,
            limits_deg: [0.0, 360.0],
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
        check::milliseconds("answer_ms", self.answer_ms, 1)?;
        check::milliseconds("move_ms", self.move_ms, 1)?;
        check::milliseconds("settling_ms", self.settling_ms, 0)?;
        check::number("speed_deg_s", self.speed_deg_s, 0.1, 1e4)?;
        check::number("tolerance_deg", self.tolerance_deg, 1e-3, 5.0)?;
        check::limits(self.limits_deg)
    }
}
