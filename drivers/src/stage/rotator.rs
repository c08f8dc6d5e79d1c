//! Rotators of device servers (ASCOM Alpaca, INDI), whose angles are those of a circle.
//!
//! The angle nearest to the target is reported: 359.99° is -0.01° for a target of 0°. A move is complete only when the
//! rotator stands at its target, regardless of its other answers.

use super::check;
use super::zero::Zero;
use crate::{Arrived, Class, Clock, DeviceError, DeviceResult, Stage, StageInfo};
use async_trait::async_trait;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Interval of queries during a movement.
const POLL: Duration = Duration::from_millis(50);
/// Consecutive queries of a rotator that stands away from its target, after which the move has failed. Some servers
/// report the start of a movement late.
const STILL: u32 = 20;

/// Times, angles and limits of a rotator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Motion {
    /// Maximum time for an answer of the server, in ms.
    pub answer_ms: u64,
    /// Maximum time of a movement, in ms.
    pub move_ms: u64,
    /// Settling time after a move, in ms.
    pub settling_ms: u64,
    /// Speed in degrees per second, for time estimates.
    pub speed_deg_s: f64,
    /// Largest accepted difference between reported and requested angle, in degrees.
    pub tolerance_deg: f64,
    /// Lowest and highest angle of the axis in degrees. Angles beyond 0° to 360° are sent as angles of the circle.
    pub limits_deg: [f64; 2],
}

impl Default for Motion {
    fn default() -> Self {
        Self {
            answer_ms: 5000,
            move_ms: 120_000,
            settling_ms: 200,
            speed_deg_s: 5.0,
            tolerance_deg: 0.1,
            limits_deg: [0.0, 360.0],
        }
    }
}

impl Motion {
    /// # Errors
    /// The invalid key and its valid values.
    pub(crate) fn check(&self) -> Result<(), String> {
        check::milliseconds("motion.answer_ms", self.answer_ms, 10)?;
        check::milliseconds("motion.move_ms", self.move_ms, 10)?;
        check::milliseconds("motion.settling_ms", self.settling_ms, 0)?;
        check::number("motion.speed_deg_s", self.speed_deg_s, 1e-3, 1e5)?;
        check::number("motion.tolerance_deg", self.tolerance_deg, 1e-4, 10.0)?;
        check::limits(self.limits_deg)
    }

    /// Maximum time for an answer.
    pub(crate) fn answer(&self) -> Duration {
        Duration::from_millis(self.answer_ms)
    }
}

/// State of a rotator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Reading {
    /// Angle in degrees.
    pub angle_deg: f64,
    /// Whether it moves.
    pub moving: bool,
}

/// A rotator behind a server. Each call ends within the time for an answer.
pub(crate) trait Port: Send {
    /// Stable identity.
    fn id(&self) -> &str;
    /// Whether movements can be stopped.
    fn halts(&self) -> bool;
    /// Reads the present state.
    fn read(&mut self, what: &str) -> DeviceResult<Reading>;
    /// Starts a movement to an angle of the circle, 0° to 360°.
    fn go(&mut self, what: &str, angle_deg: f64) -> DeviceResult<()>;
    /// Stops a movement.
    fn stop(&mut self) -> DeviceResult<()>;
}

/// A rotator as a stage.
pub(crate) struct Rotator<P: Port> {
    port: P,
    motion: Motion,
    clock: Arc<dyn Clock>,
    zero: Zero,
}

/// The angle of the circle nearest to `near`.
fn unwrapped(angle_deg: f64, near: f64) -> f64 {
    angle_deg + 360.0 * ((near - angle_deg) / 360.0).round()
}

/// The angle of the circle within the limits, or nearest to them.
fn within(angle_deg: f64, [low, high]: [f64; 2]) -> f64 {
    let above = low + (angle_deg - low).rem_euclid(360.0);
    let below = above - 360.0;
    if above > high && above - high > low - below { below } else { above }
}

