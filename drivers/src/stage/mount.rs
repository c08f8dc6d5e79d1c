//! Mounting of the analyser on a stage's axis: zero, sense, gear ratio, and direction of approach.

use super::check;
use crate::{Arrived, DeviceResult, Stage, StageInfo};
use async_trait::async_trait;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Sense in which the analyser turns, as seen by the camera, for increasing axis angles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Sense {
    /// The sense of increasing analyser angles.
    #[default]
    Anticlockwise,
    /// The opposite sense.
    Clockwise,
}

/// Mounting of the analyser on the axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Mounting {
    /// Axis angle in degrees for the analyser at 0° (transmission axis along image right).
    pub zero_deg: f64,
    /// Sense in which the analyser turns for increasing axis angles.
    pub sense: Sense,
    /// Turns of the axis per turn of the analyser.
    pub gear: f64,
    /// Distance below the target from which angles are approached, in degrees of the analyser: more than the backlash
    /// of gears and belts.
    pub approach_deg: f64,
    /// Lowest and highest angle of the analyser in degrees, if cables or stops limit it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub limits_deg: Option<[f64; 2]>,
}

impl Default for Mounting {
    fn default() -> Self {
        Self { zero_deg: 0.0, sense: Sense::Anticlockwise, gear: 1.0, approach_deg: 5.0, limits_deg: None }
    }
}

impl Mounting {
    /// Checks the settings.
    ///
    /// # Errors
    /// The invalid key and its valid values.
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
            Some([low, high]) if !(sane(low, -1e5, 0.0) && sane(high, 0.0, 1e5) && high - low >= 180.0) => {
                Err(format!("mounting.limits_deg is [{low}, {high}]; give at least half a turn, with 0 in it"))
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

    /// Axis angle for the analyser at `analyser_deg`.
    pub fn axis_deg(&self, analyser_deg: f64) -> f64 {
        self.zero_deg + self.slope() * analyser_deg
    }

    /// Analyser angle for the axis at `axis_deg`.
    pub fn analyser_deg(&self, axis_deg: f64) -> f64 {
        (axis_deg - self.zero_deg) / self.slope()
    }

    /// Converts the axis' properties to those of the mounted analyser.
    pub fn seen(&self, axis: StageInfo) -> StageInfo {
        let mut reach = axis.limits_deg.map(|a| self.analyser_deg(a));
        reach.sort_by(f64::total_cmp);
        let limits_deg = match self.limits_deg {
            Some([low, high]) => [low.max(reach[0]), high.min(reach[1])],
            None => reach,
        };
        StageInfo {
            speed_deg_s: axis.speed_deg_s / self.gear,
            tolerance_deg: axis.tolerance_deg / self.gear,
            approach_deg: self.approach_deg,
            // After homing, the axis moves to the analyser's zero.
            longest_s: 2.0 * axis.longest_s,
            limits_deg,
            ..axis
        }
    }
}

/// A stage with a mounted analyser: all angles are analyser angles.
pub struct Mounted {
    axis: Box<dyn Stage>,
    mounting: Mounting,
}

impl Mounted {
    /// Mounts an analyser on an axis.
    pub fn new(axis: Box<dyn Stage>, mounting: Mounting) -> Self {
        Self { axis, mounting }
    }

    fn arrived(&self, arrived: Arrived) -> Arrived {
        Arrived { angle_deg: self.mounting.analyser_deg(arrived.angle_deg), ..arrived }
    }
}

#[async_trait]
impl Stage for Mounted {
    fn describe(&self) -> StageInfo {
        self.mounting.seen(self.axis.describe())
    }

    /// Homes the axis, then turns the analyser to 0°.
    async fn home(&mut self) -> DeviceResult<Arrived> {
        let arrived = self.axis.home().await?;
        let zero = self.mounting.axis_deg(0.0);
        if zero == arrived.angle_deg { Ok(self.arrived(arrived)) } else { self.move_to(0.0).await }
    }

    async fn move_to(&mut self, angle_deg: f64) -> DeviceResult<Arrived> {
        let StageInfo { id, limits_deg, .. } = self.describe();
        check::angle(&id, &format!("move to {angle_deg}°"), angle_deg, limits_deg, "mounting")?;
        let arrived = self.axis.move_to(self.mounting.axis_deg(angle_deg)).await?;
        Ok(self.arrived(arrived))
    }

    async fn halt(&mut self) -> DeviceResult<()> {
        self.axis.halt().await
    }

