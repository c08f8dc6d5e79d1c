//! Predicted time and disk space of a session: the engine's timeline without the devices.

use super::steps::groups;
use super::{Plan, State, Step};
use crate::engine::{TURN_DEG, lights, tried};
use nacre_drivers::{CameraInfo, DisplayInfo, FlashInfo, StageInfo};
use serde::Serialize;
use std::time::Duration;

/// Limits of the devices of a bench.
#[derive(Clone, Debug)]
pub struct Limits {
    /// Stage of the analyser.
    pub stage: StageInfo,
    /// The camera.
    pub camera: CameraInfo,
    /// The panel.
    pub display: DisplayInfo,
    /// Flash, if any.
    pub flash: Option<FlashInfo>,
}

/// Predicted time and disk space of a session.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// Number of stored frames.
    pub frames: usize,
    /// Time of the devices in seconds, including metering.
    pub seconds: f64,
    /// Share of metering in seconds, if the exposure has been metered.
    pub metering_seconds: Option<f64>,
    /// Exposure time in seconds, as planned or metered.
    pub exposure_s: f64,
    /// Upper bound of the size of the frames in bytes (uncompressed).
    pub bytes: u64,
    /// For an adaptive series, the minimum; the values above are the maximum.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub least: Option<Least>,
}

/// Minimum time and disk space of a session.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Least {
    /// Number of stored frames.
    pub frames: usize,
    /// Time of the devices in seconds.
    pub seconds: f64,
    /// Size of the frames in bytes.
    pub bytes: u64,
}

/// Stops on the way from `from` to `to`: two if the angle decreases, otherwise one. A person rotates directly.
pub(crate) fn approach(from: f64, to: f64, stage: &StageInfo) -> Vec<f64> {
    let below = (to - stage.approach_deg).max(stage.limits_deg[0]);
    if to <= from && below < to { vec![below, to] } else { vec![to] }
}

/// Maximum on-time of the flash for a group of `exposures` exposures, which may be switched on just after one began.
pub(crate) fn light_on_s(exposure: Duration, exposures: usize, limits: &Limits) -> f64 {
    let beat = exposure.as_secs_f64() + limits.camera.readout_s;
    2.0 * limits.flash.as_ref().map_or(0.0, |f| f.settling_s) + (exposures as f64 + 1.0) * beat
}

impl Plan {
    /// Time and disk space of a session with this exposure time, without metering. `stands_deg` is the present angle of
    /// the stage.
    pub fn estimate(&self, exposure: Duration, limits: &Limits, stands_deg: f64) -> Estimate {
        if self.levels().is_some() && self.exposures_ms.is_empty() {
            let exposures_ms = self.level_exposures_ms(exposure, &limits.camera);
            let estimate = self.clone().with_bracket(exposures_ms).estimate(exposure, limits, stands_deg);
            return Estimate { exposure_s: exposure.as_secs_f64(), ..estimate };
        }
        let most = self.estimate_of(&self.most_steps(), exposure, limits, stands_deg);
        let least = self.is_open().then(|| self.estimate_of(&self.steps(), exposure, limits, stands_deg));
        let least = least.map(|e| Least { frames: e.frames, seconds: e.seconds, bytes: e.bytes });
        Estimate { least, ..most }
    }

    /// Time in seconds of metering that ends at this exposure; 0 for a plan with stated exposures.
    pub fn metering_s(&self, exposure: Duration, limits: &Limits) -> f64 {
        if !self.is_metered() {
            return 0.0;
        }
        let mut time = Timeline::new(limits);
        let mut guess = None;
        for light in lights(self) {
            for tried in tried(guess, exposure) {
                let turns: &[f64] = if light.analyser_deg.is_some() { &TURN_DEG } else { &[0.0] };
                for angle in turns {
                    let analyser_deg = light.analyser_deg.map(|_| *angle);
                    let exposure_ms = Some(1000.0 * tried.as_secs_f64());
                    time.take(&State { analyser_deg, exposure_ms, ..light.clone() }, tried, 1);
                }
            }
            guess = Some(exposure);
        }
        time.now
    }