impl<P: Port> Rotator<P> {
    /// A rotator on an open port, whose angle is read.
    ///
    /// # Errors
    /// Those of the port.
    pub fn new(port: P, motion: Motion, clock: Arc<dyn Clock>) -> DeviceResult<Self> {
        let mut rotator = Self { port, motion, clock, zero: Zero::Unchecked };
        rotator.read("report its position")?;
        Ok(rotator)
    }

    fn read(&mut self, what: &str) -> DeviceResult<Reading> {
        let reading = self.port.read(what)?;
        if reading.angle_deg.abs() <= 1e6 {
            return Ok(reading);
        }
        let got = format!("{}", reading.angle_deg);
        Err(DeviceError::new(self.port.id(), what, "an angle in degrees", got).class(Class::Retry))
    }

    fn error(&self, what: &str, expected: impl Into<Box<str>>, got: impl Into<Box<str>>) -> DeviceError {
        DeviceError::new(self.port.id(), what, expected, got)
    }

    /// Waits until the rotator stands, at the target if there is one; returns its angle.
    async fn wait_for_rest(&mut self, what: &str, target_deg: Option<f64>) -> DeviceResult<f64> {
        let until = Instant::now() + Duration::from_millis(self.motion.move_ms);
        let (mut last, mut still) = (f64::NAN, 0);
        loop {
            let Reading { angle_deg, moving } = self.read(what)?;
            let at = unwrapped(angle_deg, target_deg.unwrap_or(angle_deg));
            let rests = !moving && (at - last).abs() <= self.motion.tolerance_deg;
            (last, still) = if rests { (last, still + 1) } else { (at, 0) };
            let there = target_deg.is_none_or(|to| (at - to).abs() <= self.motion.tolerance_deg);
            match (there, still) {
                (true, 1..) => return Ok(at),
                (false, STILL..) => {
                    let expected = format!("{}°", target_deg.unwrap_or(0.0));
                    return Err(self
                        .error(what, expected, format!("rest at {at:.2}°"))
                        .remedy("check that it turns freely, and tolerance_deg of the stage, then try again")
                        .class(Class::Retry));
                }
                _ => {}
            }
            if Instant::now() > until {
                let remedy = "check that it turns freely, and move_ms of the stage, then resume the session";
                return Err(self.error(what, "the end of the movement", format!("{at:.2}°")).remedy(remedy));
            }
            pause(POLL).await;
        }
    }

    fn moved_away(&mut self, what: &str, left: f64, at: f64) -> DeviceError {
        self.zero = Zero::Forgotten;
        let got = format!("{at:.2}°, after a reset or another program's move");
        self.error(what, format!("to find it where it was left, at {left:.2}°"), got)
            .remedy("check its angle in the program of the server, then resume the session")
    }

    /// Angle of the rotator, which must be its last known one.
    async fn verify_position(&mut self, what: &str) -> DeviceResult<f64> {
        let Zero::Known(left) = self.zero else { return self.find(what).await };
        let at = unwrapped(self.read(what)?.angle_deg, left);
        match self.zero.left_elsewhere(at, self.motion.tolerance_deg) {
            Some(left) => Err(self.moved_away(what, left, at)),
            None => Ok(at),
        }
    }

    /// Waits for rest. The angle counts as known from then on.
    async fn find(&mut self, what: &str) -> DeviceResult<f64> {
        let at = self.wait_for_rest(what, None).await?;
        let at = within(at, self.motion.limits_deg);
        self.zero = Zero::Known(at);
        Ok(at)
    }

    fn arrived(&self, angle_deg: f64) -> Arrived {
        Arrived { since: self.clock.now() + Duration::from_millis(self.motion.settling_ms), angle_deg }
    }
}

/// Waits; the call can be dropped meanwhile.
async fn pause(time: Duration) {
    std::thread::sleep(time);
    tokio::task::yield_now().await;
}

