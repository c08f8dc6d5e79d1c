//! Mounting of the analyser on a stage's axis: zero, sense, gear ratio, direction of approach, and whole turns.

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
///
/// Where the limits allow more than a turn, a movement takes the shorter way to an angle that is equal modulo 360°.
pub struct Mounted {
    axis: Box<dyn Stage>,
    mounting: Mounting,
    /// Whole turns in degrees that the axis has made beyond the stated angle.
    turns_deg: f64,
    /// Where the last movement ended, whole turns included; `None` if it failed or there was none.
    stands_deg: Option<f64>,
}

impl Mounted {
    /// Mounts an analyser on an axis.
    pub fn new(axis: Box<dyn Stage>, mounting: Mounting) -> Self {
        Self { axis, mounting, turns_deg: 0.0, stands_deg: None }
    }

    /// Moves to an angle with its whole turns.
    async fn turn(&mut self, to_deg: f64) -> DeviceResult<Arrived> {
        self.stands_deg = None;
        let arrived = self.axis.move_to(self.mounting.axis_deg(to_deg)).await?;
        self.stands_deg = Some(to_deg);
        Ok(self.arrived(arrived))
    }

    fn arrived(&self, arrived: Arrived) -> Arrived {
        Arrived { angle_deg: self.stated(arrived.angle_deg), ..arrived }
    }

    /// Analyser angle without the whole turns of the axis.
    fn stated(&self, axis_deg: f64) -> f64 {
        self.mounting.analyser_deg(axis_deg) - self.turns_deg
    }
}

/// The angle nearest to `stands_deg` that equals `angle_deg` modulo 360°. Ends of the range are left free for the
/// approach from below: an angle within `approach_deg` of a limit is only reached from as close.
fn nearest(stands_deg: f64, angle_deg: f64, [low, high]: [f64; 2], approach_deg: f64) -> f64 {
    if high - low < 360.0 + 2.0 * approach_deg {
        return angle_deg;
    }
    let distance = |to: f64| (to - stands_deg).abs();
    let free = |to: f64| (low + approach_deg..=high - approach_deg).contains(&to);
    let close = |to: f64| (low..=high).contains(&to) && distance(to) <= approach_deg + 1e-6;
    let turn = ((stands_deg - angle_deg) / 360.0).round();
    let candidates = [turn - 1.0, turn, turn + 1.0].map(|n| angle_deg + 360.0 * n);
    let permitted = candidates.into_iter().filter(|to| free(*to) || close(*to));
    permitted.min_by(|a, b| distance(*a).total_cmp(&distance(*b))).unwrap_or(angle_deg)
}

#[async_trait]
impl Stage for Mounted {
    fn describe(&self) -> StageInfo {
        self.mounting.seen(self.axis.describe())
    }

    /// Homes the axis, then turns the analyser to 0°.
    async fn home(&mut self) -> DeviceResult<Arrived> {
        (self.turns_deg, self.stands_deg) = (0.0, None);
        let arrived = self.axis.home().await?;
        if self.mounting.axis_deg(0.0) != arrived.angle_deg {
            return self.turn(0.0).await;
        }
        self.stands_deg = Some(0.0);
        Ok(self.arrived(arrived))
    }

    async fn move_to(&mut self, angle_deg: f64) -> DeviceResult<Arrived> {
        let StageInfo { id, limits_deg, approach_deg, .. } = self.describe();
        check::angle(&id, &format!("move to {angle_deg}°"), angle_deg, limits_deg, "mounting")?;
        let stands_deg = self.stands_deg;
        let to = stands_deg.map_or(angle_deg, |at| nearest(at, angle_deg, limits_deg, approach_deg));
        let other_turn = to - angle_deg != self.turns_deg;
        self.turns_deg = to - angle_deg;
        if other_turn && stands_deg.is_some_and(|at| to < at) {
            // The caller expects a movement from below.
            self.turn((to - approach_deg).max(limits_deg[0])).await?;
        }
        self.turn(to).await
    }

    async fn halt(&mut self) -> DeviceResult<()> {
        self.axis.halt().await
    }

    async fn position(&mut self) -> DeviceResult<f64> {
        let axis_deg = self.axis.position().await?;
        Ok(self.stated(axis_deg))
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
        /// Travel beyond -90° to 360°.
        more_deg: f64,
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
                limits_deg: [-90.0 - self.more_deg, 360.0 + self.more_deg],
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
    fn the_way_to_an_angle_is_the_shorter_one() {
        let axis = Axis { more_deg: 360.0, ..Axis::default() };
        let mut stage = Mounted::new(Box::new(axis.clone()), mounting(0.0, Sense::Anticlockwise, 1.0));
        let mut to = |angle| wait(stage.move_to(angle)).unwrap().angle_deg;
        for angle in [330.0, -5.0, 0.0, 90.0, 180.0, 350.0, 354.9] {
            assert!((to(angle) - angle).abs() < 1e-9);
        }
        assert_eq!(*axis.sent.lock().unwrap(), [330.0, 355.0, 360.0, 450.0, 540.0, 710.0, 714.9]);
        assert!((to(358.0) - 358.0).abs() < 1e-9);
        // 12° up are beyond the travel: it goes back a turn, from below.
        assert!((to(370.0) - 370.0).abs() < 1e-9);
        assert_eq!(axis.sent.lock().unwrap()[7..], [718.0, 365.0, 370.0]);
        assert!((wait(stage.position()).unwrap() - 370.0).abs() < 1e-9);
        assert_eq!(wait(stage.home()).unwrap().angle_deg, 0.0);
    }

    proptest! {
        /// The last movement is upward, as the engine approaches every angle, and at most a turn and the approach long.
        #[test]
        fn angles_are_approached_from_below(angles in prop::collection::vec(-85.0..355.0_f64, 2..30), more in 0.0..1000.0_f64) {
            let axis = Axis { more_deg: more, ..Axis::default() };
            let mut stage = Mounted::new(Box::new(axis.clone()), Mounting::default());
            let mut before = f64::INFINITY;
            for (k, angle) in angles.into_iter().enumerate() {
                for stop in if angle <= before { vec![angle - 5.0, angle] } else { vec![angle] } {
                    prop_assert!((wait(stage.move_to(stop)).unwrap().angle_deg - stop).abs() < 1e-8);
                    before = stop;
                }
                let sent = axis.sent.lock().unwrap();
                prop_assert!(sent.iter().all(|a| (-90.0 - more..=360.0 + more).contains(a)));
                if let [.., second, last] = sent[..] && k > 0 {
                    prop_assert!(last >= second, "{sent:?}");
                }
            }
        }
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