    fn estimate_of(&self, steps: &[Step], exposure: Duration, limits: &Limits, stands_deg: f64) -> Estimate {
        let mut time = Timeline::new(limits);
        if steps.iter().any(|s| s.state.analyser_deg.is_some()) {
            time.now += stands_deg.abs() / limits.stage.speed_deg_s + limits.stage.settling_s;
        }
        for group in groups(steps) {
            time.take(&group[0].state, exposure, group.len() * self.camera.average as usize);
        }
        let [width, height] = self.frame_size(limits);
        Estimate {
            frames: steps.len(),
            seconds: time.now,
            metering_seconds: None,
            exposure_s: exposure.as_secs_f64(),
            bytes: (steps.len() * width * height * 2) as u64,
            least: None,
        }
    }
}

/// Simulated clocks of the devices. The camera runs freely: frames begin at multiples of the frame period, and controls
/// take effect after a lag.
struct Timeline<'a> {
    limits: &'a Limits,
    now: f64,
    /// Start time of a frame, and frame period from then on.
    beat_at: f64,
    beat: f64,
    exposure: Option<Duration>,
    angle: f64,
}

impl<'a> Timeline<'a> {
    fn new(limits: &'a Limits) -> Self {
        let beat = limits.camera.exposure_now_s + limits.camera.readout_s;
        Self { limits, now: 0.0, beat_at: 0.0, beat, exposure: None, angle: 0.0 }
    }

    /// Start of the first frame not before `time`.
    fn next_beat(&self, time: f64) -> f64 {
        // Tolerance for rounding errors of summed periods.
        self.beat_at + self.beat * ((time - self.beat_at) / self.beat - 1e-9).ceil()
    }

    /// Waits until the exposure is certain to be in effect: the frame in progress, and the lag, which ends with a frame
    /// of the new exposure.
    fn expose(&mut self, exposure: Duration) {
        if self.exposure == Some(exposure) {
            return;
        }
        let new = exposure.as_secs_f64() + self.limits.camera.readout_s;
        let old = f64::from(self.limits.camera.control_lag_frames.saturating_sub(1)) * self.beat;
        // A frame that ends as the control is set does not count as in progress.
        let in_progress = self.next_beat(self.now + 1e-9);
        self.now = in_progress + old + new;
        (self.beat_at, self.beat, self.exposure) = (self.now, new, Some(exposure));
    }

    fn take(&mut self, state: &State, session: Duration, exposures: usize) {
        self.expose(state.exposure(session));
        if let Some(to) = state.analyser_deg {
            let stage = &self.limits.stage;
            for stop in approach(self.angle, to, stage) {
                self.now += (stop - self.angle).abs() / stage.speed_deg_s + stage.settling_s;
                self.angle = stop;
            }
        }
        let settling = if state.flash { self.limits.flash.as_ref().map_or(0.0, |f| f.settling_s) } else { 0.0 };
        self.now = self.next_beat(self.now + settling) + exposures as f64 * self.beat + settling;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_approached_from_below_within_the_limits() {
        let mut stage = nacre_sim::describe(&nacre_sim::BenchConfig::default()).stage;
        stage.limits_deg = [-10.0, 370.0];
        assert_eq!(approach(0.0, 45.0, &stage), [45.0]);
        assert_eq!(approach(45.0, 45.0, &stage), [40.0, 45.0]);
        assert_eq!(approach(90.0, -8.0, &stage), [-10.0, -8.0]);
        assert_eq!(approach(90.0, -10.0, &stage), [-10.0]);
        assert_eq!(approach(90.0, 0.0, &StageInfo { approach_deg: 0.0, ..stage }), [0.0]);
    }
}