    async fn position(&mut self) -> DeviceResult<f64> {
        Ok(self.mounting.analyser_deg(self.axis.position().await?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::wait;
    use crate::{Class, DeviceError};
    use proptest::prelude::*;
    use std::sync::{Arc, Mutex};
    use std::time::Duration;

    /// A fake axis that reaches every target, with a log.
    #[derive(Clone, Default)]
    struct Axis {
        sent: Arc<Mutex<Vec<f64>>>,
        /// Position after homing.
        home_deg: f64,
    }

    impl Axis {
        fn arrive(&self, angle_deg: f64) -> DeviceResult<Arrived> {
            self.sent.lock().unwrap().push(angle_deg);
            Ok(Arrived { since: Duration::from_secs(7), angle_deg })
        }
    }

    #[async_trait]
    impl Stage for Axis {
        fn describe(&self) -> StageInfo {
            StageInfo {
                longest_s: 1.0,
                id: "axis".into(),
                speed_deg_s: 90.0,
                settling_s: 0.1,
                limits_deg: [-90.0, 360.0],
                tolerance_deg: 0.3,
                approach_deg: 0.0,
                halts: true,
                by_hand: false,
            }
        }

        async fn home(&mut self) -> DeviceResult<Arrived> {
            self.arrive(self.home_deg)
        }

        async fn move_to(&mut self, angle_deg: f64) -> DeviceResult<Arrived> {
            self.arrive(angle_deg)
        }

        async fn halt(&mut self) -> DeviceResult<()> {
            Ok(())
        }

        async fn position(&mut self) -> DeviceResult<f64> {
            let none = || DeviceError::new("axis", "report its position", "an angle", "none");
            self.sent.lock().unwrap().last().copied().ok_or_else(none)
        }
    }

    fn mounting(zero_deg: f64, sense: Sense, gear: f64) -> Mounting {
        Mounting { zero_deg, sense, gear, ..Mounting::default() }
    }

    proptest! {
        #[test]
        fn angles_come_back(share in 0.0..1.0_f64, zero in -360.0..360.0_f64, gear in 0.01..100.0_f64, flip: bool) {
            let sense = if flip { Sense::Clockwise } else { Sense::Anticlockwise };
            let mounting = mounting(zero, sense, gear);
            let mut stage = Mounted::new(Box::new(Axis::default()), mounting);
            let [low, high] = stage.describe().limits_deg;
            let angle = low + share * (high - low);
            prop_assert!((mounting.analyser_deg(mounting.axis_deg(angle)) - angle).abs() < 1e-8);
            let arrived = wait(stage.move_to(angle)).unwrap();
            prop_assert!((arrived.angle_deg - angle).abs() < 1e-8);
            prop_assert!((wait(stage.position()).unwrap() - angle).abs() < 1e-8);
            prop_assert_eq!(arrived.since, Duration::from_secs(7));
            for beyond in [low - 1.0, high + 1.0, f64::NAN] {
                prop_assert_eq!(wait(stage.move_to(beyond)).unwrap_err().class, Class::Setup);
            }
        }

        #[test]
        fn limits_are_those_of_the_axis(zero in -90.0..90.0_f64, gear in 0.5..3.0_f64, flip: bool) {
            let sense = if flip { Sense::Clockwise } else { Sense::Anticlockwise };
            let mounting = mounting(zero, sense, gear);
            let [low, high] = Mounted::new(Box::new(Axis::default()), mounting).describe().limits_deg;
            prop_assert!(low < high);
            for angle in [low, high, 0.5 * (low + high)] {
                let axis = mounting.axis_deg(angle);
                prop_assert!((-90.0 - 1e-9..=360.0 + 1e-9).contains(&axis), "{axis}");
            }
        }
    }

    #[test]
    fn a_gear_divides_speed_and_tolerance_and_own_limits_narrow() {
        let mounting = Mounting { limits_deg: Some([-10.0, 400.0]), ..mounting(30.0, Sense::Anticlockwise, 2.0) };
        let info = Mounted::new(Box::new(Axis::default()), mounting).describe();
        assert_eq!((info.speed_deg_s, info.tolerance_deg, info.approach_deg), (45.0, 0.15, 5.0));
        assert_eq!(info.limits_deg, [-10.0, 165.0]);
    }

    #[test]
    fn homing_ends_at_the_analysers_zero() {
        for (zero, home, sent) in [(30.0, 0.0, vec![0.0, 30.0]), (30.0, 30.0, vec![30.0]), (0.0, -1.0, vec![-1.0, 0.0])]
        {
            let axis = Axis { home_deg: home, ..Axis::default() };
            let mut stage = Mounted::new(Box::new(axis.clone()), mounting(zero, Sense::Clockwise, 1.0));
            assert_eq!(wait(stage.home()).unwrap().angle_deg, 0.0);
            assert_eq!(*axis.sent.lock().unwrap(), sent);
        }
    }

    #[test]
    fn defects_of_a_mounting_are_named() {
        let good = Mounting::default();
        for (wrong, key) in [
            (Mounting { gear: 0.0, ..good }, "gear"),
            (Mounting { gear: f64::NAN, ..good }, "gear"),
            (Mounting { zero_deg: f64::INFINITY, ..good }, "zero_deg"),
            (Mounting { approach_deg: -1.0, ..good }, "approach_deg"),
            (Mounting { limits_deg: Some([0.0, 90.0]), ..good }, "limits_deg"),
        ] {
            assert!(wrong.check().unwrap_err().contains(key));
        }
        assert_eq!(good.check(), Ok(()));
    }
}
