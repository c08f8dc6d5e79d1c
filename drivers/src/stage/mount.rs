//! How the analyser sits on a stage's axis: zero, sense, gearing, and from which side angles are approached.

use crate::{Arrived, DeviceResult, Stage, StageInfo};
use async_trait::async_trait;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// In which sense the analyser turns, as the camera sees it, when the axis turns to larger angles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Sense {
    /// As analyser angles count.
    #[default]
    Anticlockwise,
    /// Against it.
    Clockwise,
}

/// How the analyser sits on the axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Mounting {
    /// Angle of the axis, in degrees, at which the analyser stands at 0° (transmits what is polarized along image right).
    pub zero_deg: f64,
    /// In which sense the analyser turns when the axis turns to larger angles.
    pub sense: Sense,
    /// Turns of the axis per turn of the analyser.
    pub gear: f64,
    /// Angles are approached from this far below, in degrees of the analyser: more than the backlash of gears and belts.
    pub approach_deg: f64,
    /// Lowest and highest angle of the analyser, where cables or stops limit it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub limits_deg: Option<[f64; 2]>,
}

impl Default for Mounting {
    fn default() -> Self {
        Self { zero_deg: 0.0, sense: Sense::Anticlockwise, gear: 1.0, approach_deg: 5.0, limits_deg: None }
    }
}

impl Mounting {
    /// Says what is wrong with it.
    ///
    /// # Errors
    /// The key and what it must be.
    pub fn check(&self) -> Result<(), String> {
        let sane = |v: f64, low: f64, high: f64| v >= low && v <= high;
        if !sane(self.zero_deg, -1e4, 1e4) {
            return Err(format!("mounting.zero_deg is {}; give degrees", self.zero_deg));
        }
        if !sane(self.gear, 1e-3, 1e3) {
            return Err(format!("mounting.gear is {}; give turns of the axis per turn of the analyser", self.gear));
        }
        if !sane(self.approach_deg, 0.0, 90.0) {
            return Err(format!("mounting.approach_deg is {}; give 0 to 90", self.approach_deg));
        }
        match self.limits_deg {
            Some([low, high]) if !(sane(low, -1e5, 1e5) && sane(high, -1e5, 1e5) && high - low >= 180.0) => {
                Err(format!("mounting.limits_deg is [{low}, {high}]; give at least half a turn"))
            }
            _ => Ok(()),
        }
    }

    fn slope(&self) -> f64 {
        match self.sense {
            Sense::Anticlockwise => self.gear,
            Sense::Clockwise => -self.gear,
        }
    }

    /// Angle of the axis at which the analyser stands at `analyser_deg`.
    pub fn axis_deg(&self, analyser_deg: f64) -> f64 {
        self.zero_deg + self.slope() * analyser_deg
    }

    /// Angle of the analyser when the axis stands at `axis_deg`.
    pub fn analyser_deg(&self, axis_deg: f64) -> f64 {
        (axis_deg - self.zero_deg) / self.slope()
    }
}

/// A stage as the analyser that sits on it: all angles are the analyser's.
pub struct Mounted {
    axis: Box<dyn Stage>,
    mounting: Mounting,
}

impl Mounted {
    /// Puts an analyser on an axis.
    pub fn new(axis: Box<dyn Stage>, mounting: Mounting) -> Self {
        Self { axis, mounting }
    }

    fn seen(&self, arrived: Arrived) -> Arrived {
        Arrived { angle_deg: self.mounting.analyser_deg(arrived.angle_deg), ..arrived }
    }
}

#[async_trait]
impl Stage for Mounted {
    fn describe(&self) -> StageInfo {
        let axis = self.axis.describe();
        let mut reach = axis.limits_deg.map(|a| self.mounting.analyser_deg(a));
        reach.sort_by(f64::total_cmp);
        let limits_deg = match self.mounting.limits_deg {
            Some([low, high]) => [low.max(reach[0]), high.min(reach[1])],
            None => reach,
        };
        StageInfo {
            speed_deg_s: axis.speed_deg_s / self.mounting.gear,
            tolerance_deg: axis.tolerance_deg / self.mounting.gear,
            approach_deg: self.mounting.approach_deg,
            limits_deg,
            ..axis
        }
    }

    /// Homes the axis, then turns the analyser to 0°.
    async fn home(&mut self) -> DeviceResult<Arrived> {
        let arrived = self.axis.home().await?;
        let zero = self.mounting.axis_deg(0.0);
        let arrived = if zero == arrived.angle_deg { arrived } else { self.axis.move_to(zero).await? };
        Ok(self.seen(arrived))
    }

    async fn move_to(&mut self, angle_deg: f64) -> DeviceResult<Arrived> {
        let arrived = self.axis.move_to(self.mounting.axis_deg(angle_deg)).await?;
        Ok(self.seen(arrived))
    }

    async fn halt(&mut self) -> DeviceResult<()> {
        self.axis.halt().await
    }

    async fn position(&mut self) -> DeviceResult<f64> {
        Ok(self.mounting.analyser_deg(self.axis.position().await?))
    }
}