#[async_trait]
impl<P: Port> Stage for Rotator<P> {
    fn describe(&self) -> StageInfo {
        StageInfo {
            id: self.port.id().to_owned(),
            speed_deg_s: self.motion.speed_deg_s,
            settling_s: self.motion.settling_ms as f64 / 1000.0,
            limits_deg: self.motion.limits_deg,
            tolerance_deg: self.motion.tolerance_deg,
            approach_deg: 0.0,
            longest_s: 2.0 * self.motion.move_ms as f64 / 1000.0,
            halts: self.port.halts(),
            by_hand: false,
        }
    }

    /// A rotator keeps its zero itself; its present angle is taken as known.
    async fn home(&mut self) -> DeviceResult<Arrived> {
        let at = self.find("home").await?;
        Ok(self.arrived(at))
    }

    async fn move_to(&mut self, angle_deg: f64) -> DeviceResult<Arrived> {
        let what = format!("move to {angle_deg}°");
        check::angle(self.port.id(), &what, angle_deg, self.motion.limits_deg, "stage")?;
        let from = self.verify_position(&what).await?;
        self.zero = Zero::Going { from, to: angle_deg };
        self.port.go(&what, angle_deg.rem_euclid(360.0))?;
        let at = self.wait_for_rest(&what, Some(angle_deg)).await?;
        self.zero = Zero::Known(at);
        Ok(self.arrived(at))
    }

    async fn halt(&mut self) -> DeviceResult<()> {
        if self.port.halts() {
            self.port.stop()?;
        }
        self.find("halt").await.map(drop)
    }

    async fn position(&mut self) -> DeviceResult<f64> {
        const WHAT: &str = "report its position";
        if let Zero::Known(_) = self.zero {
            return self.verify_position(WHAT).await;
        }
        Ok(within(self.read(WHAT)?.angle_deg, self.motion.limits_deg))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SystemClock;
    use crate::wire::wait;
    use proptest::prelude::*;
    use std::sync::Mutex;

    /// A rotator that moves by `step_deg` per query.
    #[derive(Clone)]
    struct Fake(Arc<Mutex<State>>);

    struct State {
        at: f64,
        to: f64,
        step_deg: f64,
        /// Position at which it is blocked.
        stuck: Option<f64>,
        stops: u32,
    }

    impl Port for Fake {
        fn id(&self) -> &str {
            "fake"
        }

        fn halts(&self) -> bool {
            true
        }

        fn read(&mut self, _: &str) -> DeviceResult<Reading> {
            let mut state = self.0.lock().unwrap();
            let left = state.to - state.at;
            state.at += left.clamp(-state.step_deg, state.step_deg);
            let angle_deg = state.stuck.unwrap_or(state.at);
            Ok(Reading { angle_deg, moving: state.stuck.is_none() && state.at != state.to })
        }

        fn go(&mut self, _: &str, angle_deg: f64) -> DeviceResult<()> {
            assert!((0.0..=360.0).contains(&angle_deg), "{angle_deg}");
            self.0.lock().unwrap().to = angle_deg;
            Ok(())
        }

        fn stop(&mut self) -> DeviceResult<()> {
            let mut state = self.0.lock().unwrap();
            (state.to, state.stops) = (state.at, state.stops + 1);
            Ok(())
        }
    }

    fn rotator(at: f64, motion: Motion) -> (Rotator<Fake>, Arc<Mutex<State>>) {
        let state = Arc::new(Mutex::new(State { at, to: at, step_deg: 400.0, stuck: None, stops: 0 }));
        (Rotator::new(Fake(state.clone()), motion, Arc::new(SystemClock)).unwrap(), state)
    }

    #[test]
    fn angles_are_those_of_the_circle_nearest_to_the_target() {
        let motion = Motion { limits_deg: [-90.0, 450.0], ..Motion::default() };
        let (mut stage, state) = rotator(350.0, motion);
        for (to, sent) in [(0.0, 0.0), (-5.0, 355.0), (360.0, 0.0), (45.0, 45.0), (400.0, 40.0)] {
            assert!((wait(stage.move_to(to)).unwrap().angle_deg - to).abs() < 1e-9);
            assert!((state.lock().unwrap().to - sent).abs() < 1e-9, "{to}");
            assert!((wait(stage.position()).unwrap() - to).abs() < 1e-9, "{to}");
        }
        // Just below 360° is just below 0°.
        wait(stage.move_to(0.0)).unwrap();
        (state.lock().unwrap().at, state.lock().unwrap().to) = (359.98, 359.98);
        assert!((wait(stage.position()).unwrap() + 0.02).abs() < 1e-9);
        for beyond in [-91.0, 451.0, f64::NAN] {
            assert_eq!(wait(stage.move_to(beyond)).unwrap_err().class, Class::Setup);
        }
    }

    #[test]
    fn a_rotator_that_stands_elsewhere_is_named() {
        let (mut stage, state) = rotator(10.0, Motion::default());
        state.lock().unwrap().stuck = Some(12.0);
        let error = wait(stage.move_to(90.0)).unwrap_err();
        assert!(error.class == Class::Retry && error.got.contains("rest at 12.00°"), "{error}");
        state.lock().unwrap().stuck = None;
        wait(stage.move_to(90.0)).unwrap();
        // Another program turns it.
        state.lock().unwrap().stuck = Some(20.0);
        let error = wait(stage.move_to(95.0)).unwrap_err();
        assert!(error.class == Class::Stop && error.got.contains("another program"), "{error}");
        assert!(error.expected.contains("90.00°"), "{error}");
    }

    #[test]
    fn a_dropped_move_is_stopped() {
        let (mut stage, state) = rotator(0.0, Motion::default());
        state.lock().unwrap().step_deg = 0.5;
        {
            let mut movement = std::pin::pin!(stage.move_to(300.0));
            let mut context = std::task::Context::from_waker(std::task::Waker::noop());
            for _ in 0..4 {
                assert!(movement.as_mut().poll(&mut context).is_pending());
            }
        }
        wait(stage.halt()).unwrap();
        let at = wait(stage.position()).unwrap();
        assert!(state.lock().unwrap().stops == 1 && at > 0.0 && at < 10.0, "{at}");
    }

    #[test]
    fn a_movement_without_end_is_an_error() {
        let (mut stage, state) = rotator(0.0, Motion { move_ms: 100, ..Motion::default() });
        state.lock().unwrap().step_deg = 1e-3;
        let error = wait(stage.move_to(300.0)).unwrap_err();
        assert!(error.expected.contains("end of the movement"), "{error}");
    }

    #[test]
    fn defects_of_the_settings_are_named() {
        let good = Motion::default();
        assert_eq!(good.check(), Ok(()));
        for (wrong, key) in [
            (Motion { answer_ms: 0, ..good.clone() }, "answer_ms"),
            (Motion { tolerance_deg: f64::NAN, ..good.clone() }, "tolerance_deg"),
            (Motion { limits_deg: [10.0, 5.0], ..good.clone() }, "limits_deg"),
        ] {
            assert!(wrong.check().unwrap_err().contains(key));
        }
    }

    #[test]
    fn an_unknown_angle_is_taken_within_the_limits() {
        assert_eq!([0.0, 360.0, -1.0, 359.5].map(|a| within(a, [0.0, 360.0])), [0.0, 0.0, 359.0, 359.5]);
        assert_eq!([350.0, 190.0, 90.0].map(|a| within(a, [0.0, 180.0])), [-10.0, 190.0, 90.0]);
    }

    proptest! {
        #[test]
        fn unwrapping_changes_by_whole_turns(angle in -1e4..1e4_f64, near in -1e4..1e4_f64) {
            let turned = unwrapped(angle, near);
            prop_assert!((turned - near).abs() <= 180.0 + 1e-6);
            let turns = (turned - angle) / 360.0;
            prop_assert!((turns - turns.round()).abs() < 1e-6);
        }
    }
}
